"""Policies as controllers of drives, for scenarios of a comparison that name one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.layers.registry import on_request
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.commands import as_commands
from ambinav_envs.observer import Observer
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.fit import check_fit, difference_text, trained_dt
from ambinav_envs.policies.load import checksum_of, load_policy
from ambinav_envs.policies.policy import RULES, Policy, checked_actions
from ambinav_envs.spaces import action_space, observation_space


def examine(
    policy_source: str,
    folder: Path,
    scanner: RangeScanner,
    robot: Robot,
    rate: float,
    force: bool,
    trust: bool = False,
) -> tuple[str, str]:
    """Load a policy to check whether it can drive.

    Args:
        policy_source: The policy as named by a scenario.
        folder: Folder to which file names are relative.
        scanner: The robots' scanner.
        robot: The robots.
        rate: Time steps a second.
        force: Let it drive another scanner or robot than it was trained with.
        trust: See `load_policy`.

    Returns:
        Its checksum, and how scanner and robot differ from those of its training, in words.

    Raises:
        InputError: see `load_policy`; or scanner or robot differ, and that is not forced.
    """
    policy = load_policy(policy_source, folder, trust=trust)
    differences = check_fit(policy, _parameters(policy, scanner, robot, rate), force)
    return checksum_of(policy_source, policy, folder), difference_text(differences)


class PolicyController:
    """A policy that steers the robots of a drive; see `ambinav.drive.drive.Controller`.

    The drive ends by its own rule, at the goal by the estimate: what a policy declares is not
    looked at.

    Args:
        policy_source: The policy as named by a scenario.
        folder: Folder to which file names are relative.
        start: x, y of its pair, and any heading.
        goal: x and y.
        environment: The building, as in the map.
        scanner: The robots' scanner.
        robot: The robots.
        rate: Time steps a second; None: those of the policy's training.
        runs: Number of runs.
        trust: See `load_policy`.

    Raises:
        InputError: the policy does not fit the scanner, or the robot has no room at start or goal.
    """

    def __init__(
        self,
        policy_source: str,
        folder: Path,
        start: tuple[float, float, float],
        goal: tuple[float, float],
        environment: Environment,
        scanner: RangeScanner,
        robot: Robot,
        rate: float | None,
        runs: int,
        trust: bool = False,
    ) -> None:
        self._policy = load_policy(policy_source, folder, trust=trust)
        parameters = _parameters(self._policy, scanner, robot, rate)
        self._policy.configure(parameters)
        self._policy.prepare(observation_space(parameters), action_space(parameters))
        source = BuildingSource(
            environment, scanner, robot.radius, layers=on_request(parameters.cost_layer)
        )
        self._observer = Observer(source, parameters, start, goal, runs)
        self._parameters = parameters
        self._starts = np.ones(runs, dtype=np.bool_)

    @property
    def dt(self) -> float:
        """Time step of the policy, seconds."""
        return self._parameters.dt

    @property
    def distance(self) -> float:
        """Length of the shortest path from start to goal, metres."""
        return self._observer.distance

    def command(
        self, belief: Floats, covariance: Floats, speeds: Floats, ranges: Floats32
    ) -> Floats:
        """See `Controller`."""
        parameters, name = self._parameters, self._policy.name
        seen = self._observer.see(belief, covariance, speeds, ranges)
        actions = self._policy.act(seen, self._starts)
        self._starts = np.zeros_like(self._starts)
        chosen = checked_actions(name, actions, len(belief), parameters)
        return as_commands(chosen, parameters)


def _parameters(
    policy: Policy, scanner: RangeScanner, robot: Robot, rate: float | None
) -> NavigationParameters:
    """Return the parameters of the environment whose observations the policy expects."""
    dt = trained_dt(policy) if rate is None else 1.0 / rate
    common = {"scanner": scanner, "robot": robot, **({} if dt is None else {"dt": dt})}
    rules = {name: policy.environment[name] for name in RULES if name in policy.environment}
    layer = policy.environment.get("layer")
    return NavigationParameters.of(common | policy.seeing | rules | {"layer": layer})
