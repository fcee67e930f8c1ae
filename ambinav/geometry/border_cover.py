"""Gaps between the segments on the border of a free space, through which rays would escape."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.runtime.array_types import Bools, Floats, Indices, Ints, Ints32

# Metres. A bare stretch shorter than this is rounding.
SHORTEST_BARE = 1e-3
# Metres. An edge of a triangulation lies this near to its wall, from which slits are set off.
ON_WALL = 2e-6


def longest_bare(
    free: BaseGeometry, segments: Floats, near: float
) -> tuple[float, float, float] | None:
    """Find the longest stretch of the border of `free` on which no segment lies.

    Args:
        free: Polygon or MultiPolygon, metres.
        segments: End points, shape (N, 4), metres.
        near: How far a segment may be from the border that it lies on, metres.

    Returns:
        x and y of its middle and its length, metres; None if none reaches `SHORTEST_BARE`.
    """
    xy, ring = shapely.get_coordinates(_rings(free), return_index=True)
    edges = np.hstack([xy[:-1], xy[1:]])[ring[:-1] == ring[1:]]
    edges = edges[~repeated(edges, segments)]
    if not len(edges):
        return None
    owner, start, end = bare_pieces(edges, segments, near)
    run = edges[owner, 2:] - edges[owner, :2]
    a = edges[owner, :2] + start[:, None] * run
    b = edges[owner, :2] + end[:, None] * run
    # Pieces shorter than the rounding of a point are no stretch, but may join others.
    long = (end - start) * np.hypot(*run.T) > 2.0 * near
    if not long.any():
        return None
    lines = shapely.linestrings(np.stack([a[long], b[long]], axis=1))
    stretches = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(lines)))
    lengths = shapely.length(stretches)
    k = int(np.argmax(lengths))
    if lengths[k] < SHORTEST_BARE:
        return None
    middle = shapely.line_interpolate_point(stretches[k], 0.5, normalized=True)
    return float(middle.x), float(middle.y), float(lengths[k])


def _rings(free: BaseGeometry) -> list[BaseGeometry]:
    """Return the rings of all polygons, without the lines and points of an intersection."""
    parts = shapely.get_parts(shapely.get_parts(free))
    return [
        ring
        for part in parts
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]


def repeated(edges: Floats, segments: Floats) -> Bools:
    """Return the edges that equal a segment, bit for bit, in either direction."""

    def keys(lines: Floats) -> list[Hashable]:
        swap = (lines[:, 0] > lines[:, 2]) | (
            (lines[:, 0] == lines[:, 2]) & (lines[:, 1] > lines[:, 3])
        )
        return row_keys(np.where(swap[:, None], lines[:, [2, 3, 0, 1]], lines))

    segment_keys = set(keys(segments))
    return np.array([row in segment_keys for row in keys(edges)], dtype=np.bool_)


def row_keys(rows: Floats) -> list[Hashable]:
    """Return one key per row, equal where all numbers are equal, bit for bit."""
    # + 0.0 makes -0.0 equal to 0.0. A set of keys is faster than sorting.
    plain = np.ascontiguousarray(rows + 0.0)
    return list(plain.view(np.dtype((np.void, plain.itemsize * rows.shape[1]))).ravel().tolist())


def meeting(segments: Floats, bounds: tuple[float, float, float, float]) -> Indices:
    """Return the rows of segments, shape (N, 4), whose bounds meet the given bounds."""
    low = np.minimum(segments[:, :2], segments[:, 2:])
    high = np.maximum(segments[:, :2], segments[:, 2:])
    return np.flatnonzero(((low <= bounds[2:]) & (high >= bounds[:2])).all(axis=1))


def bare_pieces(edges: Floats, segments: Floats, near: float) -> tuple[Ints, Floats, Floats]:
    """Find the pieces of the edges without a segment: edge, and start and end share, 0 to 1."""
    if not len(edges):
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty(0)
    low, high = edges.reshape(-1, 2).min(axis=0) - near, edges.reshape(-1, 2).max(axis=0) + near
    segments = segments[meeting(segments, (low[0], low[1], high[0], high[1]))]
    tree = shapely.STRtree(shapely.linestrings(segments.reshape(-1, 2, 2)))
    lines = shapely.linestrings(edges.reshape(-1, 2, 2))
    edge, segment = tree.query(lines, predicate="dwithin", distance=near)
    origin, run = edges[edge, :2], edges[edge, 2:] - edges[edge, :2]
    length = np.maximum(np.hypot(*run.T), 1e-300)
    along, across = run / length[:, None], (run / length[:, None])[:, ::-1] * [-1.0, 1.0]
    place, off = [], []
    for k in (0, 2):
        away = segments[segment, k : k + 2] - origin
        place.append((away * along).sum(axis=1))
        off.append((away * across).sum(axis=1))
    # The part of the segment that is within `near` of the edge's line.
    rise = off[1] - off[0]
    flat = np.abs(rise) < 1e-300
    with np.errstate(divide="ignore", invalid="ignore"):
        entry_share, exit_share = (-near - off[0]) / rise, (near - off[0]) / rise
    low = np.where(flat, 0.0, np.clip(np.minimum(entry_share, exit_share), 0.0, 1.0))
    high = np.where(flat, 1.0, np.clip(np.maximum(entry_share, exit_share), 0.0, 1.0))
    at_low, at_high = (place[0] + t * (place[1] - place[0]) for t in (low, high))
    first, last = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
    # From covered pieces to bare ones, each edge on a stretch of its own of one long line.
    size = np.hypot(edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1])
    first = np.concatenate([np.clip(first / length, 0.0, 1.0), np.zeros(len(edges))])
    last = np.concatenate([np.clip(last / length, 0.0, 1.0), np.zeros(len(edges))])
    edge = np.concatenate([edge, np.arange(len(edges))])
    order = np.lexsort([first, edge])
    edge, first, last = edge[order], first[order], last[order]
    reached = np.maximum.accumulate(2.0 * edge + last) - 2.0 * edge
    begins = np.append(True, edge[1:] != edge[:-1])
    ends = np.append(begins[1:], True)
    following = np.where(ends, 1.0, np.append(first[1:], 1.0))
    bare = (following > reached) & (size[edge] > 0.0)
    return edge[bare], reached[bare], following[bare]


def owners_of(border: Floats, walls: Floats) -> Ints32:
    """Find the wall on which each border edge of a triangulation lies.

    Args:
        border: End points of edges, shape (K, 4), metres.
        walls: End points of walls, shape (N, 4), metres.

    Returns:
        Index of the wall, int32, shape (K,).
    """
    lines = shapely.linestrings(walls.reshape(-1, 2, 2))
    tree = shapely.STRtree(lines)
    middles = shapely.points((border[:, :2] + border[:, 2:]) / 2)
    owner = np.asarray(tree.nearest(middles), dtype=np.int32)

    def apart(edge: Indices, wall: Indices | Ints32) -> Floats:
        ends = (shapely.points(border[edge, k : k + 2]) for k in (0, 2))
        away = (shapely.distance(end, lines[wall]) for end in ends)
        return np.asarray(np.maximum(*away), dtype=np.float64)

    # Where an end of another wall lies at the middle of an edge, that one may be the nearest.
    wrong = np.flatnonzero(apart(np.arange(len(border)), owner) > ON_WALL)
    edge, wall = tree.query(middles[wrong], predicate="dwithin", distance=ON_WALL)
    away = apart(wrong[edge], wall)
    order = np.lexsort((-away, edge))
    owner[wrong[edge[order]]] = wall[order]
    return owner


def lines_of(border: Floats, walls: Floats) -> Floats:
    """Return for each border edge the line of its wall, in the edge's direction.

    Args:
        border: End points of edges, shape (K, 4), metres.
        walls: End points of the wall that each lies on, shape (K, 4), metres.

    Returns:
        End points, shape (K, 4): of the wall, or of the edge itself where it closes a slit's end
        and so lies across its wall.
    """
    edge, wall = border[:, 2:] - border[:, :2], walls[:, 2:] - walls[:, :2]
    along = (edge * wall).sum(axis=1)
    across = edge[:, 0] * wall[:, 1] - edge[:, 1] * wall[:, 0]
    directed = np.where((along < 0.0)[:, None], walls[:, [2, 3, 0, 1]], walls)
    parallel = np.abs(along) > np.abs(across)
    return np.ascontiguousarray(np.where(parallel[:, None], directed, border))
