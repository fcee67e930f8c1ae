"""Stretches of a route where few beams return an echo, and forecasts are too good.

A likelihood field learns nothing from a beam without an echo, while the map's information, of which
forecasts are made, counts it as a range beyond the maximum. Where a few posts are all that is in
range, robots with such a localizer get lost more often than is forecast (docs/forecast.md).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.casting.scans import scan_rays
from ambinav.drive.localizer_spec import ChosenLocalizer
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.localization.parameters import MclParameters
from ambinav.sensing.scanner import RangeScanner

Floats = NDArray[np.float64]

FEW: Final = 0.1
"""Share of the beams that is few, if not none: without any the forecast is of dead reckoning."""
NOTABLE: Final = 1.0
"""Metres from which such stretches are named."""
BEAMS: Final = 60
"""Beams of a scan that are looked at, at most."""


def learns_from_echoes_alone(localizer: ChosenLocalizer) -> bool:
    """Return whether a localizer passes over beams without an echo."""
    parameters = localizer.parameters
    return isinstance(parameters, MclParameters) and parameters.laser_model_type.startswith(
        "likelihood_field"
    )


def few_echo_metres(
    environment: Environment, scanner: RangeScanner, poses: Floats, along: Floats
) -> float:
    """Return the metres of a route with echoes in some beams, but in fewer than `FEW` of them.

    Args:
        environment: The building.
        scanner: The scanner.
        poses: x, y (metres) and heading (radians) along the route, shape (n, 3).
        along: Metres up to each, shape (n,).
    """
    share = _echo_share(environment, scanner.thinned(BEAMS), poses)
    edges = np.concatenate([along[:1], (along[1:] + along[:-1]) / 2.0, along[-1:]])
    return float(np.diff(edges)[(share > 0.0) & (share < FEW)].sum())


def _echo_share(environment: Environment, scanner: RangeScanner, poses: Floats) -> Floats:
    """Return the share of the beams that return an echo of a surface at each pose, shape (n,)."""
    echo = np.isfinite(scanner.scan(environment, *poses.T))
    x, y, theta = poses.T
    _, surface, _ = scan_rays(
        environment, x, y, theta, scanner.mounts[:, :2], scanner.mounts[:, 2],
        float(np.max(scanner.max_range)), height=scanner.upright[:, 0],
        elevation=scanner.upright[:, 1], incidence=False,
    )  # fmt: skip
    echo &= (surface < 0) | (environment.surface_kind[np.maximum(surface, 0)] != FRONTIER)
    return np.asarray(echo.mean(axis=-1))
