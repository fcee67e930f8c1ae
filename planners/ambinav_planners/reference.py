"""The yardstick: the cheapest way over the map's lattice, finished at any angle."""

from __future__ import annotations

import time
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.collision import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.steering import Steering
from ambinav.service.service import AmbiguityService
from ambinav_planners.graph import MotionGraph
from ambinav_planners.lattice_graph import LatticeGraph
from ambinav_planners.limited_search import limited_search
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Found, Planner, register
from ambinav_planners.stretches import bad_stretches


class NoWayError(InputError):
    """No way leads from start to goal.

    Attributes:
        labels: Which cells of the map hang together, int32, shape (rows, columns), -1 where the
            robot does not fit.
        start_label: Label of the cells that the start reaches.
        goal_label: Label of the cells from which the goal is reached.
    """

    def __init__(
        self, message: str, labels: NDArray[np.int32], start_label: int, goal_label: int
    ) -> None:
        super().__init__(message)
        self.labels = labels
        self.start_label = start_label
        self.goal_label = goal_label


# A lattice serves every start, goal and weight; it lives as long as its checker.
_lattices: WeakKeyDictionary[CollisionChecker, list[LatticeGraph]] = WeakKeyDictionary()
_planar: WeakKeyDictionary[CollisionChecker, CollisionChecker] = WeakKeyDictionary()


def lattice_of(service: AmbiguityService, checker: CollisionChecker) -> LatticeGraph:
    """The lattice graph of a service and checker, built once for all weights."""
    kept = _lattices.setdefault(checker, [])
    for lattice in kept:
        if _same_but_weight(lattice.service, service):
            return lattice
    kept.append(LatticeGraph.build(service, checker))
    return kept[-1]


def _same_but_weight(a: AmbiguityService, b: AmbiguityService) -> bool:
    return a.map is b.map and (a.layer, a.power, a.clearance_weight, a.comfort) == (
        b.layer,
        b.power,
        b.clearance_weight,
        b.comfort,
    )


def planar(checker: CollisionChecker) -> CollisionChecker:
    """A checker for straight motions in r2 of the largest disc within the footprint.

    Where that disc does not get through, the footprint does not either, whatever it does.
    """
    if checker.steering.space == "r2":
        return checker
    kept = _planar.get(checker)
    if kept is None:
        kept = CollisionChecker(
            checker.environment, Footprint.disc(checker.footprint.inner), Steering("r2")
        )
        _planar[checker] = kept
    return kept


def check_reachable(problem: Problem) -> None:
    """Raise if no way over the lattice leads from start to goal.

    Raises:
        NoWayError: there is none; the message says how much floor either end reaches.
    """
    checker = planar(problem.checker)
    lattice = lattice_of(problem.service, checker)
    graph = lattice.with_ends(problem.ends, checker)
    components = graph.components()
    start, goal = (int(label) for label in components[-2:])
    if start == goal:
        return
    labels = lattice.labels(components)
    cell = problem.service.map.spacing**2
    areas = [float((labels == label).sum()) * cell for label in (start, goal)]
    raise NoWayError(
        f"no way leads from the start {_place(problem.start)} to the goal {_place(problem.goal)} "
        f"for this robot: from the start it reaches {areas[0]:.1f} m^2, and the goal lies in "
        f"another part of {areas[1]:.1f} m^2; move one of them, or make the footprint smaller.",
        labels,
        start,
        goal,
    )


def cheapest_within(graph: MotionGraph, problem: Problem) -> NDArray[np.intp] | None:
    """Nodes of the cheapest way that keeps the problem's limit on bad metres in a row.

    Start and goal are the graph's last two nodes.
    """
    limit = problem.limit
    if limit is None:
        raise ValueError("the problem has no limit")
    stretches = bad_stretches(graph, problem.service.ambiguity, limit.level)
    count = len(graph.poses)
    way = limited_search(
        graph, graph.cost(problem.service.weight), stretches, limit.metres, count - 2, count - 1
    )
    return None if way is None else way.nodes


def _place(pose: tuple[float, float, float]) -> str:
    return f"({pose[0]:g}, {pose[1]:g})"


def cheapest_on(graph: MotionGraph, problem: Problem) -> NDArray[np.float64] | None:
    """Way points of the cheapest way between the graph's last two nodes, shape (N, 3), or None.

    It keeps the problem's limit, if there is one.
    """
    count = len(graph.poses)
    nodes = (
        graph.cheapest(count - 2, count - 1, problem.service.weight)
        if problem.limit is None
        else cheapest_within(graph, problem)
    )
    return None if nodes is None else graph.steering.oriented(graph.poses[nodes])


def solve_reference(problem: Problem, budget: Budget) -> Found:
    """Dijkstra on the lattice, whatever time it takes."""
    started = time.perf_counter()
    lattice = lattice_of(problem.service, problem.checker)
    poses = cheapest_on(lattice.with_ends(problem.ends, problem.checker), problem)
    if poses is None:
        return Found(None)
    cost = problem.service.route_cost(poses, problem.steering)
    return Found(poses, ((time.perf_counter() - started, cost),))


register(
    Planner(
        "reference",
        solve_reference,
        "Dijkstra over the map's lattice in 32 directions, finished at any angle",
        spaces=("r2",),
        uses_ompl=False,
        keeps_limit=True,
    )
)
