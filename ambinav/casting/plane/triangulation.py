"""Constrained Delaunay triangulation of the free space, as half-edges that a ray walks through.

From inside a triangle a ray leaves through one of its edges; which one, one cross product tells.
A beam of neighbouring rays takes the same path until a corner splits it, so a whole scan costs
little more than the triangles that it sees (triangular expansion: Bungiu et al. 2014,
"Efficient computation of visibility polygons").
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.runtime.array_types import Bools, Floats, Ints32
from ambinav.runtime.kernels import kernel

# Half the width in metres of the slit that stands for a wall without thickness: far below
# float32 at the size of a building, far above float64.
SLIT = 1e-6
MAX_CELLS = 4_000_000
# Metres. Buildings farther from the map's origin are cut along their thin walls near it, to this
# many binary places below the largest coordinate, of the 53 that a float has.
FAR, PLACES = 1e4, 50
# Metres. Corners that GEOS cannot triangulate are rounded to this, about a nanometre.
FINEST = 2.0**-30
# Columns of `Triangulation.hops`.
LEFT, RIGHT = 4, 5
# Sine of the angle between ray and edge below which they count as parallel.
PARALLEL = 1e-7
# The same between a ray that starts on an edge and this edge.
ALONG = 1e-9


class MeshArrays(NamedTuple):
    """Arrays of a triangulation from which kernels walk rays through it.

    Attributes:
        segment: int32, shape (K,): the environment's segment that each border edge is part of.
        border: float64, shape (K, 4): end points of the border edges on that segment's line.
        twin: See `Triangulation`, as are node, hops and corner.
        grid: What `locate` takes after a point: `Triangulation.index`.
    """

    segment: Ints32
    border: Floats
    twin: Ints32
    node: Floats
    hops: Ints32
    corner: Floats
    grid: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangles of the free space; half-edge 3 t + e runs from corner e to corner e + 1 of t.

    Attributes:
        corner: float64, shape (3 T, 2): the start of each half-edge, counter-clockwise.
        twin: int32, shape (3 T,): the half-edge on the other side, or -1 - k at border edge k.
        node: float64, shape (3 T, 4): what a ray needs that enters through the half-edge, in one
            line of the cache: columns 0 and 1 the opposite corner (the apex), and in the bytes
            of column 2 where to go left and right of it (see `hops`).
        border: float64, shape (K, 4): end points of the border edges, free space on the left.
        origin, cell, shape, start, item: a grid of the triangles that touch each square cell.
        triangle: float64, shape (items, 6): the corners of each item, side by side.
    """

    corner: Floats
    twin: Ints32
    node: Floats
    border: Floats
    origin: tuple[float, float]
    cell: float
    shape: tuple[int, int]
    start: Ints32
    item: Ints32
    triangle: Floats

    @classmethod
    def build(cls, free: BaseGeometry, thin_walls: Floats) -> Triangulation:
        """Triangulate `free` (polygons), cut along `thin_walls` (shape (N, 4), end points)."""
        shift, far = np.zeros(2), float(np.abs(free.bounds).max())
        if len(thin_walls):
            if far > FAR:
                # GEOS may snap to a millionth of a millionth of the largest coordinate, which is
                # wider than a slit at national coordinates. Whole metres round no coordinate.
                shift = np.round(shapely.get_coordinates(free)[0])
                free = shapely.transform(free, lambda points: points - shift)
            lines = shapely.linestrings(thin_walls.reshape(-1, 2, 2) - shift)
            slits = shapely.union_all(shapely.buffer(lines, SLIT, quad_segs=1, cap_style="square"))
            free = free.difference(slits)
            if far > FAR:
                # New corners too are to stay apart where they are shifted back.
                free = shapely.set_precision(free, 2.0 ** (math.ceil(math.log2(far)) - PLACES))
        try:
            found = shapely.constrained_delaunay_triangles(free)
        except shapely.GEOSException:  # corners that differ by what is rounded
            found = shapely.constrained_delaunay_triangles(shapely.set_precision(free, FINEST))
        triangles = shapely.get_parts(found)
        points = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
        # GEOS gives all of them one turn. That of each is not to be computed: of those without an
        # area, where corners differ by what is rounded, it would be a matter of chance.
        if turns(*points.swapaxes(0, 1)).sum() < 0.0:
            points = points[:, [0, 2, 1]]
        return cls.from_triangles(points + shift)

    @classmethod
    def from_triangles(cls, points: Floats) -> Triangulation:
        """Join counter-clockwise triangles, shape (T, 3, 2), along the edges that two share."""
        turn = turns(*points.swapaxes(0, 1))
        corner = np.ascontiguousarray(points.reshape(-1, 2))
        _, name = np.unique(corner, axis=0, return_inverse=True)
        count = len(corner)
        half = np.arange(count)
        following = half // 3 * 3 + (half + 1) % 3
        previous = half // 3 * 3 + (half + 2) % 3
        size = int(name.max()) + 1
        key = name.astype(np.int64) * size + name[following]
        order = np.argsort(key)
        back = name[following].astype(np.int64) * size + name
        place = np.minimum(np.searchsorted(key[order], back), count - 1)
        twin = np.where(key[order][place] == back, order[place], -1)
        open_edges = np.flatnonzero(twin < 0)
        twin[open_edges] = -1 - np.arange(len(open_edges))
        border = np.hstack([corner[open_edges], corner[following[open_edges]]])
        node = np.zeros((count, 4))
        node[:, :2] = corner[previous]
        node.view(np.int32)[:, LEFT] = twin[previous]
        node.view(np.int32)[:, RIGHT] = twin[following]
        lower, upper = corner.min(axis=0), corner.max(axis=0)
        width, height = upper - lower
        # About two triangles a cell: flat between half and twice this value.
        cell = 0.5 * math.sqrt(float(np.abs(turn).sum()) / 2 / len(turn))
        cell = max(cell, math.sqrt(width * height / MAX_CELLS), max(width, height) / MAX_CELLS)
        rows, columns = int(height / cell) + 3, int(width / cell) + 3
        origin = lower - cell
        counts = np.zeros(rows * columns + 1, dtype=np.int64)
        sort_triangles(corner, origin, cell, columns, counts, np.empty(0, dtype=np.int32))
        start = np.cumsum(counts)
        item = np.empty(int(start[-1]), dtype=np.int32)
        sort_triangles(corner, origin, cell, columns, start[:-1].copy(), item)
        return cls(
            corner,
            twin.astype(np.int32),
            node,
            np.ascontiguousarray(border),
            (float(origin[0]), float(origin[1])),
            cell,
            (rows, columns),
            start.astype(np.int32),
            item,
            np.ascontiguousarray(corner.reshape(-1, 6)[item]),
        )

    @property
    def hops(self) -> Ints32:
        """View of `node` as int32, shape (3 T, 8); `LEFT` and `RIGHT` are coded as `twin` is."""
        return self.node.view(np.int32)

    @property
    def index(self) -> tuple[Any, ...]:
        """Arguments of `locate` after the point, in their order."""
        return (*self.origin, self.cell, *self.shape, self.start, self.item, self.triangle)

    def arrays(self, segment: Ints32, border: Floats) -> MeshArrays:
        """Return the mesh for kernels, with segment and line of each border edge."""
        return MeshArrays(segment, border, self.twin, self.node, self.hops, self.corner, self.index)

    def contains(self, x: Floats, y: Floats) -> Bools:
        """Return whether each point, shape (N,), lies in the free space or on its border."""
        inside = np.empty(len(x), dtype=np.bool_)
        _contains(x, y, self.index, inside)
        return inside


