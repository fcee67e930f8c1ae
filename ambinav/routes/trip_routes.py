"""Shortest routes of trips between named places."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.reach import Reach, reach_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.route import Route
from ambinav.routes.sampled import PLANNER, PlaceGraph, graph_step
from ambinav.routes.trips import Trip
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError, InputWarning

STEP: Final = 0.2
"""Metres between points of the graph on which routes are found, as in an audit."""
FINER: Final = 4.0
"""Steps of the first graph are so many times those of the second one."""


class NoRouteError(InputError):
    """There is no route of a trip."""


def trip_routes(
    environment: Environment, reach: Reach, trips: Sequence[Trip], source: str = "places"
) -> tuple[Route, ...]:
    """Return the shortest route of each trip.

    Args:
        environment: The building.
        reach: Floor that the robot reaches.
        trips: The trips.
        source: Names the file of the places in messages.

    Raises:
        InputError: the robot does not fit at a place.
        NoRouteError: there is no route of a trip.
    """
    disc = Footprint.disc(reach.radius)
    checker = CollisionChecker(environment, disc, Steering("r2"))
    for trip in trips:
        for name, (x, y) in ((trip.start, trip.start_at), (trip.goal, trip.goal_at)):
            reason = checker.why_not(x, y)
            if reason is not None:
                raise InputError(
                    f"{source}: places: {name} at ({x:g}, {y:g}) m is {reason}; move it."
                )
    return shortest_routes(environment, reach, trips, source)


def shortest_routes(
    environment: Environment, reach: Reach, trips: Sequence[Trip], source: str
) -> tuple[Route, ...]:
    """Return the shortest routes of trips, at whose places the robot fits.

    Arguments as for `trip_routes`; `reach` may be that of the building before a change.

    Raises:
        NoRouteError: there is no route of a trip.
    """
    if not trips:
        return ()
    reach = reach_of(environment, reach.radius, reach.start)
    step = graph_step(reach, STEP)
    points: dict[int, Floats] = {}
    # On a finer graph there are also routes through narrow doors.
    for each in (step, step / FINER):
        missing = [k for k in range(len(trips)) if k not in points]
        if not missing:
            break
        with warnings.catch_warnings():
            # Floor that is cut off on the graph: a trip to there is refused below.
            warnings.simplefilter("ignore", InputWarning)
            graph = PlaceGraph.of(environment, reach, each)
        for k in missing:
            path = _shortest_path(graph, trips[k])
            if path is not None:
                points[k] = path
    for k, trip in enumerate(trips):
        if k not in points:
            raise NoRouteError(
                f"{source}: no route of {trip.title} is found on explored floor that a robot of "
                f"radius {reach.radius:g} m reaches, on a graph with steps of {step / FINER:.2g} "
                "m; move the places, give --start or a smaller --robot-radius."
            )
    return tuple(Route.through(points[k], planner=PLANNER) for k in range(len(trips)))


def _shortest_path(graph: PlaceGraph, trip: Trip) -> Floats | None:
    """Return the shorter of the paths found there and, turned round, back; None: there is none."""
    there = graph.between(trip.start_at, trip.goal_at)
    back = graph.between(trip.goal_at, trip.start_at)
    if there is None or back is None:
        return there
    lengths = [float(np.hypot(*np.diff(path, axis=0).T).sum()) for path in (there, back)]
    return there if lengths[0] <= lengths[1] else back[::-1]
