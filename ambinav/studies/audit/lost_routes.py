"""Forecasts of an audit: on which routes through the building robots get lost."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field

from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.fields import Metres, Part, Share
from ambinav.routes.sampled import graph_step, sample_routes
from ambinav.runtime.errors import InputWarning

PAIRS: Final = 40
"""Pairs of places that are sampled."""
LISTED: Final = 5
"""Most routes that are reported."""
FEW: Final = 0.05
"""A route is reported if at least this share of robots gets lost on it."""
STEP: Final = 0.2
"""Metres between places of the lattice on which routes are found."""
SEED: Final = 0
"""Seed of the places, so that the same audit reports the same routes."""


@dataclass(frozen=True, eq=False)
class LostRoutes:
    """Forecasts of shortest routes between sampled places, the worst first."""

    forecasts: tuple[Forecast, ...]

    @property
    def share_safe(self) -> float:
        """Share of the routes on which fewer than 5 % of robots get lost."""
        return float(np.mean([forecast.lost_probability < FEW for forecast in self.forecasts]))

    @property
    def worst(self) -> tuple[Forecast, ...]:
        """The routes to report."""
        return tuple(
            forecast for forecast in self.forecasts[:LISTED] if forecast.lost_probability >= FEW
        )


def find_lost_routes(amap: AmbiguityMap, environment: Environment, reach: Reach) -> LostRoutes:
    """Sample pairs of places that a robot drives between, and forecast the shortest routes.

    Args:
        amap: The map.
        environment: What it was built of.
        reach: Floor that the robot reaches.

    Raises:
        InputError: no route can be sampled, as in a building of a single place.
    """
    with warnings.catch_warnings():
        # Floor that is cut off on the lattice: the audit reports what is not reached.
        warnings.simplefilter("ignore", InputWarning)
        routes = sample_routes(
            environment, reach, PAIRS, np.random.default_rng(SEED), step=graph_step(reach, STEP)
        )
    forecaster = Forecaster(amap, ODOMETRY, LOCALIZER, environment=environment, routes=routes)
    forecasts = map(forecaster, routes)
    return LostRoutes(tuple(sorted(forecasts, key=lambda f: f.lost_probability, reverse=True)))


class LostRoutePart(Part):
    """A route on which robots get lost."""

    start_m: tuple[Metres, Metres]
    goal_m: tuple[Metres, Metres]
    length_m: Metres
    lost_probability: Share
    text: str = Field(description="probability and main cause in words")
    x_m: Metres | None = Field(description="where most get lost; null: spread over the route")
    y_m: Metres | None
    kind: str | None = Field(description="open floor, sliding or heading: the error that grows")


class LostPart(Part):
    """Forecasts of shortest routes between places drawn evenly from the reachable floor."""

    localizer: str = Field(description="calibrated class of localizer")
    odometry: str
    pairs: int = Field(description="number of sampled pairs of places")
    share_safe: Share = Field(description="of these, with fewer than 5 % of robots lost")
    text: str
    routes: tuple[LostRoutePart, ...] = Field(
        description="up to five with the most lost robots, at least 5 %; the worst first"
    )


def lost_part(lost: LostRoutes) -> LostPart:
    """Collect the forecasts."""
    first, pairs = lost.forecasts[0], len(lost.forecasts)
    safe = round(lost.share_safe * pairs)
    return LostPart(
        localizer=first.localizer.name,
        odometry=ODOMETRY,
        pairs=pairs,
        share_safe=lost.share_safe,
        text=(
            f"On {safe} of {pairs} shortest routes between sampled places fewer than "
            f"{100.0 * FEW:.0f} % of robots are forecast to get lost: robots that are kept on the "
            f"route, with {ODOMETRY} odometry and {first.localizer.title}."
        ),
        routes=tuple(map(_route, lost.worst)),
    )


def _route(forecast: Forecast) -> LostRoutePart:
    (x0, y0), (x1, y1) = forecast.poses[[0, -1], :2].tolist()
    cause = forecast.causes[0] if forecast.causes else None
    return LostRoutePart(
        start_m=(x0, y0),
        goal_m=(x1, y1),
        length_m=float(forecast.distance[-1]),
        lost_probability=forecast.lost_probability,
        text=forecast.sentence,
        x_m=None if cause is None else cause.x,
        y_m=None if cause is None else cause.y,
        kind=None if cause is None else cause.kind,
    )
