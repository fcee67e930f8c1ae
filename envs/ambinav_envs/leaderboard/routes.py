"""Planning of the routes of many episodes, each only once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ambinav.drive.noise import OdometryNoise
from ambinav.runtime.array_files import read_arrays, write_arrays
from ambinav.runtime.array_types import Floats
from ambinav.service.service import AmbiguityService

if TYPE_CHECKING:
    from ambinav_envs.buildings.building import Building
    from ambinav_envs.buildings.tasks import Task
    from ambinav_planners import RoutePlanner
    from ambinav_planners.problem import Problem
    from ambinav_planners.registry import Planner, PlannerResult


MARGINS = (0.1, 0.05, 0.0)
"""Metres that a route keeps off walls besides the robot's radius: as `ambinav compare` plans, and
less where there is no path then."""
PATIENCE = (1, 8)
"""Factors of a planner's iterations, tried one after the other until it finds a path."""
GROUP = 16
"""Plans made at once; in one process, where a planner needs fresh ones (see
`ambinav_planners.seeded`)."""


@dataclass(frozen=True)
class PlannerChoice:
    """A planner and its settings.

    Attributes:
        planner: Its name in the registry.
        weight: Weight of the ambiguity.
        iterations: Its budget, if it takes one.
        seed: Seed of its random numbers, from 0 on.
    """

    planner: str
    weight: float = 5.0
    iterations: int | None = 1000
    seed: int = 1


class Routes:
    """The routes of a planner, cached by building, start and goal.

    Args:
        choice: The planner.
        layer: Layer of the ambiguity map that it reads.
        odometry: What the localizer assumes of it, for belief planners; None: their default.
        start_std: Deviations of x, y (metres) and heading (radians) at the start, likewise.

    Raises:
        InputError: there is no such planner, or it needs OMPL, which is missing.
    """

    def __init__(
        self,
        choice: PlannerChoice,
        layer: str = "level",
        odometry: OdometryNoise | None = None,
        start_std: tuple[float, float, float] | None = None,
    ) -> None:
        from ambinav_planners.registry import planner

        self.choice = choice
        self.layer = layer
        self._odometry, self._start_std = odometry, start_std
        self._planner = planner(choice.planner)
        self._routes: dict[str, Floats | None] = {}

    def plan(self, buildings: Sequence[Building], tasks: Sequence[Task]) -> list[Floats | None]:
        """Return waypoints from start to goal of each task, shape (M, 3); None without a route."""
        items = list(zip(buildings, tasks, strict=True))
        keys = [_key(*item) for item in items]
        pairs = zip(keys, items, strict=True)
        todo = {key: item for key, item in pairs if key not in self._routes}
        for margin in MARGINS:
            if not todo:
                break
            paths = self._planned(todo, margin)
            todo = {key: item for key, item in todo.items() if paths[key] is None}
        self._routes |= dict.fromkeys(todo)
        return [self._routes[key] for key in keys]

    def _robot(self, building: Building, margin: float) -> RoutePlanner:
        """Return the route planner of a building."""
        from ambinav_planners import RoutePlanner
        from ambinav_planners.belief.model import BeliefModel

        return RoutePlanner(
            AmbiguityService(building.amap, self.layer, self.choice.weight),
            footprint=building.robot_radius + margin,
            belief=None if self._start_std is None else BeliefModel(start_std=self._start_std),
            odometry=self._odometry,
        )

    def _planned(
        self, todo: dict[str, tuple[Building, Task]], margin: float
    ) -> dict[str, Floats | None]:
        from ambinav_planners.seeded import call_seeded

        robots: dict[str, RoutePlanner] = {}
        requests: dict[str, _PathRequest | None] = {}
        for key, (building, task) in todo.items():
            if building.key not in robots:
                robots[building.key] = self._robot(building, margin)
            requests[key] = _path_request(building, task, robots[building.key])
        paths_by_key: dict[str, Floats | None] = dict.fromkeys(requests)
        keys = [key for key, item in requests.items() if item is not None]
        for low in range(0, len(keys), GROUP):
            group = keys[low : low + GROUP]
            chosen = [item for key in group if (item := requests[key]) is not None]
            seed = self.choice.seed if self._planner.uses_ompl else None
            problems = [item.problem for item in chosen]
            paths = call_seeded(seed, plan_all, self.choice, problems)
            for key, item, path in zip(group, chosen, paths, strict=True):
                if path is not None:
                    # Save at once, so that an interruption does not lose it.
                    paths_by_key[key] = self._routes[key] = item.with_ends(path)
        return paths_by_key

    def save(self, path: Path) -> None:
        """Write the routes to a file atomically."""
        none = np.empty((0, 3))
        write_arrays(path, {key: none if p is None else p for key, p in self._routes.items()})

    def load(self, path: Path) -> None:
        """Read the routes that `save` wrote; ignore a missing or damaged file."""
        arrays = read_arrays(path) or {}
        self._routes |= {key: poses if len(poses) else None for key, poses in arrays.items()}


