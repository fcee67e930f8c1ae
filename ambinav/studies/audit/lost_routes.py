"""Forecasts of an audit: on which routes through the building robots get lost."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
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


def find_lost_routes(
    amap: AmbiguityMap, environment: Environment, reach: Reach, pairs: int = PAIRS
) -> LostRoutes:
    """Sample pairs of places that a robot drives between, and forecast the shortest routes.

    Args:
        amap: The map.
        environment: What it was built of.
        reach: Floor that the robot reaches.
        pairs: Number of pairs.

    Raises:
        InputError: no route can be sampled, as in a building of a single place.
    """
    with warnings.catch_warnings():
        # Floor that is cut off on the lattice: the audit reports what is not reached.
        warnings.simplefilter("ignore", InputWarning)
        routes = sample_routes(
            environment, reach, pairs, np.random.default_rng(SEED), step=graph_step(reach, STEP)
        )
    forecaster = Forecaster(amap, ODOMETRY, LOCALIZER, environment=environment, routes=routes)
    forecasts = map(forecaster, routes)
    return LostRoutes(tuple(sorted(forecasts, key=lambda f: f.lost_probability, reverse=True)))
