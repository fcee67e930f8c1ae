"""Writer of a building as a GeoJSON plan, which `load_environment` reads again."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry import mapping

from ambinav.geometry.environment import Environment
from ambinav.geometry.map_frame import MAP_FRAME


def plan_geojson(environment: Environment) -> dict[str, Any]:
    """Return a building as a FeatureCollection: rooms, thin walls, openings and reflectors.

    What is read of it has the same free space and the same segments, up to where collinear ones
    begin and end and pieces below a centimetre. Occupied cells beside the free space
    (`Environment.drivable`) are left out.
    """
    segments = environment.segments
    bright = {tuple(row) for row in segments.xy[segments.reflectors].tolist()}
    thin = [row for row in environment.thin_walls.tolist() if tuple(row) not in bright]
    return {
        "type": "FeatureCollection",
        **MAP_FRAME,
        "features": [
            *(_feature("room", room) for room in shapely.get_parts(environment.free)),
            *_lines("wall", thin),
            *_lines("opening", segments.xy[~segments.walls]),
            *_lines("reflector", sorted(bright)),
        ],
    }


def _lines(kind: str, rows: ArrayLike) -> list[dict[str, Any]]:
    """Return segments as features; connected segments form one line."""
    pieces = shapely.linestrings(np.asarray(rows, dtype=np.float64).reshape(-1, 2, 2))
    merged = shapely.line_merge(shapely.multilinestrings(pieces))
    return [_feature(kind, line) for line in shapely.get_parts(merged)]


def _feature(kind: str, shape: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": mapping(shape)}
