"""Map data for a page without a server: rasters, walls, rays of the scanner, strokes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.colors import LogNorm

from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import NOT_FREE
from ambinav.plotting.scales import layer_scale
from ambinav.plotting.strokes import weak_strokes
from ambinav.reports.page.rasters import (
    OUTSIDE,
    SOLID,
    UNEXPLORED,
    UNKNOWN,
    UNREACHABLE,
    Window,
    base64_of,
    encode,
)
from ambinav.runtime.array_types import Bytes, Floats32
from ambinav.sensing.scanner import RangeScanner

LAYERS: Final = ("level", "major_radius", "minor_radius", "clearance", "direction")
"""Layers that a report has in it, beside those that were added."""
FARTHEST: Final = 1e4
"""Metres: a ray that reaches any wall. JSON knows no infinity."""


def map_data(
    amap: AmbiguityMap,
    scanner: RangeScanner,
    *,
    heading: str | float = "mean",
    parts: JudgedFloor | None = None,
) -> dict[str, Any]:
    """Collect the map data of a page, in the form of the HTTP service's answers.

    Args:
        amap: The map.
        scanner: Its scanner, for the expected scan.
        heading: "mean", "best", "worst" or radians, where the heading matters.
        parts: Masks of the floor that counts; None: the map's own (`AmbiguityMap.judged`).

    Raises:
        InputError: no such heading.
    """
    parts = amap.judged if parts is None else parts
    data = amap.dataset
    level = amap.floor("level", heading).values.astype(np.float64)
    window = Window.around(
        data["x"].values, data["y"].values, amap.spacing, data["free"].values, level
    )
    codes = window.take(floor_classes(amap, heading, parts))
    names = dict.fromkeys((*LAYERS, amap.cost_layer, *schema.added(data)))
    left, low, *_ = window.bounds
    return {
        "map": {
            "id": "map",
            "name": data.attrs["environment"],
            "bounds": window.bounds,
            "spacing": amap.spacing * window.block,
            "shape": codes.shape,
            "headings": data.sizes.get("theta"),
            "scanner": data.attrs["scanner"],
            "radius": amap.parameters.get("radius"),
            "cost_layer": amap.cost_layer,
            "block": window.block,
            "classes": np.unique(codes).tolist(),
            "fixed_heading": True,
            "layers": [
                {"name": "zone", "long_name": "zones of the floor", "units": "", "worse": None}
            ],
        },
        "rasters": {
            name: _raster(amap, name, heading, window, codes)
            for name in names
            if schema.base_name(name) in data and name not in ("zone", "free")
        },
        "walls": base64_of(
            (amap.segments.xy - np.array([left, low, left, low])).astype(np.float32)
        ),
        "is_wall": base64_of(amap.segments.walls.astype(np.uint8)),
        "is_reflector": base64_of(amap.segments.reflectors.astype(np.uint8)),
        "direction": _direction(amap, heading, parts),
        # A three-dimensional building has no plane walls for ray casting: the page shows no scan.
        "rays": _rays(None if data.attrs.get("environment_space") else scanner),
    }


def _raster(
    amap: AmbiguityMap, name: str, heading: str | float, window: Window, codes: Bytes
) -> dict[str, Any]:
    """Return a layer with its values and the scale for drawing them."""
    data = amap.floor(name, heading)
    attrs = amap.dataset[name].attrs
    core = CORE_LAYERS.get(schema.base_name(name))
    values = window.take(data.values.astype(np.float64))
    values = np.where(codes <= OUTSIDE, values, np.nan)
    counted = np.where(codes < UNEXPLORED, values, np.nan)
    scale = layer_scale(name, data, counted)
    if scale.unit == "degrees":
        turned = np.mod(np.degrees(values), float(scale.norm.vmax or 360.0))
        values = np.where(np.isfinite(values), turned, np.nan)
    png, low, high = encode(values, codes)
    return {
        "name": name,
        "long_name": str(attrs.get("long_name", core.title if core else name)),
        "units": scale.unit,
        "worse": attrs.get("worse", core.worse if core else None),
        "source": attrs.get("source", ""),
        "png": png,
        "low": low,
        "high": high,
        "min": float(scale.norm.vmin or 0.0),
        "max": float(scale.norm.vmax or 1.0),
        "log": isinstance(scale.norm, LogNorm),
        "colours": scale.stops(),
    }


def floor_classes(amap: AmbiguityMap, heading: str | float, parts: JudgedFloor) -> Bytes:
    """Return the zone of each cell that counts, and the class of the others; see `rasters`."""
    zone = amap.floor("zone", heading).values
    codes = np.where(amap.solid, SOLID, UNKNOWN).astype(np.uint8)
    counted = parts.counted & (zone != NOT_FREE)
    codes[counted] = zone[counted]
    codes[parts.unexplored] = UNEXPLORED
    codes[parts.unreachable] = UNREACHABLE
    codes[parts.outside] = OUTSIDE
    return codes


def _direction(amap: AmbiguityMap, heading: str | float, parts: JudgedFloor) -> list[list[float]]:
    """Return strokes of the weak direction: x, y of their centres, radians, metres."""
    major, minor, direction, depth = (
        amap.floor(name, heading).values.astype(np.float64)
        for name in ("major", "minor", "direction", "clearance")
    )
    x, y = amap.dataset["x"].values, amap.dataset["y"].values
    strength = np.where(parts.counted, major - minor, np.nan)
    lines = weak_strokes(x, y, direction, strength, depth)
    step = lines[:, 1] - lines[:, 0]
    middle = lines.mean(axis=1)
    angle, length = np.arctan2(step[:, 1], step[:, 0]), np.hypot(step[:, 0], step[:, 1])
    rounded: list[list[float]] = np.column_stack([middle, angle, length]).round(3).tolist()
    return rounded


def _rays(scanner: RangeScanner | None) -> dict[str, Any]:
    """Return all rays of the scanner in the robot frame, see `RayTable`; or none."""
    if scanner is None:
        empty = np.zeros(0, dtype=np.float32)
        names = ("origin", "angle", "max_range", "max_incidence")
        start = base64_of(np.zeros(1, dtype=np.int32))
        return {"start": start, **{name: base64_of(empty) for name in names}}
    rays = scanner.rays()
    limits: Sequence[Floats32] = (rays.max_range, rays.max_incidence)
    far, steep = (np.minimum(limit, FARTHEST).astype(np.float32) for limit in limits)
    return {
        "origin": base64_of(rays.origin.astype(np.float32)),
        "angle": base64_of(rays.angle.astype(np.float32)),
        "start": base64_of(rays.start.astype(np.int32)),
        "max_range": base64_of(far),
        "max_incidence": base64_of(steep),
    }
