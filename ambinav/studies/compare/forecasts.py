"""Forecasts of the routes of a comparison, where its localizer is of a calibrated class."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np

from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.forecasting.localizer_class import class_of
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.scenario_file import ScenarioBundle

LEAST_START: Final = 1e-4
"""Deviation of a start that the scenario gives as exact, metres and radians."""


def make_forecasts(
    loaded: ScenarioBundle, amap: AmbiguityMap, plans: Sequence[Plan]
) -> tuple[Forecast | None, ...]:
    """Forecast how likely a robot gets lost on each route.

    Returns:
        One for each route; None where a policy drives, and for all if the localizer is of no
        calibrated class.

    Warns:
        InputWarning: a route cannot be forecast on this map.
    """
    scenario = loaded.scenario
    localizer = class_of(
        scenario.chosen_localizer, loaded.scanner, scenario.odometry, scenario.robot,
        scenario.drive.rate,
    )  # fmt: skip
    followed = [plan for plan in plans if plan.driver is None]
    made: dict[Plan, Forecast] = {}
    if localizer is not None and followed:
        start = np.maximum(scenario.drive.start_deviations, LEAST_START)
        try:
            forecaster = Forecaster(
                amap, scenario.odometry, localizer,
                start_std=start, environment=loaded.environment,
                routes=[plan.route for plan in followed],
            )  # fmt: skip
        except InputError as error:
            _warn(f"routes have no forecast: {error}")
            followed = []
        for plan in followed:
            try:
                made[plan] = forecaster(plan.route)
            except InputError as error:
                _warn(f"pair {plan.pair!r}, route {plan.name!r} has no forecast: {error}")
    return tuple(made.get(plan) for plan in plans)


def forecast_note(forecasts: Sequence[Forecast | None]) -> str:
    """Explain the forecasts of a report in a few sentences; "" without any."""
    made = next((forecast for forecast in forecasts if forecast is not None), None)
    if made is None:
        return ""
    return (
        "the probability, computed from the map before any drive, that a robot gets lost on the "
        f"route with this odometry and {made.localizer.title}. It is calibrated on robots that "
        "are kept on their route (open loop), without people and boxes. Robots that steer by "
        "their estimate may differ."
    )


def _warn(text: str) -> None:
    warnings.warn(text, InputWarning, stacklevel=4)
