"""Evaluation of policies and controllers over a number of episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import ArrayLike, NDArray

from ambinav.config import as_count
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import Policy, checked_actions
from ambinav_envs.seeds import as_seed
from ambinav_envs.simulation.layout import (
    ARRIVED,
    COST,
    COST_LOST,
    ERROR,
    OUTCOMES,
    REWARD,
    RUNNING,
    TIMEOUT,
)
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.spaces import action_space, observation_space

UNSEEN: Final = 1_000_000
"""Default number of the first building in which policies and planners are judged; training uses
smaller numbers."""
CHUNK = 128
"""Number of robots at once. It is constant, even if some are idle: the answer of a neural network
for one of them depends in its last bits on the size of the batch. A robot without an episode gets
the
first observation of another one, or its own last one, and its commands are ignored."""


@runtime_checkable
class EpisodeDriver(Protocol):
    """A controller of robots that may read more than a policy's observations."""

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Prepare for the new episodes of some robots."""

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Return the action of each robot, shape (N, columns) or (N,); see `Policy.act`."""


@dataclass(frozen=True, eq=False)
class Episodes:
    """Results of E episodes; each array has the shape (E,).

    Attributes:
        outcome: One of `layout.OUTCOMES` by code.
        was_lost: True if the robot was ever lost.
        lost_at_end: True if it was lost at the last step.
        lost_seconds: Time during which it was lost, seconds.
        error_max: Largest error of the estimate, metres.
        error_mean: Mean over the steps, metres.
        exposure: The ambiguity layer summed over the path driven, metres.
        travelled: Metres truly driven.
        shortest: Length of the shortest path from start to goal, metres.
        seconds: Duration, seconds.
        reward: Sum of the rewards, undiscounted.
        cost: Sum of the costs.
        building: Key of the building.
        seed: `NavigationEnv.reset(seed=...)` with the same parameters is the same episode.
    """

    outcome: Ints
    was_lost: Bools
    lost_at_end: Bools
    lost_seconds: Floats
    error_max: Floats
    error_mean: Floats
    exposure: Floats
    travelled: Floats
    shortest: Floats
    seconds: Floats
    reward: Floats
    cost: Floats
    building: NDArray[np.str_]
    seed: Ints

    def __len__(self) -> int:
        """Return the number of episodes E."""
        return len(self.outcome)

    def ended(self, code: int) -> Bools:
        """Return which episodes ended with this outcome."""
        return np.asarray(self.outcome == code, dtype=np.bool_)

    @property
    def length_ratio(self) -> Floats:
        """Driven length over the shortest path for arrivals; nan for others, and at the start."""
        ratio = np.full(len(self), np.nan)
        arrived = self.ended(ARRIVED) & (self.shortest > 0.0)
        np.divide(self.travelled, self.shortest, out=ratio, where=arrived)
        return ratio

    @property
    def spl(self) -> Floats:
        """Success weighted by path length: shortest over driven length, at most 1; 0 for failures.

        Equation 1 of Anderson et al., "On Evaluation of Embodied Navigation Agents" (2018), before
        its mean over the episodes. Robots stop up to `goal_radius` before the goal.
        """
        longer = np.maximum(self.travelled, self.shortest)
        share = np.ones(len(self))
        np.divide(self.shortest, longer, out=share, where=longer > 0.0)
        return np.where(self.ended(ARRIVED), share, 0.0)

    def sct(self, max_speed: float) -> Floats:
        """Success weighted by completion time: fastest by needed time, at most 1; 0 for failures.

        The metric of Yokoyama, Ha and Batra, "Success Weighted by Completion Time: A Dynamics-Aware
        Evaluation Criteria for Embodied Navigation" (2021), before its mean over the episodes. The
        fastest time is here the shortest path at top speed, which no robot beats that has to
        accelerate and turn.

        Args:
            max_speed: The robot's top speed, metres per second.
        """
        fastest = self.shortest / max_speed
        return np.where(self.ended(ARRIVED), fastest / np.maximum(self.seconds, fastest), 0.0)

    def summary(self) -> dict[str, float]:
        """Compute shares, and means in metres and seconds, over all episodes; nan without data.

        Raises:
            ZeroDivisionError: there are no episodes.
        """
        shares = {OUTCOMES[code]: _share(self.ended(code)) for code in range(ARRIVED, TIMEOUT + 1)}
        arrived = self.ended(ARRIVED)
        ratio = float(np.mean(self.length_ratio[arrived])) if arrived.any() else float("nan")
        return {
            "episodes": len(self),
            **shares,
            "was_lost": _share(self.was_lost),
            "error_mean": float(np.mean(self.error_mean)),
            "error_max": float(np.mean(self.error_max)),
            "exposure_per_metre": per_metre(self.exposure, self.travelled),
            "length_ratio": ratio,
            "seconds": float(np.mean(self.seconds)),
            "reward": float(np.mean(self.reward)),
            "cost": float(np.mean(self.cost)),
        }


def _share(which: Bools) -> float:
    return float(np.count_nonzero(which) / len(which))


def per_metre(exposure: ArrayLike, travelled: ArrayLike) -> float:
    """Return the exposure of all episodes per metre driven; nan if no robot moved."""
    metres = float(np.sum(travelled))
    return float(np.sum(exposure)) / metres if metres > 0.0 else float("nan")


