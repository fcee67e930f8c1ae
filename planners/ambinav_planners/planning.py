"""Planning of routes: set up robot, cost and building once, then plan any start and goal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from shapely.geometry.base import BaseGeometry

from ambinav.config import check_kind
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.graph_pricing import PricedGraph
from ambinav_planners.improve.finishing import finish, is_free, not_found, warm_up
from ambinav_planners.one_way import OneWayLanes
from ambinav_planners.problem import Problem, check_pose, make_checker
from ambinav_planners.registry import PLANNERS, Budget, Planner, PlannerResult, check_suits, planner
from ambinav_planners.route_graph import RouteGraph
from ambinav_planners.search.limit import BadStretchLimit
from ambinav_planners.search.lower_bound import quick_lower_bound
from ambinav_planners.search.reachability import check_reachable
from ambinav_planners.seeded import call_seeded

DEFAULT_RADIUS = 0.2
# Part of the time that is kept for improving what the planner found, and at most so many seconds.
IMPROVING_SHARE, IMPROVING_MOST = 0.15, 0.3
# A goal this near to the start, metres and radians, counts as reached.
SAME_PLACE = 1e-6
AUTO = "auto"
"""Name that stands for `default_planner`'s."""
# The largest turning radius, as so many times the building's larger side: above it a car cannot
# turn anywhere.
LARGEST_RADIUS = 10.0


class NotFoundError(InputError):
    """A planner found no path in its time, though the lattice does not rule one out.

    Attributes:
        bound: Proven lower bound of what a route would cost, metres-equivalent; 0: none is known.
    """

    def __init__(self, message: str, bound: float = 0.0) -> None:
        """Create the error from its message and the bound."""
        super().__init__(message)
        self.bound = bound


