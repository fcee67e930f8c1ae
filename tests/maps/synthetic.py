"""A made-up ambiguity map whose every value is known: a room, a corridor and a hall in a row.

    room      x  0 ..  4, y 0 .. 4     localizable everywhere: level 0.1
    corridor  x  4 .. 16, y 1 .. 3     weak along x: major 0.9, minor 0.1
    hall      x 16 .. 26, y 0 .. 10    open in the middle, corridor along its walls

The values do not come from the model: they only have the shape and names that `build_map` gives.
"""

from __future__ import annotations

import json
import math

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray

from ambinav.geometry.collision.reach import reach_of
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

SPACING = 0.1
HALL_RIM = 2.0
"""Width of the corridor zone along the hall's walls, metres."""

# Corners of the outline, counter-clockwise.
OUTLINE = (
    (0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (16.0, 1.0), (16.0, 0.0), (26.0, 0.0),
    (26.0, 10.0), (16.0, 10.0), (16.0, 3.0), (4.0, 3.0), (4.0, 4.0), (0.0, 4.0),
)  # fmt: skip


def segments() -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Walls around the outline; the hall's right side is a frontier."""
    ring = np.array(OUTLINE)
    xy = np.hstack([ring, np.roll(ring, -1, axis=0)])
    kind = np.zeros(len(xy), dtype=np.uint8)
    kind[5] = 1
    return xy, kind


def dataset(headings: int = 0) -> xr.Dataset:
    """The map as `build_map` would give it, with a theta axis if `headings` is above zero."""
    x = np.arange(-0.45, 26.5, SPACING)
    y = np.arange(-0.45, 10.5, SPACING)
    gx, gy = np.meshgrid(x, y)
    room = (gx > 0) & (gx < 4) & (gy > 0) & (gy < 4)
    corridor = (gx >= 4) & (gx <= 16) & (gy > 1) & (gy < 3)
    hall = (gx > 16) & (gx < 26) & (gy > 0) & (gy < 10)
    free = room | corridor | hall
    to_side = np.minimum(gx - 16, 26 - gx)
    to_end = np.minimum(gy, 10 - gy)
    middle = hall & (np.minimum(to_side, to_end) > HALL_RIM)
    corner = hall & (np.maximum(to_side, to_end) < HALL_RIM)
    rim = hall & ~middle & ~corner
    border = corridor & ((gx < 4.5) | (gx > 15.5))

    major = np.select([room | corner, border, corridor | rim, middle], [0.1, 0.5, 0.9, 0.95])
    minor = np.select([room | corner, border, corridor | rim, middle], [0.1, 0.2, 0.1, 0.9])
    zone = np.select([room | corner, border, corridor | rim, middle], [0, 1, 2, 3], NOT_FREE)
    # Along the hall's left and right walls the weak direction is y.
    direction = np.where(rim & (to_side < to_end), math.pi / 2, 0.0)
    xy, kind = segments()
    to_wall = np.min([_distance(gx, gy, wall) for wall in xy], axis=0)

    layers = {
        "ambiguity": 0.5 * major,
        "major": major,
        "minor": minor,
        "major_radius": 0.25 * major,
        "minor_radius": 0.25 * minor,
        "direction": direction,
        "level": 0.5 * (major + minor),
    }
    out = xr.Dataset(coords={"y": y, "x": x})
    for name, values in layers.items():
        floor = np.where(free, values, np.nan)
        if not headings:
            out[name] = (("y", "x"), floor.astype(np.float32))
            continue
        if name == "direction":
            spread = np.repeat(floor[..., None], headings, axis=-1)
        else:
            # Looking along +x is best: factor 0.5 there, 1 the other way.
            factor = 0.75 - 0.25 * np.cos(2 * math.pi * np.arange(headings) / headings)
            spread = floor[..., None] * factor
            for suffix, value in (
                ("mean", spread.mean(-1)), ("best", spread.min(-1)), ("worst", spread.max(-1))
            ):  # fmt: skip
                out[f"{name}_{suffix}"] = (("y", "x"), value.astype(np.float32))
        out[name] = (("y", "x", "theta"), spread.astype(np.float32))
    out["zone"] = (("y", "x"), zone.astype(np.uint8))
    if headings:
        out.coords["theta"] = np.arange(headings) * 2 * math.pi / headings
        out["direction_mean"] = (("y", "x"), np.where(free, direction, np.nan).astype(np.float32))
        out["best_heading"] = (("y", "x"), np.where(free, 0.0, np.nan).astype(np.float32))
        for suffix in ("mean", "best", "worst"):
            out[f"zone_{suffix}"] = out["zone"]
        out["zone"] = out["zone"].expand_dims(theta=out["theta"]).transpose("y", "x", "theta")
    out["free"] = (("y", "x"), free)
    out["clearance"] = (("y", "x"), np.where(free, to_wall, np.nan).astype(np.float32))
    for name in out.data_vars:
        out[name].attrs = {"long_name": str(name), "units": "1"}
    out["segments"] = (("segment", "end"), xy)
    out["segment_kind"] = (("segment",), kind)
    outline = shapely.to_wkb(shapely.Polygon(OUTLINE))
    out["floor"] = (("byte",), np.frombuffer(outline, dtype=np.uint8).copy())
    out.attrs = {
        "title": "Ambiguity map of synthetic",
        "frame": "map",
        "units": "metres, radians",
        "environment": "synthetic",
        "environment_source": "tests/maps/synthetic.py",
        "environment_sha256": "0" * 64,
        "environment_notes": json.dumps(["one ring was not closed"]),
        "scanner": "made-up scanner",
        "scanner_yaml": scanner(headings).to_yaml(),
        "parameters": json.dumps(
            {
                "spacing": SPACING,
                "radius": 0.5,
                "headings": headings or None,
                "tau": 2.0,
                "map_std": 0.02,
                "beams": 60,
                "beams_used": 60,
            }
        ),
        "ambinav_version": "0",
        "created": "2026-01-01T00:00:00Z",
        "versions": json.dumps({"numpy": np.__version__}),
    }
    return out


def for_a_point(data: xr.Dataset, source: str = "dataset") -> AmbiguityMap:
    """A map of the dataset whose explored floor counts up to the walls, as for a tiny robot."""
    amap = AmbiguityMap(data, source=source)
    return amap.for_robot(reach_of(amap.environment, 0.01))


def scanner(headings: int = 0) -> RangeScanner:
    """What the map is said to be for: a laser of 4 m, all around or, with headings, ahead."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    aperture = math.pi if headings else 2.0 * math.pi
    return RangeScanner.planar(sensor=sensor, beams=60, aperture=aperture, name="made-up scanner")


def _distance(
    x: NDArray[np.float64], y: NDArray[np.float64], wall: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance from points to one segment."""
    ax, ay, bx, by = wall
    ux, uy = bx - ax, by - ay
    t = np.clip(((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy), 0.0, 1.0)
    return np.asarray(np.hypot(x - ax - t * ux, y - ay - t * uy))
