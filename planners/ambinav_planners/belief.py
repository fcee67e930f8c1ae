"""Routes that keep the robot localized: by a limit in a row, by belief search, by belief roadmap.

The searches know nodes and motions; here they become routes, measured like all others.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.errors import InputError
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.service.service import AmbiguityService
from ambinav_planners.belief_roadmap import BeliefRoadmap
from ambinav_planners.belief_search import BeliefModel, Growth, belief_search
from ambinav_planners.graph import MotionGraph
from ambinav_planners.information import Information
from ambinav_planners.labels import Way
from ambinav_planners.limited_search import limited_search
from ambinav_planners.roadmap_search import search_roadmap
from ambinav_planners.stretches import bad_stretches

Floats = NDArray[np.float64]

# On a lattice of 128 000 nodes and 3.8 M motions 0.02 takes 1.3 s and 0.1 takes 0.4 s, for costs
# that differ by 2e-6; on one of 14 000 nodes 0.02 takes 0.4 s and costs 2.5e-4 more than 0, which
# takes minutes: no two ways to a node leave exactly the same deviation.
TOLERANCE = 0.02
"""Share of the variance that the routes' searches take for no difference, unless told."""


def limited_route(
    service: AmbiguityService,
    graph: MotionGraph,
    start: int,
    goal: int,
    *,
    limit: float,
    level: float = 0.5,
) -> Route:
    """Cheapest route with at most `limit` metres in a row where the layer is above `level`.

    Args:
        service: The map, its layer and weight.
        graph: Free motions, measured by that service.
        start: A node of the graph.
        goal: A node of the graph.
        limit: Metres.
        level: In the layer's unit.

    Raises:
        InputError: an argument is out of range, or there is no such route.
    """
    begin = time.perf_counter()
    stretches = bad_stretches(graph, service.ambiguity, level)
    cost = graph.cost(service.weight)
    way = limited_search(graph, cost, stretches, limit, start, goal)
    if way is None:
        _refuse_unconnected(graph, start, goal)
        raise InputError(
            f"every way has more than {limit:g} m in a row with {service.layer} above {level:g}; "
            "allow more metres or a higher level."
        )
    return _route(service, graph, way, "limited", begin, None)


def belief_route(
    service: AmbiguityService,
    graph: MotionGraph,
    start: int,
    goal: int,
    model: BeliefModel,
    *,
    information: Information | None = None,
    tolerance: float = TOLERANCE,
) -> Route:
    """Route of least cost over places and standard deviations of the position.

    Its covariances are sigma^2 for x and y. The search keeps no heading: its variance is 0.

    Args:
        service: Measures the route; its weight plays no part in the search.
        graph: Free motions.
        start: A node of the graph.
        goal: A node of the graph.
        model: Odometry, scans, costs and limits.
        information: What a scan tells; None takes it from the service's map.
        tolerance: See `belief_search`.

    Raises:
        InputError: an argument is out of range, or there is no such route.
    """
    begin = time.perf_counter()
    told = Information.of(service.map) if information is None else information
    growth = Growth.of(graph, told, model)
    found = belief_search(graph, growth, model, start, goal, tolerance=tolerance)
    if found is None:
        _refuse_unconnected(graph, start, goal)
        raise InputError(
            f"no way keeps the standard deviation up to {model.max_std:g} m, and up to "
            f"{model.max_goal_std:g} m at the goal; allow a larger one."
        )
    covariances = np.zeros((len(found.std), 3, 3))
    covariances[:, 0, 0] = covariances[:, 1, 1] = found.std**2
    return _route(service, graph, found.way, "belief", begin, covariances)


def roadmap_route(
    service: AmbiguityService,
    roadmap: BeliefRoadmap,
    start: int,
    goal: int,
    covariance: ArrayLike,
    *,
    weight: float = 50.0,
    measure: str = "trace",
    max_std: float = np.inf,
    tolerance: float = TOLERANCE,
    exact: bool = False,
) -> Route:
    """Route through a belief roadmap that ends well known and is not long.

    Args:
        service: Measures the route; its weight plays no part in the search.
        roadmap: Free motions and what they do to the covariance.
        start: A node of the graph.
        goal: A node of the graph.
        covariance: Of the pose at the start, shape (3, 3): metres and radians.
        weight: See `search_roadmap`, as for the other arguments.
        measure: `trace` or `weak`.
        max_std: Metres.
        tolerance: Share of the variance.
        exact: Whether nothing may be missed; with many ways and a large weight that takes minutes.

    Raises:
        InputError: an argument is out of range, or there is no such route.
    """
    begin = time.perf_counter()
    found = search_roadmap(
        roadmap, start, goal, covariance,
        weight=weight, measure=measure, max_std=max_std, tolerance=tolerance, exact=exact,
    )  # fmt: skip
    if found is None:
        _refuse_unconnected(roadmap.graph, start, goal)
        raise InputError(
            f"no way keeps the standard deviation up to {max_std:g} m; allow a larger one."
        )
    return _route(service, roadmap.graph, found.way, "belief-roadmap", begin, found.covariances)


def _refuse_unconnected(graph: MotionGraph, start: int, goal: int) -> None:
    labels = graph.components()
    if labels[start] != labels[goal]:
        x0, y0, _ = graph.poses[start]
        x1, y1, _ = graph.poses[goal]
        raise InputError(
            f"no way leads from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) m; choose a goal in the same "
            "part of the free space, or a smaller footprint."
        )


def _route(
    service: AmbiguityService,
    graph: MotionGraph,
    way: Way,
    planner: str,
    begin: float,
    covariances: Floats | None,
) -> Route:
    if len(way.nodes) < 2:
        raise InputError("start and goal are the same place; choose another goal.")
    return evaluate_route(
        service,
        graph.poses[way.nodes],
        graph.steering,
        planner=planner,
        seconds=time.perf_counter() - begin,
        iterations=way.labels,
        covariances=covariances,
    )
