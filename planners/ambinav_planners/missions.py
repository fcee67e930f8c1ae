"""Missions: routes over stops, in the order given or the cheapest one, to the best of some goals.

The order, and the goal, are chosen by the costs of the cheapest paths over the map's lattice
between all of them (`search.cheapest_cycle`); then each leg is planned as any route is, and the
route of the mission is measured anew. Long legs that were improved cost up to 1.3 % less than the
paths that the order was chosen by, short ones a few percent, so that of orders that cost about as
much the cheapest may be another; a limit on bad metres in a row is kept by the route, but plays no
part in the choice.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.csgraph import dijkstra

from ambinav.config import check_kind
from ambinav.routes.evaluate import join_routes
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats, Pose
from ambinav.runtime.errors import InputError
from ambinav_planners.one_way import legal_part
from ambinav_planners.planning import NotFoundError, RoutePlanner
from ambinav_planners.problem import check_pose
from ambinav_planners.search.cheapest_cycle import cheapest_cycle
from ambinav_planners.search.lattice_graph import lattice_of
from ambinav_planners.search.reachability import check_reachable

Place = Sequence[float]

MOST_STOPS = 30
"""Stops whose order may be chosen."""


@dataclass(frozen=True)
class Mission:
    """Places to visit: x, y (metres) and, if it matters, theta (radians), map frame.

    Attributes:
        start: Where the robot starts.
        goals: Where it may end; the cheapest is chosen.
        via: Stops on the way.
        any_order: True: the stops are visited in the cheapest order; else in that given.

    Raises:
        InputError: there is no goal.
    """

    start: Place
    goals: tuple[Place, ...]
    via: tuple[Place, ...] = ()
    any_order: bool = False

    def __post_init__(self) -> None:
        """Check that there is somewhere to go."""
        if not self.goals:
            raise InputError("goals is empty; give at least one, which may be the start.")


@dataclass(frozen=True, eq=False)
class MissionRoute:
    """Planned mission.

    Attributes:
        route: The route over all stops.
        legs: Its parts, from stop to stop.
        order: Indices of `Mission.via` in the order in which they are visited.
        goal: Index of the goal in `Mission.goals`.
        arrivals: Metres along the route at each stop, in the order of `order`.
        gap: By how much the order may cost more than the cheapest, as a share of its cost over
            the lattice: 0 where it is the cheapest, and where there was nothing to choose.
    """

    route: Route
    legs: tuple[Route, ...]
    order: tuple[int, ...]
    goal: int
    arrivals: tuple[float, ...]
    gap: float


def plan_mission(
    robot: RoutePlanner,
    mission: Mission,
    *,
    planner_name: str | None = None,
    weight: float | None = None,
    seconds: float = 1.0,
    iterations: int | None = None,
    seed: int | None = None,
    improved: bool = True,
) -> MissionRoute:
    """Plan a mission.

    Args:
        robot: The robot and its cost service.
        mission: The places to visit.
        planner_name: See `RoutePlanner.plan`, as the other arguments; time and iterations are those
            of each leg.
        weight: See there.
        seconds: See there.
        iterations: See there.
        seed: See there.
        improved: See there.

    Raises:
        NoPathError: no path leads from one stop to the next.
        NotFoundError: a planner found none in its time, or the whole route breaks the limit on bad
            metres in a row, which its legs keep.
        InputError: the robot does not fit at a stop, or there is a choice and the robot is no disc
            in r2, or more than `MOST_STOPS` stops.
    """
    check_kind(robot, RoutePlanner, "robot")
    check_kind(mission, Mission, "mission")
    checker = robot.checker
    start = check_pose("start", mission.start, checker)
    stops = [check_pose(f"via[{k}]", stop, checker) for k, stop in enumerate(mission.via)]
    names = (
        ["goal"] if len(mission.goals) == 1 else [f"goals[{k}]" for k in range(len(mission.goals))]
    )
    goals = [
        check_pose(name, goal, checker) for name, goal in zip(names, mission.goals, strict=True)
    ]
    order, goal, gap = tuple(range(len(stops))), 0, 0.0
    if len(goals) > 1 or (mission.any_order and len(stops) > 1):
        order, goal, gap = _chosen(robot, mission, start, stops, goals, weight)
    places = [mission.start, *(mission.via[k] for k in order), mission.goals[goal]]
    legs: list[Route] = []
    for leg_start, leg_goal in itertools.pairwise(places):
        leg = _at(robot, legs, is_last=len(legs) == len(places) - 2).plan(
            leg_start, leg_goal,
            planner_name=planner_name, weight=weight, seconds=seconds, iterations=iterations,
            seed=seed, improved=improved,
        )  # fmt: skip
        legs.append(leg)
    service = robot.service if weight is None else robot.service.with_weight(weight)
    if len(legs) == 1:
        return MissionRoute(legs[0], tuple(legs), order, goal, (), gap)
    route, limit = join_routes(service, legs), robot.limit
    if limit is not None and not limit.kept_by(route.poses, service, checker.steering):
        raise NotFoundError(
            f"each leg keeps to {limit.metres:g} m above level {limit.level:g} in a row, but not "
            "the route over the stops; allow more, or move the stops off bad floor."
        )
    arrivals = np.cumsum([leg.length for leg in legs])[:-1]
    return MissionRoute(route, tuple(legs), order, goal, tuple(arrivals.tolist()), gap)


def _at(robot: RoutePlanner, legs: Sequence[Route], *, is_last: bool) -> RoutePlanner:
    """Return the robot at the end of some legs: as sure of its pose as the last one leaves it.

    The limit of belief planners at the goal is that of the last leg.
    """
    adapted = copy.copy(robot)
    if not is_last:
        adapted.belief = replace(adapted.belief, max_goal_std=math.inf)
    if legs and legs[-1].covariances is not None:
        x, y, theta = np.sqrt(np.diagonal(legs[-1].covariances[-1])).tolist()
        adapted.belief = replace(adapted.belief, start_std=(x, y, theta))
    return adapted


def _chosen(
    robot: RoutePlanner,
    mission: Mission,
    start: Pose,
    stops: list[Pose],
    goals: list[Pose],
    weight: float | None,
) -> tuple[tuple[int, ...], int, float]:
    """Return the order of the stops, the goal, and the gap."""
    checker = robot.checker
    if checker.steering.space != "r2" or not checker.footprint.is_disc:
        raise InputError(
            "the order of stops, and one of several goals, are chosen over the lattice, for a disc "
            "in r2; give the stops in order and one goal."
        )
    if mission.any_order and len(stops) > MOST_STOPS:
        raise InputError(
            f"via has {len(stops)} stops, and the order of at most {MOST_STOPS} is chosen; give "
            "fewer, or the order."
        )
    cost = _costs_between(robot, [start, *stops, *goals], weight)
    count = len(stops)
    ends = cost[:, count + 1 :]
    for k, stop in enumerate(stops, start=1):
        if not math.isfinite(cost[0, k]):
            check_reachable(robot.problem(start, stop, weight))
    if not np.isfinite(ends[0]).any():
        check_reachable(robot.problem(start, goals[0], weight))
    if not mission.any_order:
        return tuple(range(count)), int(np.argmin(ends[count])), 0.0
    # Nodes are the start, the stops and the end, which is the cheapest goal from wherever.
    nodes = np.full((count + 2, count + 2), math.inf)
    nodes[: count + 1, 1 : count + 1] = cost[: count + 1, 1 : count + 1]
    nodes[: count + 1, count + 1] = ends[: count + 1].min(axis=1)
    nodes[count + 1, 0] = 0.0
    if count:
        nodes[0, count + 1] = math.inf
    cycle = cheapest_cycle(nodes)
    if cycle is None:
        raise NotFoundError("no order of the stops leads over all of them to a goal.")
    order = tuple(node - 1 for node in cycle.order[1 : count + 1])
    goal = int(np.argmin(ends[order[-1] + 1 if order else 0]))
    return order, goal, (cycle.cost - cycle.bound) / cycle.cost if cycle.cost > 0.0 else 0.0


def _costs_between(robot: RoutePlanner, places: list[Pose], weight: float | None) -> Floats:
    """Return the costs of the cheapest paths between places over lattice or graph, (K, K)."""
    service = robot.service if weight is None else robot.service.with_weight(weight)
    if robot.priced_graph is not None:
        return robot.priced_graph.costs_between(places, service.weight)
    lattice = lattice_of(service, robot.checker)
    graph = lattice.with_ends(np.array(places), robot.checker)
    if robot.one_way is not None:
        graph = legal_part(graph, robot.one_way)
    nodes = np.arange(len(graph.poses) - len(places), len(graph.poses))
    # scipy takes an explicit zero for no edge.
    costs = graph.matrix(np.maximum(graph.cost(service.weight), 1e-12))
    return np.asarray(dijkstra(costs, indices=nodes)[:, nodes], dtype=np.float64)
