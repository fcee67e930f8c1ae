"""Forecasts of an audit: on which routes through the building robots get lost."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field

from ambinav.drive.odometries import odometry_name
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.geometry.collision.reach import Reach, check_reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.fields import Metres, Part, Share
from ambinav.routes.route import Route
from ambinav.routes.sampled import graph_step, sample_routes
from ambinav.routes.trip_routes import trip_routes
from ambinav.routes.trips import Trip
from ambinav.runtime.errors import InputWarning

PAIRS: Final = 40
"""Pairs of places that are sampled."""
LISTED: Final = 5
"""Most sampled routes that are reported."""
FEW: Final = 0.05
"""A sampled route is reported if at least this share of robots gets lost on it."""
MEASURED: Final = (
    "Measured: share of robots lost on routes forecast like this, in buildings left out of "
    "the fit, with its 95 % interval."
)
STEP: Final = 0.2
"""Metres between places of the lattice on which routes are found."""
SEED: Final = 0
"""Seed of the places, so that the same audit reports the same routes."""


@dataclass(frozen=True, eq=False)
class LostRoutes:
    """Forecasts of shortest routes between places, the worst first.

    Attributes:
        forecasts: The forecasts.
        trips: Trip of each, in the same order; (): the places are sampled.
    """

    forecasts: tuple[Forecast, ...]
    trips: tuple[Trip, ...] = ()

    @property
    def share_safe(self) -> float:
        """Share of the routes on which fewer than 5 % of robots get lost."""
        return float(np.mean([forecast.lost_probability < FEW for forecast in self.forecasts]))

    @property
    def worst(self) -> tuple[Forecast, ...]:
        """The routes to report: those of all trips, or the worst of the sampled ones."""
        if self.trips:
            return self.forecasts
        return tuple(
            forecast for forecast in self.forecasts[:LISTED] if forecast.lost_probability >= FEW
        )


def find_lost_routes(
    amap: AmbiguityMap,
    environment: Environment,
    reach: Reach,
    *,
    trips: Sequence[Trip] = (),
    routes: Sequence[Route] = (),
    odometry: str = ODOMETRY,
    localizer: str | LocalizerClass = LOCALIZER,
) -> LostRoutes:
    """Forecast the shortest routes of trips, or else between sampled pairs of places.

    Args:
        amap: The map.
        environment: What it was built of.
        reach: Floor that the robot reaches.
        trips: Trips that robots make, as `ambinav.read_trips` reads them; (): places are sampled.
        routes: Route of each trip; (): the shortest ones (`trip_routes`) are searched for.
        odometry: Name of the odometry.
        localizer: Class of localizer, as for `Forecaster`.

    Raises:
        InputError: the robot does not fit at a place, a trip has no route, or no route can be
            sampled, as in a building of a single place; or what `Forecaster` refuses.
    """
    check_reach(reach)
    if not routes:
        routes = (
            trip_routes(environment, reach, trips, "trips")
            if trips
            else _sampled(environment, reach)
        )
    forecaster = Forecaster(amap, odometry, localizer, environment=environment, routes=routes)
    forecasts = list(map(forecaster, routes))
    order = np.argsort([-forecast.lost_probability for forecast in forecasts], kind="stable")
    return LostRoutes(tuple(forecasts[k] for k in order), tuple(trips[k] for k in order if trips))


def _sampled(environment: Environment, reach: Reach) -> tuple[Route, ...]:
    """Sample pairs of places; return the shortest routes between them."""
    with warnings.catch_warnings():
        # Floor that is cut off on the lattice: the audit reports what is not reached.
        warnings.simplefilter("ignore", InputWarning)
        return sample_routes(
            environment, reach, PAIRS, np.random.default_rng(SEED), step=graph_step(reach, STEP)
        )


class ReliabilityPart(Part):
    """Routes forecast alike in buildings that the localizer's class was not fitted to."""

    forecast_low: Share
    forecast_high: Share
    routes: int
    lost: Share = Field(description="of the robots, on these routes")
    lost_low: Share = Field(description="lower end of its 95 % interval")
    lost_high: Share

    @property
    def lost_text(self) -> str:
        """The share with its interval."""
        low, high = 100.0 * self.lost_low, 100.0 * self.lost_high
        return f"{100.0 * self.lost:.1f} % ({low:.1f} to {high:.1f} %)"


