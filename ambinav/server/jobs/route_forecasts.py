"""Forecasts of planned routes in the form of the answer."""

from __future__ import annotations

import warnings
from typing import Any

from ambinav.forecasting.document import forecast_document
from ambinav.forecasting.forecast import Forecaster
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError, InputWarning


def route_forecasts(
    amap: AmbiguityMap, routes: list[Route], odometry: str, localizer: str
) -> list[dict[str, Any]]:
    """Return the forecast of each route, or why there is none.

    Args:
        amap: The map.
        routes: Routes on it.
        odometry: Name of the odometry.
        localizer: Name of the localizer's class.

    Returns:
        `forecast`, a `forecast_document` or None, and `forecast_reason`, None or a sentence.
    """
    try:
        with warnings.catch_warnings():
            # A class that was not calibrated for the scanner: programs do not read warnings.
            warnings.simplefilter("error", InputWarning)
            forecaster = Forecaster(amap, odometry, localizer, routes=routes)
    except (InputError, InputWarning) as error:
        return [_no_forecast(error)] * len(routes)
    return [_answer(forecaster, route, odometry) for route in routes]


def _answer(forecaster: Forecaster, route: Route, odometry: str) -> dict[str, Any]:
    try:
        document = forecast_document(forecaster(route), odometry)
    except InputError as error:
        return _no_forecast(error)
    return {"forecast": document, "forecast_reason": None}


def _no_forecast(error: Exception) -> dict[str, Any]:
    return {"forecast": None, "forecast_reason": str(error)}
