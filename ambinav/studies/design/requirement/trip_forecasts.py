"""Forecasts of trips: how likely robots get lost on them in a building and its changed versions.

A robot takes the shortest route, as in an audit. A route that new obstacles leave free stays the
shortest; else it is searched for in the changed building.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
import shapely

from ambinav.drive.robot import Robot
from ambinav.forecasting.ensemble import Ensemble, EnsembleRunner
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.route import Route
from ambinav.routes.trip_routes import shortest_routes, trip_routes
from ambinav.routes.trips import Trip
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputWarning
from ambinav.studies.design.place.candidates import Candidate

MakeForecaster: TypeAlias = Callable[[AmbiguityMap, Sequence[Route]], Forecaster]

NEAR: Final = 0.5
"""Metres from a trip's route within which floor counts for the search."""
SAFE: Final = 1e-3
"""Share of lost robots below which a trip needs no help."""
TRIED: Final = 6
"""Candidates of a kind that are tried near a place where robots get lost."""
RUNS: Final = 1024
"""Largest number of drives of a trip."""
SEED: Final = 0
"""Seed of the drives, so that the same command reports the same figures."""


@dataclass(frozen=True, eq=False)
class TripLosses:
    """Lost robots on T trips in one building with one scanner.

    Attributes:
        routes: Route of each trip.
        forecasts: Forecast of each route.
        forecaster: Forecaster of the building's map.
        robot: The robot that drives.
    """

    routes: tuple[Route, ...]
    forecasts: tuple[Forecast, ...]
    forecaster: Forecaster
    robot: Robot
    _driven: dict[tuple[int, float], Ensemble] = field(default_factory=dict)

    @cached_property
    def lost(self) -> Floats:
        """Forecast share of robots that get lost on each trip, shape (T,)."""
        return np.array([forecast.lost_probability for forecast in self.forecasts])

    def confirms(self, threshold: float) -> bool:
        """Return whether drives of each trip confirm that fewer than a share gets lost."""
        worst_first = np.argsort(-self.lost, kind="stable").tolist()
        return all(self.driven(number, threshold).side == "below" for number in worst_first)

    def driven(self, number: int, threshold: float) -> Ensemble:
        """Drive a trip until it is known whether fewer than a share of robots gets lost."""
        key = number, threshold
        if key not in self._driven:
            rng = np.random.default_rng(SEED)
            self._driven[key] = self._runner.drive(self.routes[number], rng, RUNS, until=threshold)
        return self._driven[key]

    @cached_property
    def _runner(self) -> EnsembleRunner:
        return self.forecaster.runner(self.robot)

    def drives(self, number: int, threshold: float) -> Ensemble | None:
        """Return the drives of a trip that have been made; None: there are none."""
        return self._driven.get((number, threshold))

    def near_cause(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return candidates near where most robots of the worst trip get lost, nearest first.

        At most `TRIED` of each kind; none where the forecast names no such place.
        """
        causes = self.forecasts[int(self.lost.argmax())].causes
        if not causes:
            return []
        at = causes[0].x, causes[0].y
        kinds: dict[str, list[Candidate]] = {}
        for candidate in sorted(candidates, key=lambda each: math.dist(each.middle, at)):
            kinds.setdefault(candidate.kind, []).append(candidate)
        return [candidate for nearest in kinds.values() for candidate in nearest[:TRIED]]

    def weights(self, amap: AmbiguityMap) -> Floats:
        """Return the weight of each cell of a map in a search, square metres, shape (ny, nx).

        Its area by the largest share of robots that get lost on a trip that passes within `NEAR`.
        """
        data = amap.dataset
        x, y = np.meshgrid(data["x"].values, data["y"].values)
        points = shapely.points(x, y)
        share = np.zeros(x.shape)
        for route, lost in zip(self.routes, self.lost.tolist(), strict=True):
            if lost >= SAFE:
                line = _line(route)
                shapely.prepare(line)
                share = np.maximum(share, lost * shapely.dwithin(line, points, NEAR))
        return share * amap.cell_area


class TripForecaster:
    """Routes and forecasts of trips in a building and its changed versions.

    Args:
        environment: The building.
        reach: Floor that the robot reaches.
        trips: The trips.
        make: Makes the forecaster of a map for routes.
        source: Names the file of the places in messages.

    Attributes:
        trips: The trips.
        notes: Warnings of the forecasts, such as on a scanner without calibration.

    Raises:
        InputError: the robot does not fit at a place.
        NoRouteError: there is no route of a trip.
    """

    def __init__(
        self,
        environment: Environment,
        reach: Reach,
        trips: Sequence[Trip],
        make: MakeForecaster,
        source: str = "places",
    ) -> None:
        self.trips = tuple(trips)
        self.notes: dict[str, None] = {}
        self._reach, self._make, self._source = reach, make, source
        self._robot = Robot(radius=reach.radius)
        self._routes = trip_routes(environment, reach, self.trips, source)

    def losses(
        self, amap: AmbiguityMap, environment: Environment, added: Sequence[Obstacle] = ()
    ) -> TripLosses:
        """Return the lost robots in a changed building.

        Args:
            amap: Its map.
            environment: The building with additional obstacles.
            added: These obstacles.

        Raises:
            NoRouteError: there is no route of a trip any more.
        """
        routes = list(self._routes)
        outlines = shapely.union_all([obstacle.outline for obstacle in added])
        blocked = [
            k
            for k, route in enumerate(routes)
            if shapely.dwithin(_line(route), outlines, self._reach.radius)
        ]
        around = shortest_routes(
            environment, self._reach, [self.trips[k] for k in blocked], self._source
        )
        for k, route in zip(blocked, around, strict=True):
            routes[k] = route
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", InputWarning)
            forecaster = self._make(amap, routes)
        self.notes |= dict.fromkeys(
            str(note.message) for note in caught if issubclass(note.category, InputWarning)
        )
        forecasts = tuple(map(forecaster, routes))
        return TripLosses(tuple(routes), forecasts, forecaster, self._robot)

    @property
    def stops(self) -> tuple[tuple[float, float], ...]:
        """Positions at which trips start and end."""
        ends = (end for trip in self.trips for end in (trip.start_at, trip.goal_at))
        return tuple(dict.fromkeys(ends))


def _line(route: Route) -> shapely.LineString:
    return shapely.LineString(route.poses[:, :2])
