"""Replanning: new routes to one goal, after a move, with new obstacles, or at new costs."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.improve.finishing import finish, is_free
from ambinav_planners.improve.route import improve
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.problem import Problem, cells_met, check_pose
from ambinav_planners.registry import Budget, planner
from ambinav_planners.search.costs_to_go import CostsToGo
from ambinav_planners.search.lattice_graph import REACH, lattice_of
from ambinav_planners.search.lattice_motions import STEPS
from ambinav_planners.search.reachability import NoPathError, check_reachable

NAME = "replanner"
# Longest motion of the lattice, spacings.
LONGEST = float(np.hypot(*STEPS.T).max())
# Routes this near to each other, metres, are the same.
SAME = 0.3
# The least cost per metre is taken by so much lower, against rounding.
BELOW = 1.0 - 1e-6
# A path over the lattice that costs so many times what is expected is not taken before a plan from
# nothing: the lattice is that of the bare building, and may miss what is left beside obstacles.
DEARER = 1.2
# So many metres farther on than the robot, the last route is taken up again.
AHEAD = (0.0, 0.5, 1.0, 2.0)


@dataclass(frozen=True, eq=False)
class Replan:
    """New route, and how it differs from the last one.

    Attributes:
        route: From the robot to the goal.
        is_new: False if it goes on along the last route.
        sentence: What is new, in words.
        seconds: Time that it took.
    """

    route: Route
    is_new: bool
    sentence: str
    seconds: float


class Replanner:
    """Plans routes to one goal repeatedly, and reuses earlier results.

    It holds the cost to go from every cell of the map's lattice. After a move nothing is searched;
    after a change only cells whose cheapest way it concerns (`search.costs_to_go`). The robot
    stays on its last route as long as that is free and costs no more than the lattice's new path.

    Args:
        robot: A disc in r2, without a limit on bad metres, lanes or a route graph.
        goal: x, y, metres, map frame.
        weight: See `RoutePlanner.plan`.

    Raises:
        InputError: the robot is another, or does not fit at the goal.

    Attributes:
        route: The last route; None before the first plan.
    """

    def __init__(
        self, robot: RoutePlanner, goal: Sequence[float], *, weight: float | None = None
    ) -> None:
        checker = robot.checker
        for reason, holds in (
            (
                "is not a disc in r2",
                checker.steering.space != "r2" or not checker.footprint.is_disc,
            ),
            ("has a limit on bad metres", robot.limit is not None),
            ("has one-way lanes", robot.one_way is not None),
            ("follows a route graph", robot.priced_graph is not None),
        ):
            if holds:
                raise InputError(f"robot {reason}; a Replanner is for a disc in r2 without these.")
        place = check_pose("goal", goal, checker)
        self._problem = robot.problem(place, place, weight)
        lattice = lattice_of(self._problem.service, checker)
        self._graph = lattice.with_ends(np.array([self._problem.goal]), checker)
        self._source = self._graph.source
        poses, density = self._graph.poses, self._problem.service.density
        # Row and column of the nodes' cells.
        self._cells = tuple(
            np.rint((poses[:, axis] - density.origin[axis]) / density.spacing)
            .astype(np.intp)
            .clip(0, density.free.shape[1 - axis] - 1)
            for axis in (1, 0)
        )
        # The goal is joined to cells farther away than a motion of the lattice leads.
        self._into_goal = np.flatnonzero(self._graph.target == len(poses) - 1)
        self._free_cost = self._graph.cost(self._problem.service.weight)
        self._costs = CostsToGo(self._graph, self._free_cost.copy(), len(self._graph.poses) - 1)
        self._robot = checker
        self._forbidden = _forbidden(self._problem)
        self.route: Route | None = None

    def replan(
        self,
        pose: Sequence[float],
        *,
        obstacles: BaseGeometry | None = None,
        changed: AmbiguityMap | None = None,
    ) -> Replan:
        """Plan from where the robot is now.

        Args:
            pose: x, y, metres, map frame.
            obstacles: All obstacles that the map does not have, map frame, metres; None: those of
                the last call. The robot keeps its radius away from them, to a cell of the map.
            changed: Map whose layer the costs are taken from now on, on the same lattice, such as
                `AmbiguityMap.update` makes; None: as before. Its walls are not looked at.

        Raises:
            NoPathError: the obstacles leave no path.
            InputError: the robot does not fit at the pose, or the map has another lattice.
        """
        started = time.perf_counter()
        why = []
        if changed is not None and self._change_costs(changed):
            why.append("costs changed")
        if obstacles is not None and self._change_obstacles(obstacles):
            why.append("obstacles changed")
        checker, service = self._problem.checker, self._problem.service
        start = check_pose("pose", pose, self._robot)
        if not checker.poses_free([start])[0]:
            raise InputError(
                f"pose ({start[0]:g}, {start[1]:g}) is nearer to one of the obstacles than the "
                f"robot's radius, {checker.footprint.outer:g} m; leave out what is the robot "
                "itself, or drive away from it first."
            )
        problem = replace(self._problem, start=start)
        path, cost = self._lattice_path(problem)
        last = self.route
        rest_of_last = None if last is None else self._rest_of(last, problem)
        if rest_of_last is not None and service.route_cost(rest_of_last, checker.steering) <= cost:
            poses, is_new = rest_of_last, False
        else:
            poses, is_new = self._new_poses(problem, path, cost), True
        seconds = time.perf_counter() - started
        self.route = evaluate_route(service, poses, checker.steering, planner=NAME, seconds=seconds)
        sentence = _difference(last, self.route, is_new, why)
        return Replan(self.route, is_new, sentence, time.perf_counter() - started)

    def _new_poses(self, problem: Problem, path: Floats | None, cost: float) -> Floats:
        """Return the poses of a new route: the improved path, or a plan from scratch.

        Args:
            problem: From the robot to the goal, past the obstacles.
            path: The lattice's path, see `_lattice_path`.
            cost: Its cost.

        Raises:
            NoPathError: nothing is found.
        """
        service, checker = problem.service, problem.checker
        poses = None if path is None else improve(path, service, checker)
        is_bare = checker is self._robot
        if poses is not None and (is_bare or cost <= DEARER * self._expected(problem)):
            return poses
        if is_bare:
            raise self._no_path(problem)
        reference = planner("reference")
        result = reference.solve(problem, Budget(seconds=math.inf))
        if result.poses is None and poses is None:
            raise self._no_path(problem)
        candidates = [] if poses is None else [poses]
        if result.poses is not None:
            candidates.append(finish(reference, problem, result, None).poses)
        return min(candidates, key=lambda each: service.route_cost(each, problem.steering))

    def _expected(self, problem: Problem) -> float:
        """Return the cost of the remaining last route, ignoring obstacles; 0 without one."""
        if self.route is None:
            return 0.0
        x, y, _ = problem.start
        poses = _onward(self.route, self.route.progress(x, y).along, problem)
        return problem.service.route_cost(poses, problem.steering)

    def _change_costs(self, amap: AmbiguityMap) -> bool:
        """Take costs from another map; return whether any changed."""
        if not isinstance(amap, AmbiguityMap):
            raise InputError(f"changed is {amap!r}; give an AmbiguityMap.")
        old = self._problem.service
        new = AmbiguityService(
            amap, old.layer, old.weight, power=old.power,
            clearance_weight=old.clearance_weight, comfort=old.comfort,
            preferred=old.preferred, outside_weight=old.outside_weight,
        )  # fmt: skip
        before, after = old.density, new.density
        if after.values.shape != before.values.shape or (
            (*after.origin, after.spacing) != (*before.origin, before.spacing)
        ):
            raise InputError("changed: the map has another lattice; make a new Replanner for it.")
        cells = (after.values != before.values).any(axis=2)
        self._problem = replace(self._problem, service=new)
        if not cells.any():
            return False
        motions = self._motions_near(cells)
        a, b = (self._graph.poses[end[motions]] for end in (self._source, self._graph.target))
        self._free_cost[motions] = new.motion_costs(a, b, self._graph.steering)
        self._update(motions)
        return True

    def _change_obstacles(self, obstacles: BaseGeometry) -> bool:
        """Forbid the cells near obstacles, and no others; return whether any changed."""
        service, radius = self._problem.service, self._robot.footprint.outer
        cells = cells_met(service.map, obstacles, "obstacles", radius) | self._forbidden
        changed = cells != _forbidden(self._problem)
        if not changed.any():
            return False
        robot = self._robot
        x, y = (float(service.map.dataset[axis].values[0]) for axis in "xy")
        checker = CollisionChecker(
            robot.environment, robot.footprint, robot.steering,
            forbidden=cells, origin=(x, y), spacing=service.map.spacing,
        )  # fmt: skip
        self._problem = replace(self._problem, checker=checker)
        self._update(self._motions_near(changed))
        return True

    def _update(self, motions: Indices) -> None:
        """Give motions the cost that they have now: inf where they are blocked."""
        a, b = (self._graph.poses[end[motions]] for end in (self._source, self._graph.target))
        checker = self._problem.checker
        free = checker.poses_free(a) & checker.poses_free(b)
        free[free] = checker.motions_free(a[free], b[free])
        self._costs.change(motions, np.where(free, self._free_cost[motions], math.inf))

    def _motions_near(self, cells: Bools) -> Indices:
        """Return the motions that may meet any of some cells."""
        from scipy.ndimage import binary_dilation

        reach = math.ceil(LONGEST + 1.0)
        rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
        window = tuple(slice(max(at[0] - reach, 0), at[-1] + reach + 1) for at in (rows, columns))
        around = np.zeros_like(cells)
        around[window] = binary_dilation(cells[window], np.ones((2 * reach + 1,) * 2, dtype=bool))
        nodes = np.flatnonzero(around[self._cells])
        first = self._graph.first
        count = first[nodes + 1] - first[nodes]
        offset = np.repeat(first[nodes] - np.cumsum(count) + count, count)
        return np.unique(np.concatenate([offset + np.arange(count.sum()), self._into_goal]))

    def _lattice_path(self, problem: Problem) -> tuple[Floats | None, float]:
        """Return the poses of the cheapest path over the lattice, and its cost; None, inf: none."""
        start, poses = np.array(problem.start), self._graph.poses
        away = np.hypot(*(poses[:, :2] - start[:2]).T)
        service, steering = problem.service, problem.steering
        least = BELOW * float(service.density.values.min())
        for reach in REACH:
            near = np.flatnonzero(away <= reach)
            origin = np.broadcast_to(start, (len(near), 3)).copy()
            near = near[problem.checker.motions_free(origin, poses[near])]
            origin = np.broadcast_to(start, (len(near), 3)).copy()
            cost = service.motion_costs(origin, poses[near], steering)
            self._costs.settle(near, cost, problem.start[:2], least)
            cost += self._costs.to_go[near]
            if np.isfinite(cost).any():
                k = int(cost.argmin())
                nodes = self._costs.path(int(near[k]))
                path = np.concatenate([start[np.newaxis], poses[nodes]])
                return steering.oriented(path), float(cost[k])
        return None, math.inf

    def _rest_of(self, last: Route, problem: Problem) -> Floats | None:
        """Return the rest of the last route from where the robot is; None: it is blocked."""
        x, y, _ = problem.start
        progress = last.progress(x, y)
        best = None
        for ahead in AHEAD:
            poses = _onward(last, progress.along + ahead, problem)
            if is_free(poses, problem):
                cost = problem.service.route_cost(poses, problem.steering)
                if best is None or cost < best[0]:
                    best = cost, poses
        return None if best is None else best[1]

    def _no_path(self, problem: Problem) -> NoPathError:
        """Return the error where the obstacles leave no path.

        Raises:
            NoPathError: the building itself leaves none, see `check_reachable`.
        """
        check_reachable(replace(problem, checker=self._robot))
        cell = lattice_of(problem.service, self._robot).cell
        labels = np.where(cell >= 0, np.isfinite(self._costs.to_go)[cell].astype(np.int32), -1)
        (x, y, _), (u, v, _) = problem.start, problem.goal
        return NoPathError(
            f"no path leads from ({x:.10g}, {y:.10g}) to the goal ({u:.10g}, {v:.10g}) past the "
            "obstacles; wait until one is gone, or choose another goal.",
            labels.astype(np.int32), 0, 1, problem.start, problem.goal,
        )  # fmt: skip


def _onward(route: Route, along: float, problem: Problem) -> Floats:
    """Return the poses from a problem's start to the part of a route beyond `along` metres."""
    k = int(np.searchsorted(route.distance, along, side="right"))
    poses = np.concatenate([[problem.start], route.poses[min(k, len(route.poses) - 1) :]])
    return problem.steering.oriented(poses)