def _key(building: Building, task: Task) -> str:
    """Return building, start and goal as one string."""
    ends = np.concatenate([task.start, task.goal]).astype(np.float64)
    return f"{building.key}-{ends.tobytes().hex()}"


@dataclass(frozen=True, eq=False)
class _PathRequest:
    """A planning problem between the points nearest to start and goal with enough clearance.

    Attributes:
        problem: For the planner.
        start: The true start, shape (3,).
        goal: The true goal, shape (3,).
    """

    problem: Problem
    start: Floats
    goal: Floats

    def with_ends(self, path: Floats) -> Floats:
        """Return the path from the true start to the true goal."""
        return np.vstack([self.start, path, self.goal])


def _path_request(building: Building, task: Task, robot: RoutePlanner) -> _PathRequest | None:
    """Build the planning problem of a task; None if an end lacks clearance for the margin."""
    start, goal = np.asarray(task.start), np.append(task.goal, 0.0)
    ends = []
    for pose in (start, goal):
        near = robot.checker.nearest_free(*pose.tolist())
        if near is None:
            return None
        end = np.array(near[:3])
        # The nearest point may be beyond a wall.
        if near[3] > 0.0 and not building.checker.motions_free(pose[None], end[None])[0]:
            return None
        ends.append(end.tolist())
    return _PathRequest(robot.problem(*ends), start, goal)


def plan_all(choice: PlannerChoice, problems: Sequence[Problem]) -> list[Floats | None]:
    """Return waypoints of a route for each problem, or None; the result is deterministic.

    Args:
        choice: The planner. One that uses OMPL must be called by `call_seeded`.
        problems: The planning problems.
    """
    from ambinav_planners.improve.finishing import finish
    from ambinav_planners.registry import planner

    chosen = planner(choice.planner)
    paths: list[Floats | None] = []
    for problem in problems:
        result = _find_path(chosen, choice, problem)
        paths.append(None if result is None else finish(chosen, problem, result, choice.seed).poses)
    return paths


def _find_path(chosen: Planner, choice: PlannerChoice, problem: Problem) -> PlannerResult | None:
    """Search for a free path; search longer if the lattice has one."""
    from ambinav_planners.improve.finishing import is_free
    from ambinav_planners.planning import run
    from ambinav_planners.registry import Budget, check_suits
    from ambinav_planners.search.reachability import NoPathError, check_reachable

    counts = chosen.uses_ompl and bool(chosen.iteration) and choice.iterations is not None
    for factor in PATIENCE if counts else PATIENCE[:1]:
        iterations = factor * choice.iterations if counts and choice.iterations else None
        budget = Budget(math.inf, iterations, choice.seed)
        check_suits(chosen, problem, budget)
        result = run(chosen.name, problem, budget)
        if result.poses is not None and is_free(result.poses, problem):
            return result
        try:
            check_reachable(problem)
        except NoPathError:
            return None
    return None
