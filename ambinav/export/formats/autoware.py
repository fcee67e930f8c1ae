"""Floor where Autoware's localization error monitor is to be expected to warn.

The monitor (autoware_localization_error_monitor) takes 3 standard deviations of the reported
position: the long axis of the ellipse, and its size across the vehicle's heading. Here they are
those of the covariance that is to be expected at the place.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.export.formats.covariance import covariance_grid
from ambinav.export.formats.zones import LEAST_AREA, collection, feature, figures, pieces
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.maps.ambiguity_map import AmbiguityMap

SCALE: Final = 3.0
LONG: Final = (1.2, 1.5)
"""Warning and error of the long axis, metres (`warn_ellipse_size`, `error_ellipse_size`)."""
LATERAL: Final = (0.25, 0.30)
"""The same across the heading (`..._lateral_direction`)."""
LEVELS: Final = ("ok", "warning", "error")
LEAST_RADIUS: Final = 1.2
"""Metres: a map knows deviations up to half of its neighbourhood's radius, and 3 of those must
reach the error of the long axis with a margin for the cells."""

Floats = NDArray[np.float64]


def sizes(grid: NDArray[np.float32], heading: float | None) -> tuple[Floats, Floats]:
    """Long axis and size across the heading of the 3 sigma ellipse, metres, shape (ny, nx) each.

    Args:
        grid: `covariance_grid` of a map.
        heading: Of the vehicle, radians; None: along the long axis, as it drives in a corridor.
    """
    xx, xy, _, yy = (band.astype(np.float64) for band in grid[:4])
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    long = SCALE * np.sqrt(middle + half)
    if heading is None:
        return long, SCALE * np.sqrt(np.maximum(middle - half, 0.0))
    s, c = math.sin(heading), math.cos(heading)
    # What covariance_ellipse.cpp has as e' P^-1 e / det P^-1, e along the heading.
    return long, SCALE * np.sqrt(np.maximum(s * s * xx - 2.0 * s * c * xy + c * c * yy, 0.0))


def level(size: Floats, limits: tuple[float, float]) -> NDArray[np.uint8]:
    """Index in `LEVELS` of each size; nan counts as 0."""
    with np.errstate(invalid="ignore"):
        return ((size >= limits[0]).astype(np.uint8) + (size >= limits[1])).astype(np.uint8)


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write floor of the levels warning and error, a Feature for each connected piece."""
    options = export.options
    _check_radius(export.amap)
    heading = None if options.heading is None else math.radians(options.heading)
    grid, raster = covariance_grid(export.amap, heading), Raster.of_map(export.amap)
    long, lateral = sizes(grid, heading)
    by_long, by_lateral = level(long, LONG), level(lateral, LATERAL)
    worst = np.maximum(by_long, by_lateral)
    least = LEAST_AREA if options.least_area is None else options.least_area
    features = []
    for code in (2, 1):
        for cause, mask in (
            ("long axis and across the heading", (by_long == code) & (by_lateral == code)),
            ("long axis", (by_long == code) & (by_lateral < code)),
            ("across the heading", (by_long < code) & (by_lateral == code)),
        ):
            for piece in pieces(mask & (worst == code), raster, grid, least):
                features.append(
                    feature(piece.polygon, level=LEVELS[code], cause=cause, **figures(piece))
                )
    told = "along the weak direction" if heading is None else f"{options.heading:g} deg"
    text = collection(export, features, f"localization error monitor, heading {told}")
    path.write_text(text, encoding="utf-8")
    return (path,)


def _check_radius(amap: AmbiguityMap) -> None:
    """Refuse a map that cannot tell deviations as large as the thresholds.

    Raises:
        InputError: its neighbourhood is too small.
    """
    radius = json.loads(amap.dataset.attrs["parameters"]).get("radius")
    if not isinstance(radius, int | float) or radius < LEAST_RADIUS:
        told = "?" if radius is None else f"{radius:g}"
        raise InputError(
            f"{amap.source}: radius is {told} m, within which no deviation reaches Autoware's "
            f"threshold of {LONG[1]:g} m at 3 sigma; make the map with "
            f"`ambinav map ... --ambiguity-radius {LEAST_RADIUS:g}` or more."
        )


AUTOWARE: Final = Exporter(
    subject="map",
    format="zones-autoware",
    title="floor where 3 sigma pass 1.2/1.5 m, or 0.25/0.30 m across the heading",
    reader="Autoware, localization error monitor",
    write=write,
    suffixes=(".geojson",),
    uses=frozenset({"heading", "least_area"}),
)