def _forbidden(problem: Problem) -> Bools:
    """Return the cells of the map that are forbidden to the robot, (rows, columns)."""
    forbidden = problem.checker.arrays[2]
    return forbidden if forbidden.size else np.zeros_like(problem.service.density.free)


def _difference(last: Route | None, route: Route, is_new: bool, why: Sequence[str]) -> str:
    """Describe how a route differs from the last one."""
    ahead = f"{route.length:.1f} m to go, cost {route.cost:.1f}"
    if last is None:
        return f"First route: {ahead}."
    reason = f" ({' and '.join(why)})" if why else ""
    if not is_new:
        return f"Goes on along the last route{reason}: {ahead}."
    x, y, _ = route.start
    progress = last.progress(x, y)
    old = shapely.LineString(last.steering.dense(last.poses, SAME)[0][:, :2])
    points = route.steering.dense(route.poses, SAME)[0][:, :2]
    off = np.flatnonzero(shapely.distance(old, shapely.points(points)) > SAME)
    if not len(off):
        return f"Stays within {SAME:g} m of the last route{reason}: {ahead}."
    (x, y), extra = points[off[0]], route.length - progress.remaining
    return (
        f"Leaves the last route at ({x:.1f}, {y:.1f}){reason}: {ahead}, "
        f"{abs(extra):.1f} m {'longer' if extra >= 0.0 else 'shorter'} than what was left of it."
    )
