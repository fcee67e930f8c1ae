"""Floor where Autoware's localization error monitor is expected to warn.

The monitor (autoware_localization_error_monitor) takes 3 standard deviations of the reported
position: the long axis of the ellipse, and its size across the vehicle's heading. Here they are
those of the covariance that is to be expected at the place.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.export.formats.covariance import covariance_grid
from ambinav.export.formats.inputs import route_on
from ambinav.export.formats.nav2_path import dense_poses
from ambinav.export.formats.zones import (
    collection,
    feature,
    figures,
    least_area,
    note_no_pieces,
    pieces,
)
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE
from ambinav.routes.evaluate import zone_codes
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bytes, Floats
from ambinav.runtime.errors import InputError

SCALE: Final = 3.0
LONG: Final = (1.2, 1.5)
"""Warning and error of the long axis, metres (`warn_ellipse_size`, `error_ellipse_size`)."""
LATERAL: Final = (0.25, 0.30)
"""The same across the heading (`..._lateral_direction`)."""
LEVELS: Final = ("ok", "warning", "error")
CAUSES: Final = ("long axis and across the heading", "long axis", "across the heading")
LEAST_RADIUS: Final = 1.2
"""Metres: on open floor a map's deviations end at half of its neighbourhood's radius (in a corridor
at 0.58 of it), and 3 of those must reach the error of the long axis with a margin for the cells."""


def sizes(
    xx: NDArray[Any], xy: NDArray[Any], yy: NDArray[Any], heading: float | Floats | None
) -> tuple[Floats, Floats]:
    """Compute the 3 sigma ellipse's long axis and size across the heading, metres, like `xx`.

    Args:
        xx: Expected covariance, square metres.
        xy: As `xx`.
        yy: As `xx`.
        heading: Heading of the vehicle, radians; None: along the long axis, as it drives in a
            corridor.
    """
    xx, xy, yy = (band.astype(np.float64) for band in (xx, xy, yy))
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    long = SCALE * np.sqrt(middle + half)
    if heading is None:
        return long, SCALE * np.sqrt(np.maximum(middle - half, 0.0))
    s, c = np.sin(heading), np.cos(heading)
    # covariance_ellipse.cpp computes e' P^-1 e / det P^-1, with e along the heading.
    return long, SCALE * np.sqrt(np.maximum(s * s * xx - 2.0 * s * c * xy + c * c * yy, 0.0))


def level(size: Floats, limits: tuple[float, float]) -> Bytes:
    """Return the index in `LEVELS` of each size; nan counts as 0."""
    with np.errstate(invalid="ignore"):
        return ((size >= limits[0]).astype(np.uint8) + (size >= limits[1])).astype(np.uint8)


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write floor of the levels warning and error, one Feature per connected piece.

    Then the stretches of the routes that are named.
    """
    options = export.options
    _check_radius(export.amap)
    heading = None if options.heading is None else math.radians(options.heading)
    grid, raster = covariance_grid(export.amap, heading), Raster.of_map(export.amap)
    by_long, by_lateral = _levels(*sizes(grid[0], grid[1], grid[3], heading))
    judged = export.amap.judged.counted
    worst = np.where(judged, np.maximum(by_long, by_lateral), 0)
    features = []
    for code in (2, 1):
        for k, cause in enumerate(CAUSES, start=1):
            mask = (worst == code) & (_causes(by_long, by_lateral) == k)
            features += [
                feature(piece.polygon, level=LEVELS[code], cause=cause, **figures(piece))
                for piece in pieces(mask, raster, grid, least_area(export))
            ]
    for file in options.routes:
        features += stretches(export.amap, route_on(export.amap, file), file.name)
    if not features:
        area = np.count_nonzero(worst) * export.amap.cell_area
        none = "no judged floor of the map passes Autoware's thresholds"
        note_no_pieces(export, path, area, none)
    faced = "along the weak direction" if heading is None else f"{options.heading:g} deg"
    text = collection(export, features, f"localization error monitor, heading {faced}")
    path.write_text(text, encoding="utf-8")
    return (path,)


def stretches(amap: AmbiguityMap, route: Route, name: str) -> list[dict[str, Any]]:
    """Find stretches of a route of the levels warning and error, for the vehicle's headings."""
    poses = dense_poses(route)
    covariance = expected_covariance(amap, poses)
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    by_long, by_lateral = _levels(*sizes(xx, xy, yy, poses[:, 2]))
    worst, cause = np.maximum(by_long, by_lateral), _causes(by_long, by_lateral)
    worst[zone_codes(amap, poses) == NOT_FREE] = 0  # unexplored
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    # Each pose stands for the piece to the next one.
    change = np.flatnonzero((np.diff(worst[:-1]) != 0) | (np.diff(cause[:-1]) != 0)) + 1
    features = []
    for first, last in zip([0, *change], [*change, len(poses) - 1], strict=True):
        if worst[first]:
            line = shapely.LineString(poses[first : last + 1, :2])
            geometry = json.loads(shapely.to_geojson(line))
            properties = {
                "route": name,
                "level": LEVELS[worst[first]],
                "cause": CAUSES[cause[first] - 1],
                "from_m": round(float(along[first]), 3),
                "to_m": round(float(along[last]), 3),
            }
            features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return features


def _levels(long: Floats, lateral: Floats) -> tuple[Bytes, Bytes]:
    return level(long, LONG), level(lateral, LATERAL)


def _causes(by_long: Bytes, by_lateral: Bytes) -> Bytes:
    """Return the index in `CAUSES`, from 1 on, of each level's cause; 1 where both apply."""
    return np.where(by_long == by_lateral, 1, np.where(by_long > by_lateral, 2, 3)).astype(np.uint8)


def _check_radius(amap: AmbiguityMap) -> None:
    """Check that a map's radius is large enough for deviations at the thresholds, on all floor.

    Raises:
        InputError: its neighbourhood is too small.
    """
    radius = amap.parameters.get("radius")
    if not isinstance(radius, int | float) or radius < LEAST_RADIUS:
        radius_text = "?" if radius is None else f"{radius:g}"
        raise InputError(
            f"{amap.source}: radius is {radius_text} m, and on open floor 3 sigma end at 1.5 times "
            f"that, too near to Autoware's threshold of {LONG[1]:g} m; make the map with "
            f"`ambinav map ... --ambiguity-radius {LEAST_RADIUS:g}` or more."
        )


AUTOWARE: Final = Exporter(
    subject="map",
    format="zones-autoware",
    title="floor where 3 sigma pass 1.2/1.5 m, or 0.25/0.30 m across the heading",
    reader="Autoware, localization error monitor",
    write=write,
    suffixes=(".geojson",),
    uses=frozenset({"heading", "least_area", "routes"}),
)
