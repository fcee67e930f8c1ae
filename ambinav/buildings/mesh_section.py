"""Horizontal section of a triangle mesh, as areas and lines."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.runtime.array_types import Bools, Floats, Ints

GRAIN: Final = 1e-6
"""Metres; to this grid the corners of a section are rounded."""
# Metres. What is left of a section's lines beside its areas is rounding below this length.
_SHORTEST: Final = 1e-2


def cut_lines(vertices: Floats, faces: Ints, height: float) -> Floats:
    """Compute the lines in which a plane z = height cuts the triangles.

    A corner on the plane counts as above it, so that a closed mesh gives closed outlines.

    Args:
        vertices: Shape (V, 3), metres.
        faces: Indices of corners, shape (F, 3), all faces seen from outside in the same sense.
        height: Height of the plane, metres.

    Returns:
        Segments ax, ay, bx, by, shape (n, 4), metres, the inside on the same side of each.
    """
    above = vertices[:, 2] >= height
    count = above[faces].sum(axis=1)
    met = faces[(count == 1) | (count == 2)]
    if not len(met):
        return np.empty((0, 4))
    sides = above[met]
    upper = sides.sum(axis=1) == 1
    lone = np.argmax(sides == upper[:, np.newaxis], axis=1)
    rows = np.arange(len(met))
    corner, left, right = (met[rows, (lone + k) % 3] for k in range(3))
    a = _crossing(vertices, corner, left, above, height)
    b = _crossing(vertices, corner, right, above, height)
    segments = np.where(upper[:, np.newaxis], np.hstack([a, b]), np.hstack([b, a]))
    lines: Floats = segments[(segments[:, :2] != segments[:, 2:]).any(axis=1)]
    return lines


def section(vertices: Floats, faces: Ints, height: float) -> tuple[BaseGeometry, BaseGeometry]:
    """Compute the section of a body with a plane z = height.

    A cell of the section is within the body if its generalized winding number (Jacobson, Kavan and
    Sorkine-Hornung 2013) is above one half, so that parts that overlap are one area and small leaks
    do no harm; or, as some files turn faces the wrong way round, if a line from it crosses closed
    outlines an odd number of times.

    Args:
        vertices: Shape (V, 3), metres.
        faces: Shape (F, 3).
        height: Height of the plane, metres.

    Returns:
        The area, a (Multi)Polygon, and the lines of faces that enclose none, a (Multi)LineString;
        either may be empty.
    """
    segments = np.round(cut_lines(vertices, faces, height) / GRAIN) * GRAIN
    segments = segments[(segments[:, :2] != segments[:, 2:]).any(axis=1)]
    if not len(segments):
        return shapely.MultiPolygon(), shapely.MultiLineString()
    noded = shapely.union_all(shapely.linestrings(segments.reshape(-1, 2, 2)), grid_size=GRAIN)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded).tolist()))
    inner = shapely.get_coordinates(shapely.point_on_surface(cells))
    within = np.abs(_winding(inner, segments)) > 0.5
    if _is_closed(segments):
        within |= _is_odd(inner, segments)
    area = shapely.union_all(cells[within])
    pieces = shapely.get_parts(noded)
    middles = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
    bare = pieces[~shapely.dwithin(area, middles, 10.0 * GRAIN)]
    lines = shapely.get_parts(shapely.line_merge(shapely.MultiLineString(bare.tolist()))).tolist()
    return area, shapely.MultiLineString([line for line in lines if line.length > _SHORTEST])


def _crossing(vertices: Floats, start: Ints, end: Ints, above: Bools, height: float) -> Floats:
    """Compute where edges cross the plane, shape (n, 2).

    Both faces of an edge give the same result, bit for bit.
    """
    high = np.where(above[start], start, end)
    low = np.where(above[start], end, start)
    a, b = vertices[low], vertices[high]
    share = ((height - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, np.newaxis]
    crossing: Floats = a[:, :2] + share * (b[:, :2] - a[:, :2])
    return crossing


def _winding(points: Floats, segments: Floats) -> Floats:
    """Compute the winding number of the segments around each point, shape (n,)."""
    a = segments[np.newaxis, :, :2] - points[:, np.newaxis]
    b = segments[np.newaxis, :, 2:] - points[:, np.newaxis]
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    turns: Floats = np.arctan2(cross, (a * b).sum(axis=-1)).sum(axis=1) / (2 * np.pi)
    return turns


def _is_closed(segments: Floats) -> bool:
    """Return whether an even number of segments meets at each end point."""
    _, count = np.unique(segments.reshape(-1, 2), axis=0, return_counts=True)
    return bool((count % 2 == 0).all())


def _is_odd(points: Floats, segments: Floats) -> Bools:
    """Return whether a line from each point along x crosses an odd number of segments, (n,)."""
    x, y = points[:, :1], points[:, 1:]
    ax, ay, bx, by = segments.T
    across = (ay > y) != (by > y)
    run = np.where(by == ay, 1.0, by - ay)
    odd: Bools = (across & (x < ax + (y - ay) / run * (bx - ax))).sum(axis=1) % 2 == 1
    return odd