def turns(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the cross product of b - a and c - a, shape (N, 2) each: positive for a left turn."""
    turn: Floats = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return turn


@kernel
def sort_triangles(corner, origin, cell, columns, cursor, item):
    """Count items into cursor[k + 1] if `item` is empty, else write them and advance cursor[k]."""
    for t in range(corner.shape[0] // 3):
        x = corner[3 * t : 3 * t + 3, 0] - origin[0]
        y = corner[3 * t : 3 * t + 3, 1] - origin[1]
        for row in range(int(y.min() / cell), int(y.max() / cell) + 1):
            for column in range(int(x.min() / cell), int(x.max() / cell) + 1):
                # An edge parts triangle and cell if the cell's innermost corner lies outside it.
                meets = True
                for e in range(3):
                    f = (e + 1) % 3
                    ex, ey = x[f] - x[e], y[f] - y[e]
                    qx = (column + (1 if ey < 0 else 0)) * cell - x[e]
                    qy = (row + (1 if ex > 0 else 0)) * cell - y[e]
                    meets &= ex * qy - ey * qx >= -1e-9
                if meets:
                    k = row * columns + column
                    if item.size > 0:
                        item[cursor[k]] = t
                        cursor[k] += 1
                    else:
                        cursor[k + 1] += 1


@kernel(inline="always")
def locate(px, py, x0, y0, cell, rows, columns, start, item, triangle):
    """Return the triangle that holds the point, or -1."""
    gx, gy = (px - x0) / cell, (py - y0) / cell
    if not (gx >= 0.0 and gy >= 0.0 and gx < columns and gy < rows):
        return -1
    k = int(gy) * columns + int(gx)
    for j in range(start[k], start[k + 1]):
        ax, ay = triangle[j, 0] - px, triangle[j, 1] - py
        bx, by = triangle[j, 2] - px, triangle[j, 3] - py
        cx, cy = triangle[j, 4] - px, triangle[j, 5] - py
        if (ax * by - ay * bx >= 0) & (bx * cy - by * cx >= 0) & (cx * ay - cy * ax >= 0):
            return item[j]
    return -1


@kernel
def _edge_ahead(px, py, ux, uy, t, corner, right):
    """Return the edge through which a ray leaves triangle t that runs along one of its edges.

    It leaves at the corner ahead on its line; the rest of the triangle is on its right or left.
    From a corner that the ray leaves the triangle at, any edge will do: it stands on a wall.
    """
    for k in range(3):
        wx, wy = corner[3 * t + k, 0] - px, corner[3 * t + k, 1] - py
        along = wx * ux + wy * uy
        if along > 0.0 and abs(wx * uy - wy * ux) <= ALONG * along:
            return (k + 2) % 3 if right else k
    return 2


@kernel(inline="always")
def first_edge(px, py, ux, uy, t, corner):
    """Return the edge of triangle t through which the ray leaves it."""
    h = 3 * t
    a = (corner[h, 0] - px) * uy - (corner[h, 1] - py) * ux >= 0
    b = (corner[h + 1, 0] - px) * uy - (corner[h + 1, 1] - py) * ux >= 0
    c = (corner[h + 2, 0] - px) * uy - (corner[h + 2, 1] - py) * ux >= 0
    if (a == b) & (b == c):
        return _edge_ahead(px, py, ux, uy, t, corner, a)
    return 0 if (a & (not b)) else (1 if (b & (not c)) else 2)


@kernel
def _contains(x, y, index, inside):
    x0, y0, cell, rows, columns, start, item, triangle = index
    for i in range(x.size):
        inside[i] = locate(x[i], y[i], x0, y0, cell, rows, columns, start, item, triangle) >= 0


@kernel(inline="always")
def border_distance(px, py, ux, uy, border, k):
    """Return the distance along the ray to border edge k's line, or near the edge if parallel."""
    ax, ay = border[k, 0] - px, border[k, 1] - py
    ex, ey = border[k, 2] - border[k, 0], border[k, 3] - border[k, 1]
    cross = ux * ey - uy * ex
    distance = (ax * ey - ay * ex) / cross if cross != 0.0 else -math.inf
    if abs(cross) > PARALLEL * (abs(ex) + abs(ey)):
        return distance
    # Where they meet is a matter of rounding, but it is on the edge and ahead.
    start = ax * ux + ay * uy
    end = start + ex * ux + ey * uy
    return max(min(distance, max(start, end)), min(start, end), 0.0)
