"""Collision geometry: the free space without occupied cells, which footprints must not leave.

Rays are cast against fitted walls, which cut through the cells of a rough map and leave out single
cells; a robot must keep off each of these cells. So a second outline is made from the same grid:

1. the fitted free space less the squares of all occupied cells that reach into it, islands and
   all;
2. the steps along slanted walls are cut off from tip to tip (`cut_notches`): that only ever takes
   space away, no point of it further than `NOTCH_CELLS` cells from the outline of 1.

A place of the fitted free space that is further than that from its border and from every occupied
cell is therefore still drivable, and no place in an occupied cell is.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.occupancy_grid import OCCUPIED, OccupancyGrid
from ambinav.geometry.segments import edges_of
from ambinav.runtime.array_types import Floats, Indices, Ints
from ambinav.runtime.kernels import kernel

NOTCH_CELLS: Final = 0.5
"""Maximum depth of the notches that are cut off, in cells."""
# Cells that reach into the free space by less than this, in cells, only touch it.
TOUCH: Final = 1e-6
# A point on the wrong side of a line by at most this, metres, counts as on it: rounding.
ROUNDING: Final = 1e-9
# Maximum number of corners of a notch, and of unusable corners before the search stops.
LONGEST, PATIENCE = 96, 12
# Separate pieces below this area, in cells, may be left out.
SMALL_CELLS: Final = 200.0


def drivable_space(grid: OccupancyGrid, free: BaseGeometry) -> BaseGeometry | None:
    """Compute the part of the free space that footprints may cover, in the map frame.

    Args:
        grid: The occupancy grid that `free` was made from.
        free: The fitted free space, a Polygon or MultiPolygon, map frame, metres.

    Returns:
        A Polygon or MultiPolygon within `free` that overlaps no occupied cell, perhaps empty;
        None if no occupied cell reaches into `free`, so that it is `free` itself.
    """
    rows, columns = intruding_cells(grid, free)
    if len(rows) == 0:
        return None
    corners = [(columns, rows), (columns + 1, rows), (columns + 1, rows + 1), (columns, rows + 1)]
    squares = [np.stack(grid.to_world(u, v), axis=-1) for u, v in corners]
    occupied = shapely.coverage_union_all(shapely.polygons(np.stack(squares, axis=1)))
    parts = shapely.get_parts(shapely.difference(free, occupied))
    parts = parts[shapely.get_dimensions(parts) == 2]
    depth = NOTCH_CELLS * grid.resolution
    # A part that is nowhere deeper than a notch counts as a notch.
    small = np.flatnonzero(shapely.area(parts) < SMALL_CELLS * grid.resolution**2)
    thin = small[shapely.is_empty(shapely.buffer(parts[small], -depth))]
    return cut_notches(shapely.multipolygons(np.delete(parts, thin)), depth)


def intruding_cells(grid: OccupancyGrid, free: BaseGeometry) -> tuple[Indices, Indices]:
    """Return rows and columns of the occupied cells whose inside meets `free` (map frame)."""
    x0, y0, yaw = grid.origin
    c, s = math.cos(yaw), math.sin(yaw)
    edges = (edges_of(free).reshape(-1, 2) - (x0, y0)) / grid.resolution
    edges = (edges @ np.array([[c, -s], [s, c]])).reshape(-1, 4)
    rows, columns = grid.state.shape
    # Whether the number of edges left of a cell's centre changes there, and cells on an edge.
    flips = np.zeros((rows, columns + 1), dtype=np.bool_)
    crossed = np.zeros((rows, columns), dtype=np.bool_)
    _mark(edges, flips, crossed)
    crossed |= np.logical_xor.accumulate(flips, axis=1)[:, :-1]
    crossed &= grid.state == OCCUPIED
    rows_of, columns_of = np.nonzero(crossed)
    return rows_of, columns_of


def cut_notches(space: BaseGeometry, depth: float) -> BaseGeometry:
    """Cut notches off polygons, from tip to tip, where nothing else reaches into them.

    Args:
        space: A MultiPolygon.
        depth: How far a corner that is left out may lie from the line over it, metres.

    Returns:
        A MultiPolygon within `space` (but for `ROUNDING`) whose corners are corners of it.
    """
    polygons = shapely.get_parts(space)
    rings, owner = shapely.get_rings(polygons, return_index=True)
    if len(rings) == 0:
        return space
    # Free space on the left: shells run counter-clockwise, holes clockwise.
    is_shell = np.append(True, owner[1:] != owner[:-1])
    turned = shapely.is_ccw(rings) != is_shell
    rings[turned] = shapely.reverse(rings[turned])
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    # Without the point that closes a ring.
    last = np.append(ring[1:] != ring[:-1], True)
    xy, ring = np.ascontiguousarray(xy[~last]), ring[~last]
    first = np.searchsorted(ring, np.arange(len(rings) + 1))
    after = np.empty(len(xy), dtype=np.int64)
    _bridge(xy, first, depth, after)
    _undo_crossed_bridges(xy, first, ring, after)
    keeps = np.zeros(len(xy), dtype=np.bool_)
    keeps[after[after >= 0]] = True
    few = np.bincount(ring[keeps], minlength=len(rings)) < 3
    keeps |= few[ring]
    made = shapely.linearrings(xy[keeps], indices=ring[keeps])
    holes = np.flatnonzero(~is_shell)
    cut = shapely.multipolygons(
        shapely.polygons(made[is_shell])
        if len(holes) == 0
        else [
            shapely.Polygon(shell, made[holes[owner[holes] == k]].tolist())
            for k, shell in enumerate(made[is_shell])
        ]
    )
    # Never observed; the outline without simplification is valid too.
    return cut if cut.is_valid else space


def _undo_crossed_bridges(xy: Floats, first: Indices, ring: Indices, after: Ints) -> None:
    """Undo, in place, bridges over notches that another corner reaches into."""
    start = np.flatnonzero(after >= 0)
    count = np.diff(first)[ring[start]]
    span = (after[start] - start) % count
    span[span == 0] = count[span == 0]
    start, count, span = start[span > 1], count[span > 1], span[span > 1]
    if len(start) == 0:
        return
    notch = np.repeat(np.arange(len(start)), span + 1)
    step = np.arange(len(notch)) - np.repeat(np.cumsum(span + 1) - span - 1, span + 1)
    low = first[ring[start]]
    index = low[notch] + (start[notch] - low[notch] + step) % count[notch]
    hulls = shapely.convex_hull(shapely.linestrings(xy[index], indices=notch))
    met, corner = shapely.STRtree(shapely.points(xy)).query(hulls, predicate="intersects")
    order = (corner - start[met]) % count[met]
    foreign = (ring[corner] != ring[start[met]]) | (order > span[met])
    for end in (start[met], after[start[met]]):
        foreign &= (xy[corner] != xy[end]).any(axis=1)
    for k in np.unique(met[foreign]):
        i = start[k]
        around = low[k] + (i - low[k] + np.arange(span[k] + 1)) % count[k]
        after[around[:-1]] = around[1:]


@kernel
def _mark(edges, flips, crossed):
    """Mark cells whose inside an edge crosses, and cells along row centres where sides change."""
    rows, columns = crossed.shape
    for e in range(edges.shape[0]):
        ax, ay, bx, by = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        if ay > by:
            ax, ay, bx, by = bx, by, ax, ay
        slope = (bx - ax) / (by - ay) if by > ay else 0.0
        for row in range(max(math.ceil(ay - 0.5), 0), min(math.ceil(by - 0.5), rows)):
            column = math.ceil(ax + slope * (row + 0.5 - ay) - 0.5)
            column = min(max(column, 0), columns)
            flips[row, column] = not flips[row, column]
        low, high = math.floor(ay + TOUCH), math.floor(by - TOUCH)
        for row in range(max(low, 0), min(high, rows - 1) + 1):
            left, right = min(ax, bx), max(ax, bx)
            if by - ay > TOUCH:
                x0 = ax + slope * (max(row + TOUCH, ay) - ay)
                x1 = ax + slope * (min(row + 1 - TOUCH, by) - ay)
                left, right = max(min(x0, x1), left), min(max(x0, x1), right)
            west, east = math.floor(left + TOUCH), math.floor(right - TOUCH)
            for column in range(max(west, 0), min(east, columns - 1) + 1):
                crossed[row, column] = True


@kernel
def _bridge(xy, first, depth, after):
    """Find, for each kept corner, the farthest next corner that can be kept; -1 for the others.

    What lies between the two lies on the right of the line from one to the other, no further
    than `depth` from it, and neither before nor beyond it.
    """
    after[:] = -1
    for ring in range(first.size - 1):
        low, count = first[ring], first[ring + 1] - first[ring]
        i = 0
        while i < count:
            best, failed = i + 1, 0
            ax, ay = xy[low + i, 0], xy[low + i, 1]
            for j in range(i + 2, min(i + LONGEST, count) + 1):
                ex, ey = xy[low + j % count, 0] - ax, xy[low + j % count, 1] - ay
                length = math.sqrt(ex * ex + ey * ey)
                fits = length > 0.0
                for k in range(i + 1, j):
                    if not fits:
                        break
                    wx, wy = xy[low + k, 0] - ax, xy[low + k, 1] - ay
                    left, along = ex * wy - ey * wx, ex * wx + ey * wy
                    fits = (
                        (left <= ROUNDING * length)
                        & (left >= -depth * length)
                        & (along >= 0.0)
                        & (along <= length * length)
                    )
                if fits:
                    best, failed = j, 0
                else:
                    failed += 1
                    if failed > PATIENCE:
                        break
            after[low + i] = low + best % count
            i = best