def joined(parts: Sequence[Episodes]) -> Episodes:
    """Concatenate the episodes of all parts."""
    names = [item.name for item in fields(Episodes)]
    return Episodes(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def episode_seeds(seed: int, first: int, count: int) -> Ints:
    """Return the seeds of the episodes from number `first` on; number k always has the same one.

    Raises:
        InputError: `seed` is no whole number from 0 on.
    """
    if as_seed(seed) is None:
        raise InputError("seed is None; give a whole number from 0 on.")
    words = [
        np.random.SeedSequence([seed, k]).generate_state(1)[0] for k in range(first, first + count)
    ]
    return np.array(words, dtype=np.int64)


def evaluate_in(
    controller: EpisodeDriver | Policy,
    source: BuildingSource,
    parameters: NavigationParameters,
    episodes: int = 200,
    seed: int = 0,
    *,
    chunk: int = CHUNK,
    progress: Progress = silent,
) -> Episodes:
    """Run episodes with a policy or a controller.

    Episode k is the same for all that drive it: building, start, goal, noise of odometry and
    readings, people and obstacles have seeds of their own.

    Args:
        controller: A policy or a controller.
        source: Source of the buildings.
        parameters: Everything else.
        episodes: Number of episodes.
        seed: Seed, 0 or more.
        chunk: See `CHUNK`; how many drive at once.
        progress: Called with the share done.

    Raises:
        InputError: the policy does not fit, or a building has no room for the robot or the task.
    """
    seeds = episode_seeds(seed, 0, as_count(episodes, "episodes"))
    return evaluate_seeds(controller, source, parameters, seeds, chunk=chunk, progress=progress)


def evaluate_seeds(
    controller: EpisodeDriver | Policy,
    source: BuildingSource,
    parameters: NavigationParameters,
    seeds: Ints,
    buildings: Sequence[int] | None = None,
    *,
    chunk: int = CHUNK,
    progress: Progress = silent,
) -> Episodes:
    """Run episodes of given seeds, see `evaluate_in`.

    Args:
        controller: A policy or a controller.
        source: Source of the buildings.
        parameters: Everything else.
        seeds: Seed of each episode, shape (E,).
        buildings: Number of the building of each episode, E of them; None: drawn by the seed.
        chunk: See `CHUNK`; how many drive at once.
        progress: Called with the share done.

    Raises:
        InputError: see `evaluate_in`.
    """
    chunk, episodes = as_count(chunk, "chunk"), len(seeds)
    simulation = Simulation(source, parameters, chunk)
    if isinstance(controller, Policy):
        controller.configure(parameters)
        controller.prepare(observation_space(parameters), action_space(parameters))
        controller = _PolicyDriver(controller)
    driven = []
    for first in range(0, episodes, chunk):
        part = seeds[first : first + chunk]
        among = None if buildings is None else buildings[first : first + chunk]

        def report_progress(share: float, first: int = first, count: int = len(part)) -> None:
            progress((first + share * count) / episodes)

        driven.append(_drive(controller, simulation, part, among, report_progress))
    return joined(driven)


class _PolicyDriver:
    """Adapter from a policy to a controller; the policy gets its observations only."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self.name = policy, policy.name

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Do nothing: a policy needs no preparation."""

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Return the policy's actions."""
        return self._policy.act(observations, starts)


def _drive(
    driver: EpisodeDriver,
    simulation: Simulation,
    seeds: Ints,
    buildings: Sequence[int] | None,
    progress: Progress,
) -> Episodes:
    """Run one episode of each of the first robots; the other robots stay idle."""
    count, parameters = len(seeds), simulation.parameters
    out = simulation.outcome()
    for part in (*out.view, out.figures):
        part[:] = 0.0
    generators = [seeding.np_random(int(seed))[0] for seed in seeds]
    if buildings is None:
        simulation.reset(range(count), generators, None, out)
    for number in dict.fromkeys(buildings or ()):
        rows = [i for i, place in enumerate(buildings or ()) if place == number]
        simulation.reset(rows, generators, {"building": number}, out)
    for part in out.observation.values():
        part[count:] = part[0]
    driver.begin(simulation, range(count))
    active = np.arange(simulation.count) < count
    starts = active.copy()
    sums = {column: np.zeros(simulation.count) for column in (REWARD, COST, COST_LOST, ERROR)}
    largest = np.zeros(simulation.count)
    state, steps = simulation.state, 0
    while active.any():
        actions = driver.act(out.observation, starts, simulation)
        chosen = checked_actions(
            getattr(driver, "name", None), actions, simulation.count, parameters, active
        )
        simulation.step(chosen, active, out)
        for column, total in sums.items():
            total[active] += out.figures[active, column]
        largest[active] = np.maximum(largest, out.figures[:, ERROR])[active]
        active &= state["outcome"] == RUNNING
        starts[:] = False
        steps += 1
        progress(max(steps / parameters.max_steps, 1.0 - np.count_nonzero(active) / count))
    robots = state[:count]
    sites = [site for site in simulation.sites[:count] if site is not None]
    return Episodes(
        outcome=robots["outcome"].copy(),
        was_lost=robots["was_lost"].copy(),
        lost_at_end=robots["lost"].copy(),
        lost_seconds=sums[COST_LOST][:count] * parameters.dt,
        error_max=largest[:count],
        error_mean=sums[ERROR][:count] / robots["steps"],
        exposure=robots["exposure"].copy(),
        travelled=robots["travelled"].copy(),
        shortest=robots["shortest"].copy(),
        seconds=robots["steps"] * parameters.dt,
        reward=sums[REWARD][:count],
        cost=sums[COST][:count],
        building=np.array([site.building.key for site in sites]),
        seed=seeds,
    )
