"""Policies that drive step by step, in the world of a scenario."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.layers.registry import on_request
from ambinav.drive.drive import PATIENCE, SPARE, drive
from ambinav.drive.world import OUTCOMES
from ambinav.errors import InputError
from ambinav.geometry.motion.steering import Steering
from ambinav.plugins import load_callable
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.service.service import AmbiguityService

if TYPE_CHECKING:
    from ambinav.compare.route_part import RoutePart
    from ambinav.compare.scenario_file import Loaded
    from ambinav.compare.scenario_schema import PairPart
    from ambinav.drive.robot import Robot
    from ambinav.geometry.environment import Environment
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner
    from ambinav_envs.parameters import NavigationParameters
    from ambinav_envs.policies.policy import Policy

STEP = 0.1
"""Metres between the way points of the route that a policy drives."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Driver:
    """A policy that drives, as plain values.

    Attributes:
        told: What the scenario names it by.
        folder: What names of files are relative to.
        start: x, y of its pair, and any heading.
        goal: x and y.
        checksum: See `ambinav_envs.policies.load.checksum_of`.
        differs: How scanner and robot differ from those that it was trained with, in words; empty
            if they do not.
    """

    told: str
    folder: str
    start: tuple[float, float, float]
    goal: tuple[float, float]
    checksum: str
    differs: str = ""


def is_controller(told: str, folder: Path) -> bool:
    """Whether a scenario's policy drives step by step; else it makes a route.

    Those that drive are policy files, shipped ones, and callables that take two arguments, an
    observation and an action space. One that makes routes takes four.

    Raises:
        InputError: there is no such callable.
    """
    if told.endswith(".zip"):
        return True
    if ":" not in told and not told.endswith(".py"):
        return True
    function = load_callable(told, folder)
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return False
    return not _takes(signature, 4) and _takes(signature, 2)


def _takes(signature: inspect.Signature, count: int) -> bool:
    try:
        signature.bind(*[None] * count)
    except TypeError:
        return False
    return True


def driver_of(loaded: Loaded, pair: PairPart, part: RoutePart) -> Driver:
    """The policy of a route, which is loaded to see whether it can be.

    Raises:
        InputError: see `ambinav_envs.policies.load_policy`; it was trained with another scanner or
            robot, and that is not forced; or Gymnasium is missing.
    """
    told, folder = str(part.policy), Path(loaded.folder)
    policy = _policy(told, folder)
    from ambinav_envs.policies.fit import check_fit, difference_text
    from ambinav_envs.policies.load import checksum_of

    scenario = loaded.scenario
    parameters = _parameters(policy, loaded.scanner, scenario.robot, scenario.drive.rate)
    differs = difference_text(check_fit(policy, parameters, loaded.force))
    checksum = checksum_of(told, policy, folder)
    (x, y), (goal_x, goal_y) = pair.start[:2], pair.goal[:2]
    return Driver(told, str(folder), (x, y, 0.0), (goal_x, goal_y), checksum, differs)


def _parameters(
    policy: Policy, scanner: RangeScanner, robot: Robot, rate: float
) -> NavigationParameters:
    """Of the environment that shows a policy what it sees."""
    from ambinav_envs.parameters import NavigationParameters

    common = {"scanner": scanner, "robot": robot, "dt": 1.0 / rate}
    layer = policy.environment.get("layer")
    return NavigationParameters.of(common | policy.seeing | {"layer": layer})


class PolicyController:
    """A policy that steers the robots of a drive; see `ambinav.drive.controller.Controller`.

    Args:
        driver: The policy.
        environment: The building, as the map has it.
        scanner: What the robots see with.
        robot: What they are.
        rate: Time steps a second.
        runs: How many.

    Raises:
        InputError: the policy does not fit the scanner, or the robot has no room at start or goal.
    """

    def __init__(
        self,
        driver: Driver,
        environment: Environment,
        scanner: RangeScanner,
        robot: Robot,
        rate: float,
        runs: int,
    ) -> None:
        from ambinav_envs.buildings.source import BuildingSource
        from ambinav_envs.observer import Observer
        from ambinav_envs.spaces import action_space, observation_space

        self._policy = _policy(driver.told, Path(driver.folder))
        parameters = _parameters(self._policy, scanner, robot, rate)
        self._policy.prepare(observation_space(parameters), action_space(parameters))
        source = BuildingSource(
            environment, scanner, robot.radius, layers=on_request(parameters.cost_layer)
        )
        self._observer = Observer(source, parameters, driver.start, driver.goal, runs)
        self._parameters = parameters
        self._starts = np.ones(runs, dtype=np.bool_)

    @property
    def distance(self) -> float:
        """Length of the shortest way from start to goal, metres."""
        return self._observer.distance

    def want(
        self, belief: Floats, covariance: Floats, speeds: Floats, ranges: NDArray[np.float32]
    ) -> Floats:
        """See `Controller`."""
        from ambinav_envs.policies.policy import checked_actions

        parameters, name = self._parameters, self._policy.name
        seen = self._observer.see(belief, covariance, speeds, ranges)
        actions = self._policy.act(seen, self._starts)
        self._starts = np.zeros_like(self._starts)
        chosen = checked_actions(name, actions, len(belief), parameters.discrete).clip(-1.0, 1.0)
        least, most = parameters.min_speed, parameters.robot.max_speed
        want = np.empty_like(chosen)
        want[:, 0] = least + 0.5 * (chosen[:, 0] + 1.0) * (most - least)
        want[:, 1] = chosen[:, 1] * parameters.robot.max_turn_rate
        return want


def driven_route(loaded: Loaded, amap: AmbiguityMap, driver: Driver) -> Route:
    """The way that a policy drives where it knows its place and nothing is unmapped.

    Raises:
        InputError: it does not get to the goal, or see `PolicyController`.
    """
    scenario = loaded.scenario
    how, robot = scenario.drive, scenario.robot
    controller = PolicyController(
        driver, loaded.environment, loaded.scanner, robot, how.rate, runs=1
    )
    service = AmbiguityService(amap, scenario.map.layer)
    straight = np.array([driver.start, (*driver.goal, 0.0)])
    drives = drive(
        loaded.environment,
        loaded.scanner,
        robot,
        evaluate_route(service, straight, Steering(), planner="straight"),
        "perfect",
        np.random.default_rng(how.seed),
        1,
        follower=scenario.follower,
        rate=how.rate,
        max_time=how.max_time or PATIENCE * controller.distance / robot.max_speed + 2.0 * SPARE,
        controller=controller,
    )
    way = drives.truth[0, : drives.samples[0]]
    if not drives.reached[0]:
        x, y = way[-1, :2].tolist()
        raise InputError(
            f"policy {driver.told} does not get to the goal even where it knows its place "
            f"({OUTCOMES[drives.outcome[0]]} at ({x:.2f}, {y:.2f}) m); choose another policy or "
            "pair"
        )
    kept = [way[0]]
    for pose in way:
        if np.hypot(*(pose - kept[-1])[:2]) >= STEP:
            kept.append(pose)
    poses = np.array([*kept, (*driver.goal, 0.0)])
    return evaluate_route(service, poses, Steering(), planner=f"policy {driver.told}")


def _policy(told: str, folder: Path) -> Policy:
    from importlib.util import find_spec

    if find_spec("gymnasium") is None:
        raise InputError('policies that drive need Gymnasium; run: pip install "ambinav[envs]"')
    from ambinav_envs.policies import load_policy

    return load_policy(told, folder)
