"""A forecast as plain data, as `ambinav forecast --json` and the server give it."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from ambinav.forecasting.forecast import Forecast
    from ambinav.forecasting.reliability import ReliabilityBin

LOCALIZER: Final = "product"
ODOMETRY: Final = "mediocre"
"""Odometry of a forecast if none is asked for."""
RELIABILITY: Final = "lost_probability_reliability"
"""Key of a `ReliabilityBin`."""


def forecast_document(forecast: Forecast, odometry: str) -> dict[str, Any]:
    """Return a forecast as plain data, metres and radians."""
    error = forecast.expected_error
    return {
        "lost_probability": forecast.lost_probability,
        RELIABILITY: plain_bin(forecast.reliability),
        "text": forecast.sentence,
        "localizer": forecast.localizer.name,
        "odometry": odometry,
        "largest_error_m": float(error.max()),
        "causes": [cause.plain for cause in forecast.causes],
        "curve": [
            {
                "distance_m": round(float(distance), 3),
                "x_m": round(float(x), 3),
                "y_m": round(float(y), 3),
                "theta_rad": round(float(theta), 4),
                "lost": float(lost),
                "error_m": round(float(off), 4),
                "heading_error_rad": round(math.sqrt(float(matrix[2, 2])), 5),
            }
            for distance, (x, y, theta), lost, off, matrix in zip(
                forecast.distance, forecast.poses, forecast.lost, error, forecast.covariance,
                strict=True,
            )
        ],
    }  # fmt: skip


def plain_bin(measured: ReliabilityBin | None) -> dict[str, Any] | None:
    """Return a bin as plain data; None: not measured."""
    return None if measured is None else asdict(measured)