class LostRoutePart(Part):
    """A route on which robots get lost."""

    start: str | None = Field(default=None, description="name of the place; null: it is sampled")
    goal: str | None = None
    start_m: tuple[Metres, Metres]
    goal_m: tuple[Metres, Metres]
    length_m: Metres
    lost_probability: Share
    lost_probability_reliability: ReliabilityPart | None = Field(
        default=None, description="of routes forecast like this; null: not measured"
    )
    text: str = Field(description="probability and main cause in words")
    x_m: Metres | None = Field(description="where most get lost; null: spread over the route")
    y_m: Metres | None
    kind: str | None = Field(description="error that grows: open floor, sliding, heading or drift")

    @property
    def measured_text(self) -> str:
        """Share of robots lost on routes forecast like this."""
        measured = self.lost_probability_reliability
        return "not measured" if measured is None else measured.lost_text

    @property
    def start_text(self) -> str:
        """Name and position of the start."""
        return _place_text(self.start, self.start_m)

    @property
    def goal_text(self) -> str:
        """Name and position of the goal."""
        return _place_text(self.goal, self.goal_m)


class LostPart(Part):
    """Forecasts of the shortest routes of trips, or between places drawn from the floor."""

    localizer: str = Field(description="calibrated class of localizer")
    odometry: str
    pairs: int = Field(description="number of trips, or of sampled pairs of places")
    share_safe: Share = Field(description="of these, with fewer than 5 % of robots lost")
    text: str
    routes: tuple[LostRoutePart, ...] = Field(
        description="all trips, or up to five sampled routes with the most lost robots, at least "
        "5 %; the worst first"
    )


def lost_part(lost: LostRoutes) -> LostPart:
    """Collect the forecasts."""
    first, pairs = lost.forecasts[0], len(lost.forecasts)
    safe, odometry = round(lost.share_safe * pairs), odometry_name(first.odometry)
    of = "trips between named places" if lost.trips else "shortest routes between sampled places"
    return LostPart(
        localizer=first.localizer.name,
        odometry=odometry,
        pairs=pairs,
        share_safe=lost.share_safe,
        text=(
            f"On {safe} of {pairs} {of} fewer than {100.0 * FEW:.0f} % of robots are forecast to "
            f"get lost: robots that are kept on the route, with {odometry} odometry and "
            f"{first.localizer.title}."
        ),
        routes=tuple(map(_route, lost.worst, lost.trips or [None] * pairs)),
    )


def _route(forecast: Forecast, trip: Trip | None) -> LostRoutePart:
    (x0, y0), (x1, y1) = forecast.poses[[0, -1], :2].tolist()
    cause = forecast.causes[0] if forecast.causes else None
    measured = forecast.reliability
    return LostRoutePart(
        start=None if trip is None else trip.start,
        goal=None if trip is None else trip.goal,
        start_m=(x0, y0),
        goal_m=(x1, y1),
        length_m=float(forecast.distance[-1]),
        lost_probability=forecast.lost_probability,
        lost_probability_reliability=None if measured is None else ReliabilityPart.of(measured),
        text=forecast.sentence,
        x_m=None if cause is None else cause.x,
        y_m=None if cause is None else cause.y,
        kind=None if cause is None else cause.kind,
    )


def _place_text(name: str | None, at: tuple[float, float]) -> str:
    position = "{:.1f}, {:.1f} m".format(*at)
    return position if name is None else f"{name} ({position})"
