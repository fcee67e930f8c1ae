"""Ray casting in a building of prisms: the 2D walk over cells, with heights.

Seen from above, rays of one origin and one azimuth are one ray: it walks the cells of the 2D grid
once, and at each wall that it crosses the heights of all of them are compared with the wall's. The
horizontal faces of a prism are looked up in the cells too, by the height at which a ray is within
the cell: so a table top counts whatever stands on it or under it. Rays of several azimuths walk
together in `wedge`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ambinav.casting.plane.raycast import END
from ambinav.runtime.array_types import Floats, Ints32
from ambinav.runtime.kernels import kernel

# Surfaces are this much wider than drawn, metres: no ray slips through where two of them meet.
SLACK = 1e-9


class PrismArrays(NamedTuple):
    """Arrays of a building for the kernels.

    Surfaces are walls, the bottom and top of solids, floor and ceiling.

    Attributes:
        x0, y0, cell, rows, columns, start, item: The walls in their cells: `SegmentGrid`.
        wall: float64, shape (items, 6): a point of each item's wall, the vector to its other end,
            lowest and highest z, metres.
        face_start: int32: faces in cell k are those of the items face_start[k] to
            face_start[k + 1] - 1; without those at or beyond floor and ceiling.
        face_item: int32, shape (items,): the face of each item.
        face: float64, shape (F, 13): horizontal faces in convex pieces: edges of the piece
            (`Pieces`), and its z, metres.
        face_surface: int32, shape (F,): the surface that it is of.
        body_start: int32: likewise, for solids.
        body: float64, shape (items, 14): edges of the piece, and z of the solid's bottom and top.
        walls: How many surfaces come before the bottom of the first solid.
        floor, ceiling: z of the planes, metres; -inf and inf for none.
        level: z of the horizontal surfaces, those from `walls` on: bottom and top of each solid,
            floor, ceiling; shape (S - walls,), metres.
        normal: Normal of each surface, shape (S, 3).
    """

    x0: float
    y0: float
    cell: float
    rows: int
    columns: int
    start: Ints32
    item: Ints32
    wall: Floats
    face_start: Ints32
    face_item: Ints32
    face: Floats
    face_surface: Ints32
    body_start: Ints32
    body: Floats
    walls: int
    floor: float
    ceiling: float
    level: Floats
    normal: Floats


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


@kernel(_nrt=False)
def within_solid(px, py, pz, scene):
    """Return whether a point lies in a solid, beyond the floor or the ceiling, or is nan."""
    if pz < scene.floor or pz > scene.ceiling or not math.isfinite(px + py):
        return True
    k = _cell_of(px, py, scene)
    if k >= 0:
        for j in range(scene.body_start[k], scene.body_start[k + 1]):
            if scene.body[j, 12] < pz < scene.body[j, 13] and _over(scene.body, j, px, py, 0.0):
                return True
    return False


@kernel(_nrt=False)
def meet_planes(pz, slope, per_slope, best, hit, scene):
    """End the rays at the floor and at the ceiling."""
    floor = scene.normal.shape[0] - 2
    below, above = scene.floor - pz, scene.ceiling - pz
    for i in range(slope.size):
        down = slope[i] < 0.0
        to = (below if down else above) * per_slope[i]
        # For a level ray it is inf or nan.
        ends = (to >= 0.0) & (to < best[i])
        best[i] = to if ends else best[i]
        hit[i] = (floor if down else floor + 1) if ends else -1


@kernel(_nrt=False)
def cast_upright(px, py, pz, rise, reach, scene):
    """Return the distance along a vertical ray, and the surface that it meets."""
    best, hit = reach, -1
    floor = scene.normal.shape[0] - 2
    to = scene.floor - pz if rise < 0.0 else scene.ceiling - pz
    if 0.0 <= to / rise < best:
        best, hit = to / rise, (floor if rise < 0.0 else floor + 1)
    k = _cell_of(px, py, scene)
    if k >= 0:
        for f in scene.face_item[scene.face_start[k] : scene.face_start[k + 1]]:
            t = (scene.face[f, 12] - pz) / rise
            if 0.0 <= t < best and _over(scene.face, f, px, py, -SLACK):
                best, hit = t, scene.face_surface[f]
    return best, hit


@kernel(inline="always")
def _first_from(slope, low):
    """Return the index of the first of ascending slopes that is not less than `low`."""
    first, beyond = 0, slope.size
    while first < beyond:
        middle = (first + beyond) // 2
        if slope[middle] < low:
            first = middle + 1
        else:
            beyond = middle
    return first


@kernel(_nrt=False)
def meet_faces(k, entered, leave, px, py, pz, ux, uy, slope, per_slope, best, hit, scene):
    """End rays at the horizontal faces within cell k; return whether any ray ended."""
    met = False
    face = scene.face
    per_leave, per_entered = 1.0 / (leave + SLACK), 1.0 / max(entered - SLACK, SLACK)
    lowest, highest = slope[0], slope[slope.size - 1]
    for f in scene.face_item[scene.face_start[k] : scene.face_start[k + 1]]:
        # Only rays between these two slopes are at the face's height within the cell.
        above = face[f, 12] - pz
        at_leave, at_enter = above * per_leave, above * per_entered
        low, high = min(at_leave, at_enter), max(at_leave, at_enter)
        if high < lowest or low > highest:
            continue
        for i in range(_first_from(slope, low), slope.size):
            if slope[i] > high:
                break
            s = above * per_slope[i]
            if (s >= 0.0) & (s < best[i]) and _over(
                face, f, px + s * ux[i], py + s * uy[i], -SLACK
            ):
                best[i] = s
                hit[i] = scene.face_surface[f]
                met = True
    return met


@kernel(inline="always")
def length_along(s, hit, pz, flat, rise, scene):
    """Return the length of a ray that travels s metres in the plane, up to surface `hit`."""
    if hit >= scene.walls:
        return (scene.level[hit - scene.walls] - pz) / rise
    return s / flat


@kernel(fastmath={"nnan", "nsz"})
def farthest(best):
    """Return the greatest length of the rays in the plane."""
    far = best[0]
    for i in range(1, best.size):
        far = best[i] if best[i] > far else far
    return far


@kernel(_nrt=False)
def cast_column(px, py, pz, ux, uy, slope, per_slope, best, hit, scene):
    """Walk the cells along a direction until all n rays of a column have ended.

    Args:
        px: Origin, metres.
        py: Origin.
        pz: Origin.
        ux: Unit vector of each ray in the plane, shape (n,), here all the same.
        uy: Likewise.
        slope: Metres that each ray rises in a metre of the plane, ascending, shape (n,).
        per_slope: One over it, inf for 0.
        best: How far each looks, metres in the plane, shape (n,); written: how far it goes.
        hit: Written: the surface that it meets, -1 for none.
        scene: `PrismArrays`.
    """
    meet_planes(pz, slope, per_slope, best, hit, scene)
    start, wall, face_start = scene.start, scene.wall, scene.face_start
    rows, columns, cell = scene.rows, scene.columns, scene.cell
    inverse = 1.0 / cell
    vx, vy = ux[0], uy[0]
    far = farthest(best)
    begun = 0.0
    gx, gy = (px - scene.x0) * inverse, (py - scene.y0) * inverse
    if not ((gx >= 0.0) & (gy >= 0.0) & (gx < columns) & (gy < rows)):
        # As in `cast_from_outside`: start in the grid's margin, which is empty.
        ahead_x = -gx if vx > 0 else gx - columns
        ahead_y = -gy if vy > 0 else gy - rows
        steps = max(ahead_x / max(abs(vx), 1e-12), ahead_y / max(abs(vy), 1e-12), 0.0) + 1e-3
        gx, gy = gx + vx * steps, gy + vy * steps
        begun = steps * cell
        if begun >= far or not ((gx >= 0.0) & (gy >= 0.0) & (gx < columns) & (gy < rows)):
            return
    column, row = int(gx), int(gy)
    step_x, step_y = cell / max(abs(vx), 1e-12), cell / max(abs(vy), 1e-12)
    right, up = vx > 0, vy > 0
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
            if wall[j, 4] > highest or wall[j, 5] < lowest:
                continue
            wx, wy = wall[j, 0] - px, wall[j, 1] - py
            ex, ey = wall[j, 2], wall[j, 3]
            per_cross = 1.0 / (vx * ey - vy * ex)
            s = (wx * ey - wy * ex) * per_cross
            share = (wx * vy - wy * vx) * per_cross
            if (share >= -END) & (share <= 1.0 + END) & (s >= 0.0) & (s < far):
                low, high, w = wall[j, 4] - pz, wall[j, 5] - pz, scene.item[j]
                met = False
                for i in range(slope.size):
                    z = s * slope[i]
                    ends = (z >= low) & (z <= high) & (s < best[i])
                    best[i] = s if ends else best[i]
                    hit[i] = w if ends else hit[i]
                    met |= ends
                if met:
                    far = farthest(best)
        if face_start[k + 1] > face_start[k] and meet_faces(
            k, entered, leave, px, py, pz, ux, uy, slope, per_slope, best, hit, scene
        ):
            far = farthest(best)
        if leave >= far or leave >= end:
            break
        sideways = to_x < to_y
        k += along if sideways else across
        to_x += step_x if sideways else 0.0
        to_y += 0.0 if sideways else step_y
        entered = leave
