"""Rays of several azimuths that walk together through prisms, as a wedge on the plan.

Of a tilted scanner, or one whose pattern does not repeat, hardly two rays have one azimuth, so that
no two are one ray when seen from above. Neighbours still pass nearly the same cells. They go strip
by strip, a strip being one row or column of cells across their way; the walls in the cells that the
wedge of them touches are compared with all of them at once.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.plane.raycast import END
from ambinav.casting.prisms.kernel import SLACK, farthest, meet_planes
from ambinav.runtime.kernels import kernel

# The wedge is this much wider than its outer rays, metres and cells: what they touch is in it.
MARGIN = 1e-6


@kernel
def no_marks(packets, scene):
    """Return the packet that walls and faces were last compared with, and how many there were: 0.

    Columns are not marked: where all packets are columns there is room for the number alone.
    """
    marked = 0 if packets.column.all() else scene.walls + scene.face.shape[0]
    return np.zeros(marked + 1, dtype=np.int32)


@kernel(inline="always")
def _intersect_wall(wx, wy, ex, ey, low, high, wall, ux, uy, slope, best, hit):
    """End rays at a wall from (wx, wy) by (ex, ey), from the origin; return whether any ended."""
    met = False
    base = wx * ey - wy * ex
    for i in range(slope.size):
        per_cross = 1.0 / (ux[i] * ey - uy[i] * ex)
        s = base * per_cross
        share = (wx * uy[i] - wy * ux[i]) * per_cross
        z = s * slope[i]
        ends = (
            (share >= -END) & (share <= 1.0 + END) & (s >= 0.0) & (s < best[i])
            & (z >= low) & (z <= high)
        )  # fmt: skip
        best[i] = s if ends else best[i]
        hit[i] = wall if ends else hit[i]
        met |= ends
    return met


@kernel(inline="always")
def _intersect_face(px, py, above, face, surface, ux, uy, per_slope, best, hit):
    """End rays at a horizontal face so far above the origin; return whether any ended."""
    met = False
    a0, b0, a1, b1 = face[0], face[1], face[3], face[4]
    a2, b2, a3, b3 = face[6], face[7], face[9], face[10]
    c0, c1 = a0 * px + b0 * py + face[2], a1 * px + b1 * py + face[5]
    c2, c3 = a2 * px + b2 * py + face[8], a3 * px + b3 * py + face[11]
    for i in range(ux.size):
        s = above * per_slope[i]
        x, y = s * ux[i], s * uy[i]
        ends = (
            (s >= 0.0) & (s < best[i])
            & (a0 * x + b0 * y + c0 >= -SLACK) & (a1 * x + b1 * y + c1 >= -SLACK)
            & (a2 * x + b2 * y + c2 >= -SLACK) & (a3 * x + b3 * y + c3 >= -SLACK)
        )  # fmt: skip
        best[i] = s if ends else best[i]
        hit[i] = surface if ends else hit[i]
        met |= ends
    return met


@kernel(fastmath={"nnan", "nsz"})
def _fan(across, along):
    """Return the extremes of rays' leans, and of their lengths in a unit along the axis."""
    left, right, least, most = math.inf, -math.inf, math.inf, 0.0
    for i in range(along.size):
        size = abs(along[i])
        lean = across[i] / size
        left, right = min(left, lean), max(right, lean)
        least, most = min(least, size), max(most, size)
    return left, right, 1.0 / most, 1.0 / least


@kernel(_nrt=False)
def cast_wedge(px, py, pz, ux, uy, slope, per_slope, best, hit, scene, seen):
    """Walk the strips of cells across a packet's path until all of its n rays have ended.

    Args: as `cast_column`'s, but the directions differ, by less than a right angle, and:
        seen: See `no_marks`; what lies in several cells is compared once.
    """
    meet_planes(pz, slope, per_slope, best, hit, scene)
    start, wall, face_start, face = scene.start, scene.wall, scene.face_start, scene.face
    gx, gy = (px - scene.x0) / scene.cell, (py - scene.y0) / scene.cell
    # The rays go along axis a, and across it by their lean.
    upward = abs(uy[0]) > abs(ux[0])
    if upward:
        ga, gb, count_a, count_b = gy, gx, scene.rows, scene.columns
        step_a, step_b = scene.columns, 1
    else:
        ga, gb, count_a, count_b = gx, gy, scene.columns, scene.rows
        step_a, step_b = 1, scene.columns
    forward = (uy[0] if upward else ux[0]) > 0.0
    left, right, shortest, longest = _fan(ux if upward else uy, uy if upward else ux)
    flattest, steepest = slope[0], slope[slope.size - 1]
    far = farthest(best)
    seen[-1] += 1
    mark = seen[-1]
    strip = max(int(ga), 0) if forward else min(int(ga), count_a - 1)
    while 0 <= strip < count_a:
        # Cells that the rays have gone along a when they enter the strip, and when they leave it.
        into = max(strip - ga if forward else ga - strip - 1.0, 0.0)
        out = strip + 1.0 - ga if forward else ga - strip
        entered, leave = into * scene.cell * shortest, out * scene.cell * longest
        if entered >= far:
            break
        first = max(int(math.floor(gb + min(left * into, left * out) - MARGIN)), 0)
        last = min(int(math.floor(gb + max(right * into, right * out) + MARGIN)), count_b - 1)
        # Heights that some ray has within the strip.
        lowest = pz + min(flattest * entered, flattest * leave) - SLACK
        highest = pz + max(steepest * entered, steepest * leave) + SLACK
        met = False
        # Cells of a row lie next to each other, and are read as one.
        width = max(last + 1 - first, 1) if upward else 1
        for across in range(first, last + 1, width):
            k = strip * step_a + across * step_b
            for j in range(start[k], start[k + width]):
                w = scene.item[j]
                if seen[w] == mark or wall[j, 4] > highest or wall[j, 5] < lowest:
                    continue
                wx, wy = wall[j, 0] - px, wall[j, 1] - py
                ex, ey = wall[j, 2], wall[j, 3]
                wa, wb = (wy, wx) if upward else (wx, wy)
                ea, eb = (ey, ex) if upward else (ex, ey)
                if not forward:
                    wa, ea = -wa, -ea
                # How far its ends lie beyond the outer rays: all of it beside the wedge if both do.
                beyond, beside = wb - right * wa, wb - left * wa
                if (
                    min(beyond, beyond + eb - right * ea) > MARGIN
                    or max(beside, beside + eb - left * ea) < -MARGIN
                ):
                    continue
                seen[w] = mark
                low, high = wall[j, 4] - pz, wall[j, 5] - pz
                met |= _intersect_wall(wx, wy, ex, ey, low, high, w, ux, uy, slope, best, hit)
            for f in scene.face_item[face_start[k] : face_start[k + width]]:
                z = face[f, 12]
                if seen[scene.walls + f] == mark or z > highest or z < lowest:
                    continue
                seen[scene.walls + f] = mark
                met |= _intersect_face(
                    px, py, z - pz, face[f], scene.face_surface[f], ux, uy, per_slope, best, hit
                )
        if met:
            far = farthest(best)
        strip += 1 if forward else -1
