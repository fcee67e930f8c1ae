"""Rays in space through a building of prisms: the 2D walk over cells, with heights.

Seen from above, rays of one origin and one azimuth are one ray: it walks the cells of the 2D grid
once, and at each wall that it crosses the heights of all of them are compared with the wall's. The
horizontal faces of a prism are looked up in the cells too, by the height at which a ray is within
the cell: so a table top counts whatever stands on it or under it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.raycasting.raycast import END
from ambinav.kernels import kernel

# Surfaces are this much wider than drawn, metres: no ray slips through where two of them meet.
SLACK = 1e-9
# Cosine of the elevation from which on a ray counts as upright: it then stays above one point.
UPRIGHT = 1e-9


class Columns(NamedTuple):
    """R rays in the robot's frame, in C columns: rays of one origin and azimuth.

    Attributes:
        origin: float64, shape (C, 3), metres.
        cosine: Of the azimuth, shape (C,).
        sine: Of the azimuth, shape (C,).
        start: int64, shape (C + 1,): column c holds the entries start[c] to start[c + 1] - 1.
        ray: int64, shape (R,): which ray each entry is.
        flat: Cosine of each entry's elevation, shape (R,); below `UPRIGHT` alone in its column.
        rise: Sine of its elevation, shape (R,).
        slope: Rise over flat, shape (R,), ascending within a column.
        per_slope: One over it; inf for 0.
    """

    origin: NDArray[np.float64]
    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]
    start: NDArray[np.int64]
    ray: NDArray[np.int64]
    flat: NDArray[np.float64]
    rise: NDArray[np.float64]
    slope: NDArray[np.float64]
    per_slope: NDArray[np.float64]


class PrismArrays(NamedTuple):
    """What the kernels read of a building; surfaces are walls, bottom and top of solids, planes.

    Attributes:
        x0, y0, cell, rows, columns, start, item, line: The walls in their cells: `SegmentGrid`.
        height: float64, shape (items, 2): lowest and highest z of each item's wall, metres.
        face_start: int32: faces in cell k, in convex pieces, are face_start[k] to
            face_start[k + 1] - 1; without those at or beyond floor and ceiling.
        face: float64, shape (items, 13): edges of the piece (`Pieces`), and its z, metres.
        face_surface: int32, shape (items,): the surface that it is of.
        body_start: int32: likewise, for solids.
        body: float64, shape (items, 14): edges of the piece, and z of the solid's bottom and top.
        walls: How many surfaces come before the bottom of the first solid.
        floor, ceiling: z of the planes, metres; -inf and inf for none.
        level: z of the horizontal surfaces, those from `walls` on: bottom and top of each solid,
            floor, ceiling; shape (S - walls,), metres.
        normal: Of each surface, shape (S, 3).
    """

    x0: float
    y0: float
    cell: float
    rows: int
    columns: int
    start: NDArray[np.int32]
    item: NDArray[np.int32]
    line: NDArray[np.float64]
    height: NDArray[np.float64]
    face_start: NDArray[np.int32]
    face: NDArray[np.float64]
    face_surface: NDArray[np.int32]
    body_start: NDArray[np.int32]
    body: NDArray[np.float64]
    walls: int
    floor: float
    ceiling: float
    level: NDArray[np.float64]
    normal: NDArray[np.float64]


@kernel(inline="always")
def _cell_of(px, py, scene):
    gx, gy = (px - scene.x0) / scene.cell, (py - scene.y0) / scene.cell
    if not (gx >= 0.0 and gy >= 0.0 and gx < scene.columns and gy < scene.rows):
        return -1
    return int(gy) * scene.columns + int(gx)


@kernel(inline="always")
def _over(piece, j, x, y, slack):
    return (
        (piece[j, 0] * x + piece[j, 1] * y + piece[j, 2] >= slack)
        & (piece[j, 3] * x + piece[j, 4] * y + piece[j, 5] >= slack)
        & (piece[j, 6] * x + piece[j, 7] * y + piece[j, 8] >= slack)
        & (piece[j, 9] * x + piece[j, 10] * y + piece[j, 11] >= slack)
    )


@kernel
def within_solid(px, py, pz, scene):
    """Whether a point lies in a solid, or beyond the floor or the ceiling, or nowhere: nan."""
    if pz < scene.floor or pz > scene.ceiling or not math.isfinite(px + py):
        return True
    k = _cell_of(px, py, scene)
    if k >= 0:
        for j in range(scene.body_start[k], scene.body_start[k + 1]):
            if scene.body[j, 12] < pz < scene.body[j, 13] and _over(scene.body, j, px, py, 0.0):
                return True
    return False


@kernel
def _planes(pz, slope, per_slope, best, hit, scene):
    """End the rays at the floor and at the ceiling."""
    floor = scene.normal.shape[0] - 2
    below, above = scene.floor - pz, scene.ceiling - pz
    for i in range(slope.size):
        down = slope[i] < 0.0
        to = (below if down else above) * per_slope[i]
        # Of a level ray it is inf, or nan.
        ends = (to >= 0.0) & (to < best[i])
        best[i] = to if ends else best[i]
        hit[i] = (floor if down else floor + 1) if ends else -1


@kernel
def _upright(px, py, pz, rise, reach, scene):
    """Distance of an upright ray, and the surface that it meets."""
    best, hit = reach, -1
    floor = scene.normal.shape[0] - 2
    to = scene.floor - pz if rise < 0.0 else scene.ceiling - pz
    if 0.0 <= to / rise < best:
        best, hit = to / rise, (floor if rise < 0.0 else floor + 1)
    k = _cell_of(px, py, scene)
    if k >= 0:
        for j in range(scene.face_start[k], scene.face_start[k + 1]):
            t = (scene.face[j, 12] - pz) / rise
            if 0.0 <= t < best and _over(scene.face, j, px, py, -SLACK):
                best, hit = t, scene.face_surface[j]
    return best, hit


@kernel
def _faces(k, entered, leave, px, py, pz, ux, uy, slope, per_slope, best, hit, scene):
    """End the rays at the horizontal faces that they meet within cell k; whether any does."""
    met = False
    face = scene.face
    per_leave, per_entered = 1.0 / (leave + SLACK), 1.0 / max(entered - SLACK, SLACK)
    lowest, highest = slope[0], slope[slope.size - 1]
    for j in range(scene.face_start[k], scene.face_start[k + 1]):
        # Only rays between these two slopes are at the face's height within the cell.
        above = face[j, 12] - pz
        one, other = above * per_leave, above * per_entered
        low, high = min(one, other), max(one, other)
        if high < lowest or low > highest:
            continue
        for i in range(slope.size):
            if (slope[i] >= low) & (slope[i] <= high):
                s = above * per_slope[i]
                if (s >= 0.0) & (s < best[i]) and _over(face, j, px + s * ux, py + s * uy, -SLACK):
                    best[i] = s
                    hit[i] = scene.face_surface[j]
                    met = True
    return met


@kernel(inline="always")
def _length(s, hit, pz, flat, rise, scene):
    """Metres along a ray that goes s metres in the plane, up to surface `hit`."""
    if hit >= scene.walls:
        return (scene.level[hit - scene.walls] - pz) / rise
    return s / flat


@kernel(inline="always")
def _farthest(best):
    far = best[0]
    for i in range(1, best.size):
        far = max(far, best[i])
    return far


@kernel
def cast_column(px, py, pz, ux, uy, slope, per_slope, best, hit, scene):
    """Walk the cells along (ux, uy) until all rays of a column have ended.

    Args:
        px: Origin, metres.
        py: Origin.
        pz: Origin.
        ux: Unit vector in the plane.
        uy: Unit vector in the plane.
        slope: Metres that each ray rises in a metre of the plane, ascending, shape (n,).
        per_slope: One over it, inf for 0.
        best: How far each looks, metres in the plane, shape (n,); written: how far it goes.
        hit: Written: the surface that it meets, -1 for none.
        scene: `PrismArrays`.
    """
    _planes(pz, slope, per_slope, best, hit, scene)
    start, line, height, face_start = scene.start, scene.line, scene.height, scene.face_start
    rows, columns, cell = scene.rows, scene.columns, scene.cell
    inverse = 1.0 / cell
    far = _farthest(best)
    begun = 0.0
    gx, gy = (px - scene.x0) * inverse, (py - scene.y0) * inverse
    if not ((gx >= 0.0) & (gy >= 0.0) & (gx < columns) & (gy < rows)):
        # As `cast_from_outside`: into the grid's margin, which holds nothing.
        ahead_x = -gx if ux > 0 else gx - columns
        ahead_y = -gy if uy > 0 else gy - rows
        steps = max(ahead_x / max(abs(ux), 1e-12), ahead_y / max(abs(uy), 1e-12), 0.0) + 1e-3
        gx, gy = gx + ux * steps, gy + uy * steps
        begun = steps * cell
        if begun >= far or not ((gx >= 0.0) & (gy >= 0.0) & (gx < columns) & (gy < rows)):
            return
    column, row = int(gx), int(gy)
    step_x, step_y = cell / max(abs(ux), 1e-12), cell / max(abs(uy), 1e-12)
    right, up = ux > 0, uy > 0
    to_x = begun + (column + 1 - gx if right else gx - column) * step_x
    to_y = begun + (row + 1 - gy if up else gy - row) * step_y
    end_x = to_x + (columns - 1 - column if right else column) * step_x
    end_y = to_y + (rows - 1 - row if up else row) * step_y
    end = min(end_x, end_y) * (1.0 - 1e-9)
    k = row * columns + column
    along, across = (1 if right else -1), (columns if up else -columns)
    entered = begun
    while True:
        leave = min(to_x, to_y)
        # Heights that some ray of the column has within the cell.
        lowest = pz + min(slope[0] * entered, slope[0] * leave) - SLACK
        highest = pz + max(slope[-1] * entered, slope[-1] * leave) + SLACK
        for j in range(start[k], start[k + 1]):
            if height[j, 0] > highest or height[j, 1] < lowest:
                continue
            wx, wy = line[j, 0] - px, line[j, 1] - py
            ex, ey = line[j, 2], line[j, 3]
            per_cross = 1.0 / (ux * ey - uy * ex)
            s = (wx * ey - wy * ex) * per_cross
            share = (wx * uy - wy * ux) * per_cross
            if (share >= -END) & (share <= 1.0 + END) & (s >= 0.0) & (s < far):
                low, high = height[j, 0] - pz, height[j, 1] - pz
                wall = scene.item[j]
                met = False
                for i in range(slope.size):
                    z = s * slope[i]
                    ends = (z >= low) & (z <= high) & (s < best[i])
                    best[i] = s if ends else best[i]
                    hit[i] = wall if ends else hit[i]
                    met |= ends
                if met:
                    far = _farthest(best)
        if face_start[k + 1] > face_start[k] and _faces(
            k, entered, leave, px, py, pz, ux, uy, slope, per_slope, best, hit, scene
        ):
            far = _farthest(best)
        if leave >= far or leave >= end:
            break
        sideways = to_x < to_y
        k += along if sideways else across
        to_x += step_x if sideways else 0.0
        to_y += 0.0 if sideways else step_y
        entered = leave


@kernel
def longest_of(columns):
    """How many rays the longest column has, at least 1."""
    longest = 1
    for c in range(columns.cosine.size):
        longest = max(longest, columns.start[c + 1] - columns.start[c])
    return longest


@kernel(inline="always")
def same_origin(origin, c):
    """Whether column c starts where the one before it does."""
    return (
        (origin[c, 0] == origin[c - 1, 0])
        & (origin[c, 1] == origin[c - 1, 1])
        & (origin[c, 2] == origin[c - 1, 2])
    )


@kernel
def column_ranges(c, low, high, px, py, ux, uy, columns, scene, reach, best, hit):
    """Distances of n rays of column c, which start in nothing solid.

    Args:
        c: Which column.
        low: The first of its entries that is cast.
        high: One past the last of them.
        px: Origin, metres, map frame.
        py: Origin.
        ux: Direction of the column in the plane, unit vector, map frame.
        uy: Likewise.
        columns: See `Columns`.
        scene: See `PrismArrays`.
        reach: How far to look, metres.
        best: Written, shape (n,), metres; inf where nothing is met.
        hit: Written, shape (n,): the surface that is met, -1 for none.
    """
    pz, upright = columns.origin[c, 2], columns.flat[low] < UPRIGHT
    if upright:
        best[0], hit[0] = _upright(px, py, pz, columns.rise[low], reach, scene)
    else:
        for i in range(low, high):
            best[i - low] = reach * columns.flat[i]
        slope, per_slope = columns.slope[low:high], columns.per_slope[low:high]
        cast_column(px, py, pz, ux, uy, slope, per_slope, best, hit, scene)
    for i in range(low, high):
        k = hit[i - low]
        if k < 0:
            best[i - low] = math.inf
        elif not upright:
            best[i - low] = _length(best[i - low], k, pz, columns.flat[i], columns.rise[i], scene)


@kernel(inline="always")
def incidence_at(vx, vy, vz, normal, k):
    """Angle between a ray, a unit vector, and the normal of surface k, radians in [0, pi/2]."""
    nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
    facing = abs(vx * nx + vy * ny + vz * nz)
    cx, cy, cz = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), facing)


@kernel
def scan_columns(begin, end, x, y, theta, columns, scene, reach, distance, surface, incidence):
    """Scans at poses `begin` to `end` - 1; see `Prisms.cast_scans`."""
    longest = longest_of(columns)
    best_of, hit_of = np.empty(longest), np.empty(longest, dtype=np.int64)
    inside = False
    for p in range(begin, end):
        co, si = math.cos(theta[p]), math.sin(theta[p])
        for c in range(columns.cosine.size):
            ox, oy, pz = columns.origin[c, 0], columns.origin[c, 1], columns.origin[c, 2]
            px, py = x[p] + co * ox - si * oy, y[p] + si * ox + co * oy
            low, high = columns.start[c], columns.start[c + 1]
            ux = co * columns.cosine[c] - si * columns.sine[c]
            uy = si * columns.cosine[c] + co * columns.sine[c]
            if c == 0 or not same_origin(columns.origin, c):
                inside = within_solid(px, py, pz, scene)
            best, hit = best_of[: high - low], hit_of[: high - low]
            if inside:
                best[:], hit[:] = math.nan, -1
            else:
                column_ranges(c, low, high, px, py, ux, uy, columns, scene, reach, best, hit)
            for i in range(low, high):
                r, k = columns.ray[i], hit[i - low]
                surface[p, r], distance[p, r] = k, best[i - low]
                if incidence.size > 0:
                    flat = columns.flat[i]
                    incidence[p, r] = math.nan
                    if k >= 0:
                        incidence[p, r] = incidence_at(
                            ux * flat, uy * flat, columns.rise[i], scene.normal, k
                        )


@kernel
def cast_single(begin, end, origin, direction, scene, reach, distance, surface):
    """Rays `begin` to `end` - 1, unit vectors; see `Prisms.cast`."""
    slope, per_slope, best = np.empty(1), np.empty(1), np.empty(1)
    hit = np.empty(1, dtype=np.int64)
    for r in range(begin, end):
        px, py, pz = origin[r, 0], origin[r, 1], origin[r, 2]
        flat, rise = math.hypot(direction[r, 0], direction[r, 1]), direction[r, 2]
        if flat < UPRIGHT:
            distance[r], surface[r] = _upright(px, py, pz, rise, reach, scene)
            continue
        slope[0], best[0] = rise / flat, reach * flat
        per_slope[0] = 1.0 / slope[0]
        ux, uy = direction[r, 0] / flat, direction[r, 1] / flat
        cast_column(px, py, pz, ux, uy, slope, per_slope, best, hit, scene)
        surface[r] = hit[0]
        distance[r] = reach
        if hit[0] >= 0:
            distance[r] = _length(best[0], hit[0], pz, flat, rise, scene)