class RoutePlanner:
    """Plans routes for one robot in one building.

    Args:
        service_or_map: Service for the cost, or a map, whose `cost_layer` is then used at weight 5.
        footprint: The robot's outline, or the radius of a disc in metres.
        space: r2 (straight lines, no heading), se2 (straight lines along which the heading turns),
            dubins (a car that drives forwards) or reeds-shepp (one that also backs up).
        turning_radius: Turning radius of the car, metres; for dubins and reeds-shepp only.
        avoid_open: True: the open zone is excluded.
        keep_out: Polygons that the reference point keeps out of, map frame, metres: the cells that
            meet them are excluded.
        max_bad_metres: Longest stretch allowed above `bad_level`, metres; None: no limit.
        bad_level: Level above which floor is bad, for `max_bad_metres`.
        belief: Assumptions of the belief planners about the robot: its deviation at the start,
            its scans and the limits of its deviation; the weight in it is replaced by the plan's.
            None for the defaults.
        odometry: Odometry errors of the robot, for the same planners; biases are not included. None
            for the default.
        one_way: Lanes that routes drive in one direction only; for the planner reference.
        route_graph: Routes follow the edges of this graph; None: they lead over all free floor.

    Raises:
        InputError: a value that cannot be used.

    Attributes:
        service: Service for the cost per metre.
        checker: Collision checker of the robot, with its kind of motion.
        limit: The limit on bad metres in a row, or None.
        belief: See above.
        odometry: See above.
        one_way: See above.
        priced_graph: The route graph with what its edges cost this robot, or None.
    """

    def __init__(
        self,
        service_or_map: AmbiguityService | AmbiguityMap,
        *,
        footprint: Footprint | float = DEFAULT_RADIUS,
        space: str = "r2",
        turning_radius: float = 0.0,
        avoid_open: bool = False,
        keep_out: BaseGeometry | None = None,
        max_bad_metres: float | None = None,
        bad_level: float = 0.5,
        belief: BeliefModel | None = None,
        odometry: OdometryNoise | None = None,
        one_way: OneWayLanes | None = None,
        route_graph: RouteGraph | None = None,
    ) -> None:
        for name, value, kind in (
            ("belief", belief, BeliefModel), ("odometry", odometry, OdometryNoise),
            ("one_way", one_way, OneWayLanes), ("route_graph", route_graph, RouteGraph),
        ):  # fmt: skip
            if value is not None:
                check_kind(value, kind, name)
        check_kind(service_or_map, (AmbiguityService, AmbiguityMap), "service_or_map")
        self.belief = BeliefModel() if belief is None else belief
        self.odometry = OdometryNoise() if odometry is None else odometry
        self.service = (
            AmbiguityService(service_or_map)
            if isinstance(service_or_map, AmbiguityMap)
            else service_or_map
        )
        is_number = isinstance(footprint, int | float | np.number)
        if isinstance(footprint, bool) or not (is_number or isinstance(footprint, Footprint)):
            raise InputError(
                f"footprint is {footprint!r}; give a radius in metres, or Footprint.polygon(...)."
            )
        outline = (
            footprint if isinstance(footprint, Footprint) else Footprint.disc(float(footprint))
        )
        self.limit = None if max_bad_metres is None else BadStretchLimit(max_bad_metres, bad_level)
        xmin, ymin, xmax, ymax = self.service.map.bounds
        largest = LARGEST_RADIUS * max(xmax - xmin, ymax - ymin)
        if turning_radius > largest:
            raise InputError(
                f"turning_radius is {turning_radius:g} m, far more than the building; give less "
                f"than {largest:.0f}."
            )
        self.checker = make_checker(
            self.service, outline, Steering(space, turning_radius), avoid_open=avoid_open,
            keep_out=keep_out,
        )  # fmt: skip
        self.one_way = one_way
        self.priced_graph = (
            None if route_graph is None else PricedGraph.of(route_graph, self.service, self.checker)
        )

    def __repr__(self) -> str:
        """Return map, space and cost as text."""
        steering, service = self.checker.steering, self.service
        return (
            f"RoutePlanner({service.map.source}, space {steering.space}, layer {service.layer}, "
            f"weight {service.weight:g})"
        )

    def problem(
        self, start: Sequence[float], goal: Sequence[float], weight: float | None = None
    ) -> Problem:
        """Create a problem from a start and a goal, checked.

        Raises:
            InputError: the robot does not fit at one of them, or the weight is no weight.
        """
        service = self.service if weight is None else self.service.with_weight(weight)
        return Problem(
            service,
            self.checker,
            check_pose("start", start, self.checker),
            check_pose("goal", goal, self.checker),
            self.limit,
            self.belief,
            self.odometry,
            self.one_way,
        )

    def plan(
        self,
        start: Sequence[float],
        goal: Sequence[float],
        *,
        planner_name: str | None = None,
        weight: float | None = None,
        seconds: float = 1.0,
        iterations: int | None = None,
        seed: int | None = None,
        improved: bool = True,
        on_route: Callable[[Route], object] | None = None,
    ) -> Route:
        """Plan one route.

        Args:
            start: x, y and, if it matters, theta; map frame, metres and radians.
            goal: As `start`.
            planner_name: See `ambinav_planners.planners()`; None or auto: `default_planner`'s.
            weight: Extra cost of a metre where the layer is 1, in metres; None: the service's.
            seconds: Time for planning and improving; inf needs `iterations`.
            iterations: Budget of the planner in its own iterations; None for no limit.
            seed: Seed, 0 or more. With a seed and iterations (unless the time limit ends planning
                first) the route is always the same.
            improved: True: shorten and smooth the route of the planner; its cost never rises.
            on_route: Called with each cheaper route on the way to the result: by all planners while
                they improve what they have found; before that by `reference`, without a limit and
                lanes, with a first one found at once and then with that of the lattice.

        Returns:
            The route; its cost is the same integral that the planner minimised.

        Raises:
            NoPathError: no path leads from start to goal.
            NotFoundError: the planner found none in its time.
            InputError: another argument is invalid; the message gives its name and the reason.
        """
        graph = self.priced_graph
        if graph is not None and planner_name not in (None, AUTO):
            raise InputError(
                f"planner is {planner_name!r}, which does not follow a route graph; leave it out."
            )
        name = planner_name_or_default(
            planner_name, self.checker, iterations, keeps_lanes=self.one_way is not None
        )
        chosen = planner(name) if graph is None else graph.planner
        problem = self.problem(start, goal, weight)
        on_path = None if on_route is None else _reports(problem, chosen.name, seed, on_route)
        budget = Budget(seconds, iterations, seed, on_path)
        check_suits(chosen, problem, budget)
        if _is_there(problem) or _turns_on_the_spot(problem):
            result = PlannerResult(problem.ends, iterations=0, finished=True)
            return finish(chosen, problem, result, seed)
        if graph is None:
            seeded = seed if chosen.uses_ompl else None
            # OMPL's run with a seed may be in another process: their paths come back when it ends.
            shared = replace(budget, on_path=None) if chosen.uses_ompl else budget
            result = call_seeded(seeded, run, chosen.name, problem, _share(shared, improved))
        else:
            result = chosen.solve(problem, budget)
        if result.poses is None:
            check_reachable(problem)
            if graph is not None:
                raise NotFoundError(graph.why_not(problem))
            raise not_found_error(chosen, problem, budget)
        if not is_free(result.poses, problem):
            raise NotFoundError(
                f"planner {chosen.name!r} found only a path that touches a wall; give it more "
                "time, or another planner."
            )
        return finish(chosen, problem, result, seed, improved=improved, on_path=on_path)


