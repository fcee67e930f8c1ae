"""Bodies of walls, built from the lines that a drawing has for their faces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.mesh_section import GRAIN
from ambinav.runtime.array_types import Floats

THICKEST: Final = 0.6
"""Metres; a closed outline of which more than `PIERS` is wider is a room and no wall."""
PIERS: Final = 0.25
"""Share of the area of walls, all that are joined, that wider parts may have: piers, corners."""
JOIN: Final = 0.01
"""Metres; a line that ends this near to another one meets it."""
# Cosine of the angle between a wall and its end, at most.
_SQUARE: Final = 0.2
_EYES: Final = 10.0 * GRAIN


def noded(lines: Sequence[Floats]) -> BaseGeometry:
    """Split lines where they meet; each is given by its corners, shape (n, 2), metres.

    Ends that miss another line by up to `JOIN` are led to it.
    """
    if not lines:
        return shapely.MultiLineString()
    shapes = [shapely.LineString(line) for line in lines]
    net = shapely.union_all(shapes, grid_size=GRAIN)
    ends, _ = _loose_ends(net)
    if not len(ends):
        return net
    pieces = shapely.get_parts(net)
    tree = shapely.STRtree(pieces)
    bridges = []
    for end in shapely.points(ends):
        near = tree.query(end, predicate="dwithin", distance=JOIN)
        others = pieces[near][shapely.distance(pieces[near], end) > _EYES]
        if len(others):
            bridges.append(shapely.shortest_line(end, min(others, key=end.distance)))
    net = shapely.union_all([net, *bridges], grid_size=GRAIN)
    # What crosses a line by so little is no wall.
    ends, lengths = _loose_ends(net)
    tails = {
        tuple(end) for end, length in zip(ends.tolist(), lengths, strict=True) if length < JOIN
    }
    long_pieces = [
        piece
        for piece in shapely.get_parts(net)
        if piece.length >= JOIN or not {piece.coords[0], piece.coords[-1]} & tails
    ]
    return shapely.union_all(long_pieces)


def capped(net: BaseGeometry) -> BaseGeometry:
    """Close the ends of walls that are drawn as two open lines.

    Two loose ends are joined if each is the other's nearest, no further than `THICKEST`, and
    the joint is square to both lines.
    """
    ends, _ = _loose_ends(net)
    if len(ends) < 2:
        return net
    away = _directions(net, ends)
    apart = ends[:, np.newaxis] - ends[np.newaxis]
    length = np.hypot(apart[..., 0], apart[..., 1])
    np.fill_diagonal(length, np.inf)
    along = np.abs((apart * away[:, np.newaxis]).sum(-1)) / np.maximum(length, GRAIN)
    fits = (length <= THICKEST) & (along <= _SQUARE) & (along.T <= _SQUARE)
    fits &= away @ away.T > 0.0
    length[~fits] = np.inf
    nearest = length.argmin(axis=1)
    caps = [
        shapely.LineString(ends[[i, j]])
        for i, j in enumerate(nearest.tolist())
        if i < j and nearest[j] == i and np.isfinite(length[i, j])
    ]
    return shapely.union_all([net, *caps], grid_size=GRAIN) if caps else net


def bodies_in(net: BaseGeometry, widest: float | None = THICKEST) -> list[BaseGeometry]:
    """Return closed outlines no wider than `widest`, apart from piers; None: all of them."""
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(net).tolist()))
    if widest is None:
        return list(faces)
    inner = shapely.buffer(faces, -0.5 * widest, join_style="mitre")
    wide = shapely.area(shapely.buffer(inner, 0.5 * widest, join_style="mitre"))
    return list(faces[wide <= PIERS * shapely.area(faces)])


def beside(net: BaseGeometry, bodies: Sequence[BaseGeometry]) -> list[BaseGeometry]:
    """Return lines that neither border bodies nor lie in them: walls without thickness."""
    lines = net
    if bodies:
        solid = shapely.union_all(list(bodies))
        pieces = shapely.get_parts(shapely.union_all([net, shapely.boundary(solid)]))
        # Whole pieces: what is cut by a body ends on it.
        middles = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
        lines = shapely.multilinestrings(pieces[~shapely.dwithin(solid, middles, _EYES)])
    if lines.is_empty:
        return []
    return [line for line in shapely.get_parts(shapely.line_merge(lines)) if line.length > JOIN]


def _loose_ends(net: BaseGeometry) -> tuple[Floats, Floats]:
    """Return ends of lines at which no other begins, (n, 2), and the lengths of their lines."""
    pieces = shapely.get_parts(net)
    if not len(pieces):
        return np.empty((0, 2)), np.empty(0)
    both = np.array([[piece.coords[0], piece.coords[-1]] for piece in pieces]).reshape(-1, 2)
    _, where, count = np.unique(both, axis=0, return_inverse=True, return_counts=True)
    lengths = np.repeat(shapely.length(pieces), 2)
    loose = count[where.reshape(-1)] == 1
    return both[loose], lengths[loose]


def _directions(net: BaseGeometry, ends: Floats) -> Floats:
    """Return unit vectors in which lines arrive at their loose ends, shape (n, 2)."""
    arrive = {}
    for piece in shapely.get_parts(net):
        xy = shapely.get_coordinates(piece)
        arrive[tuple(xy[0].tolist())] = xy[0] - xy[1]
        arrive[tuple(xy[-1].tolist())] = xy[-1] - xy[-2]
    vectors = np.array([arrive[tuple(end)] for end in ends.tolist()])
    units: Floats = vectors / np.hypot(vectors[:, 0], vectors[:, 1])[:, np.newaxis]
    return units
