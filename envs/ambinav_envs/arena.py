"""Arenas of episodes: our batched simulation, or an environment that somebody wrapped."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding

from ambinav.config import as_count
from ambinav.runtime.progress import Progress, silent
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.evaluation import EpisodeDriver, Episodes, episode_seeds, evaluate_in, joined
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.policy import Policy, checked_actions
from ambinav_envs.registered import arguments_of_id, is_wrapped, make_wrapped, simulation_of
from ambinav_envs.scenario import source_of
from ambinav_envs.simulation.layout import RUNNING, TIMEOUT
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.spaces import action_space, observation_space


@dataclass(frozen=True, eq=False)
class Arena:
    """Buildings and parameters of an environment, and how its episodes are driven.

    Attributes:
        source: Source of the buildings.
        parameters: Everything else.
        wrapped: The id of an environment that somebody wrapped; None: there is nothing around ours.
        arguments: What it is made with.
    """

    source: BuildingSource
    parameters: NavigationParameters
    wrapped: str | None = None
    arguments: Mapping[str, Any] | None = None

    @classmethod
    def of(cls, name: str | None, arguments: Mapping[str, Any]) -> Arena:
        """Return the arena of an id.

        Args:
            name: The id; None: the arguments say everything.
            arguments: In the place of those of the id.

        Raises:
            InputError: nobody has registered it, or an argument is of no use.
        """
        if name is None:
            return cls(*source_of(arguments))
        complete = arguments_of_id(name, arguments)
        wrapped = name if is_wrapped(name) else None
        return cls(*source_of(complete), wrapped, dict(arguments))

    def changed(self, **changes: Any) -> Arena:
        """Return the same with other parameters."""
        parameters = self.parameters
        edits = {key: value for key, value in changes.items() if getattr(parameters, key) != value}
        return replace(
            self,
            parameters=replace(parameters, **changes),
            arguments={**(self.arguments or {}), **edits},
        )

    def check(self, policy: Policy, seed: int) -> None:
        """Check that a policy fits, and that the first episode of an evaluation can begin.

        Raises:
            InputError: it does not fit, or a building has no room for the robot or the task.
        """
        (number,) = episode_seeds(seed, 0, 1)
        if self.wrapped is None:
            parameters = self.parameters
            policy.configure(parameters)
            policy.prepare(observation_space(parameters), action_space(parameters))
            simulation = Simulation(self.source, parameters, 1)
            generator, _ = seeding.np_random(int(number))
            simulation.reset([0], [generator], None, simulation.outcome())
            return
        with closing(make_wrapped(self.wrapped, self.arguments or {})) as env:
            simulation_of(env).source = self.source
            policy.configure(self.parameters)
            policy.prepare(env.observation_space, env.action_space)
            env.reset(seed=int(number))

    def evaluate(
        self,
        controller: EpisodeDriver | Policy,
        episodes: int,
        seed: int,
        progress: Progress = silent,
    ) -> Episodes:
        """Run episodes with a policy or a controller; see `evaluation.evaluate_in`.

        A wrapped environment is driven by itself, one episode after the other, which takes several
        times as long; the figures except the reward are those of the simulation in it.

        Raises:
            InputError: see `evaluation.evaluate_in`, or a wrapper fails.
        """
        if self.wrapped is None:
            return evaluate_in(
                controller, self.source, self.parameters, episodes, seed, progress=progress
            )
        with closing(make_wrapped(self.wrapped, self.arguments or {})) as env:
            simulation = simulation_of(env)
            # The maps that are held already.
            simulation.source = self.source
            if isinstance(controller, Policy):
                controller.configure(simulation.parameters)
                controller.prepare(env.observation_space, env.action_space)
            driven = []
            for number in episode_seeds(seed, 0, as_count(episodes, "episodes")):
                driven.append(_episode(env, controller, int(number)))
                progress(len(driven) / episodes)
        return joined(driven)


def _episode(env: gym.Env[Any, Any], controller: EpisodeDriver | Policy, seed: int) -> Episodes:
    """Drive one episode and return it."""
    simulation = simulation_of(env)
    seen, _ = env.reset(seed=seed)
    if not isinstance(controller, Policy):
        controller.begin(simulation, [0])
    starts, has_ended = np.ones(1, dtype=np.bool_), False
    rewards, costs, lost, errors = [], [], [], []
    discrete = isinstance(env.action_space, gym.spaces.Discrete)
    while not has_ended:
        rows = {name: part[None] for name, part in seen.items()}
        if isinstance(controller, Policy):
            actions = controller.act(rows, starts)
        else:
            actions = controller.act(rows, starts, simulation)
        checked = checked_actions(
            getattr(controller, "name", None), actions, 1, simulation.parameters
        )
        action = np.int64(np.asarray(actions)[0]) if discrete else _in_box(env, checked[0])
        seen, reward, ended, cut, info = env.step(action)
        rewards.append(float(reward))
        costs.append(info["cost"])
        lost.append(info["cost_lost"])
        errors.append(info["error"])
        starts, has_ended = np.zeros(1, dtype=np.bool_), ended or cut
    return _figures(env, seed, np.array([rewards, costs, lost, errors]))


def _in_box(env: gym.Env[Any, Any], speeds: np.ndarray[Any, Any]) -> Any:
    """Return speed and turn rate as an action of the environment's space."""
    box: Any = env.action_space
    return np.clip(speeds.astype(box.dtype), box.low, box.high)


def _figures(env: gym.Env[Any, Any], seed: int, steps: np.ndarray[Any, Any]) -> Episodes:
    """Return the results of one episode, given reward, cost, lost and error of each step."""
    simulation = simulation_of(env)
    state, site = simulation.state[:1], simulation.sites[0]
    assert site is not None
    rewards, costs, lost, errors = steps
    seconds = state["steps"] * simulation.parameters.dt
    outcome = state["outcome"].copy()
    # A wrapper may have ended it, such as Gymnasium's TimeLimit.
    outcome[outcome == RUNNING] = TIMEOUT
    return Episodes(
        outcome=outcome,
        was_lost=state["was_lost"].copy(),
        lost_at_end=state["lost"].copy(),
        lost_seconds=np.array([lost.sum()]) * simulation.parameters.dt,
        error_max=np.array([errors.max()]),
        error_mean=np.array([errors.sum()]) / state["steps"],
        exposure=state["exposure"].copy(),
        travelled=state["travelled"].copy(),
        shortest=state["shortest"].copy(),
        seconds=seconds,
        reward=np.array([rewards.sum()]),
        cost=np.array([costs.sum()]),
        building=np.array([site.building.key]),
        seed=np.array([seed], dtype=np.int64),
    )