def not_found_error(chosen: Planner, problem: Problem, budget: Budget) -> NotFoundError:
    """Return the error of a planner that found no path, with a bound of what one would cost.

    Planners that look for something else than the least cost get none.
    """
    message = not_found(chosen, problem, budget)
    if not chosen.minimises_cost:
        return NotFoundError(message)
    bound = quick_lower_bound(problem)
    return NotFoundError(f"{message} No route costs less than {bound:.2f}.", bound)


def default_planner(
    checker: CollisionChecker, iterations: int | None = None, *, keeps_lanes: bool = False
) -> str:
    """Return the planner used when none is named, or `AUTO`.

    The lattice reference for a disc that moves in straight lines: on maps of every size, with and
    without a limit of bad metres, none was cheaper (`benchmarks/results/planners.md`). PRM* for all
    other robots, where no other was cheaper more often than dearer by more than chance, and where a
    number of iterations is given. One-way lanes are kept by the reference alone.
    """
    simple = checker.footprint.is_disc and iterations is None
    is_reference = checker.steering.space == "r2" and (simple or keeps_lanes)
    return "reference" if is_reference else "prmstar"


def planner_name_or_default(
    name: str | None,
    checker: CollisionChecker,
    iterations: int | None = None,
    *,
    keeps_lanes: bool = False,
) -> str:
    """Return a planner's name; for None and `AUTO` that of `default_planner`."""
    if name is not None and name != AUTO:
        return name
    return default_planner(checker, iterations, keeps_lanes=keeps_lanes)


def plan(
    service_or_map: AmbiguityService | AmbiguityMap,
    start: Sequence[float],
    goal: Sequence[float],
    *,
    planner: str | None = None,
    weight: float | None = None,
    seconds: float = 1.0,
    iterations: int | None = None,
    seed: int | None = None,
    footprint: Footprint | float = DEFAULT_RADIUS,
    space: str = "r2",
    turning_radius: float = 0.0,
    avoid_open: bool = False,
    keep_out: BaseGeometry | None = None,
    max_bad_metres: float | None = None,
    bad_level: float = 0.5,
    improved: bool = True,
) -> Route:
    """Plan one route; see `RoutePlanner` and its `plan` for arguments and errors.

    To plan several routes in a building, use a `RoutePlanner`.
    """
    robot = RoutePlanner(
        service_or_map,
        footprint=footprint,
        space=space,
        turning_radius=turning_radius,
        avoid_open=avoid_open,
        keep_out=keep_out,
        max_bad_metres=max_bad_metres,
        bad_level=bad_level,
    )
    return robot.plan(
        start,
        goal,
        planner_name=planner,
        weight=weight,
        seconds=seconds,
        iterations=iterations,
        seed=seed,
        improved=improved,
    )


def run(name: str, problem: Problem, budget: Budget) -> PlannerResult:
    """Solve a problem with the named planner, without improving the result."""
    chosen = planner(name)
    warm_up(problem)
    started = time.perf_counter()
    with PLANNERS.calling(name):
        result = chosen.solve(problem, budget)
        if not isinstance(result, PlannerResult):
            raise TypeError(f"it is not a PlannerResult but {result!r}")
    return replace(result, seconds=time.perf_counter() - started)


def _reports(
    problem: Problem, name: str, seed: int | None, on_route: Callable[[Route], object]
) -> Callable[[Floats], None]:
    """Return a function that measures a path and calls another with it if it is cheaper."""
    started, best = time.perf_counter(), math.inf

    def report(poses: Floats) -> None:
        nonlocal best
        route = evaluate_route(
            problem.service, poses, problem.steering, planner=name, seed=seed,
            seconds=time.perf_counter() - started,
        )  # fmt: skip
        if route.cost < best:
            best = route.cost
            on_route(route)

    return report


def _share(budget: Budget, improved: bool) -> Budget:
    """Return the planner's part of a budget, so that the improvement fits into the remainder."""
    if not improved or math.isinf(budget.seconds):
        return budget
    improving_seconds = min(IMPROVING_SHARE * budget.seconds, IMPROVING_MOST)
    return replace(budget, seconds=budget.seconds - improving_seconds)


def _turns_on_the_spot(problem: Problem) -> bool:
    """Return whether all that there is to do is a free turn, in which nothing can be shorter."""
    (x0, y0, _), (x1, y1, _) = problem.start, problem.goal
    near = problem.steering.space == "se2" and math.hypot(x1 - x0, y1 - y0) <= SAME_PLACE
    return near and is_free(problem.ends, problem)


def _is_there(problem: Problem) -> bool:
    """Return whether OMPL takes the start for the goal."""
    (x0, y0, t0), (x1, y1, t1) = problem.start, problem.goal
    turn = 0.0 if problem.steering.space == "r2" else math.remainder(t1 - t0, 2.0 * math.pi)
    return math.hypot(x1 - x0, y1 - y0) + abs(turn) <= SAME_PLACE
