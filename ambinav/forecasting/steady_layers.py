"""Layers: error and lost robots of a forecast, if all floor were as it is at a place.

Other layers say what a scan tells; these say what becomes of a robot, with an odometry and a class
of localizers. It drives straight on over floor that tells as much as this place does, from a start
that it knows as in a forecast (`START_STD`). Where scans tell the position its error settles. Where
nothing does it grows without a ceiling: the layer is what grew over 64 m, large, but finite, as a
cost has to be.

The lost share of a forecast does not grow in proportion to the metres: it lies between a share that
settles and one that grows evenly. So there is no rate of the steady state. The layer's is that of a
route: of the calibrated share p that is lost over L metres, the rate -ln(1 - p) / L of an even loss
that is as large.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from ambinav.config import as_count, as_positive
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.odometries import odometry_of
from ambinav.forecasting.filter_kernel import gained_rows
from ambinav.forecasting.forecast import START_STD
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.steady_kernel import steady_rows
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.threads import run_rows

METRES: Final = 64.0
"""Metres over the same floor."""
DIRECTIONS: Final = 4
"""Directions of driving where the map has no headings, evenly spaced from the x axis on."""


def expected_error(
    context: LayerContext,
    *,
    odometry: str | OdometryNoise = "mediocre",
    localizer: str | LocalizerClass = "product",
    metres: float = METRES,
    directions: int = DIRECTIONS,
) -> dict[str, Floats32]:
    """Compute the root mean square error of the position that a robot comes to.

    Args:
        context: The poses, with the map that they are of.
        odometry: Errors of the odometry, as for `Forecaster`.
        localizer: Class of localizer, likewise.
        metres: Metres over such floor, above 0; rounded up to 2^k + 1 updates.
        directions: Directions of driving that are averaged over, where the map has no headings;
            where it has, a robot drives ahead at each.

    Raises:
        InputError: there is no map, it does not tell its scanner, or an option is out of range.
    """
    spread, _ = steady_state(context, odometry, localizer, metres, directions, loses=False)
    return {"expected_error": context.spread(np.sqrt(spread[..., 0] + spread[..., 2]))}


def lost_rate(
    context: LayerContext,
    *,
    odometry: str | OdometryNoise = "mediocre",
    localizer: str | LocalizerClass = "product",
    metres: float = METRES,
    directions: int = DIRECTIONS,
) -> dict[str, Floats32]:
    """Compute the rate at which robots get lost; arguments and errors as of `expected_error`."""
    _, rate = steady_state(context, odometry, localizer, metres, directions)
    return {"lost_rate": context.spread(rate)}


def steady_state(
    context: LayerContext,
    odometry: str | OdometryNoise,
    localizer: str | LocalizerClass,
    metres: float = METRES,
    directions: int = DIRECTIONS,
    *,
    loses: bool = True,
) -> tuple[Floats, Floats]:
    """Compute what a robot comes to on floor as at each pose; arguments as of `expected_error`.

    Returns:
        Covariance of the position: xx, xy, yy, square metres, shape (P, K, 3), and lost rate, 1/m,
        shape (P, K), which without `loses` is nan, in less time.
    """
    noise, kind = odometry_of(odometry), LocalizerClass.load(localizer)
    metres = as_positive(metres, "metres", "a distance")
    count = as_count(directions, "directions")
    amap = context.amap
    if amap is None:
        raise InputError("the layer is made of a map's ambiguity; build the map first.")
    echoes = kind.limited_by_echoes(context.full_scanner)
    field = context.keep(
        "information field",
        echoes,
        lambda: InformationField.of(amap, context.environment, echoes=echoes),
    )
    doublings = max(math.ceil(math.log2(metres / kind.distance)), 0)
    driven = (1 + 2**doublings) * kind.distance
    settings = kind.settings(LOST_POSITION, LOST_HEADING)
    around = 2.0 * math.pi * np.arange(count) / count
    shape = len(context.points[0]), len(context.headings)
    spread, rate = np.empty((*shape, 3)), np.full(shape, math.nan)
    gained = np.empty((shape[0], 3, 3))
    for k in range(shape[1]):
        headings = context.headings[k : k + 1] if context.has_theta else around
        run_rows(
            gained_rows, shape[0], context.poses(k), field.fields, field.lattice, settings, gained,
            least=256,
        )  # fmt: skip
        each = np.empty((shape[0], len(headings), 3))
        lost = np.empty((shape[0], len(headings) if loses else 0))
        run_rows(
            steady_rows, shape[0], gained, headings,
            np.diag(np.square(START_STD)), noise.packed, settings, doublings, each, lost,
            least=64,
        )  # fmt: skip
        spread[:, k] = each.mean(axis=1)
        if loses:
            rate[:, k] = -np.log1p(-kind.calibrated(lost).mean(axis=1)) / driven
    return spread, rate


EXPECTED_ERROR = Layer(
    name="expected_error",
    title="steady-state error of a localizer on such floor",
    unit="m",
    source="own, from the forecast's filter: docs/forecast.md",
    worse="high",
    compute=expected_error,
    slow=True,
    in_space=True,
)

LOST_RATE = replace(
    EXPECTED_ERROR,
    name="lost_rate",
    title="robots lost per metre of such floor",
    unit="1/m",
    compute=lost_rate,
)
