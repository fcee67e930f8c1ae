"""Rays of several azimuths that walk together through prisms, as a wedge on the plan.

Of a tilted scanner, or one whose pattern does not repeat, hardly two rays have one azimuth, so that
no two are one ray when seen from above. Neighbours still pass nearly the same cells. They go strip
by strip, a strip being one row or column of cells across their way; the walls in the cells that the
wedge of them touches are compared with all of them at once.
"""

from __future__ import annotations

import math

from ambinav.casting.plane.raycast import END
from ambinav.casting.prisms.kernel import SLACK, farthest, meet_faces, meet_planes
from ambinav.runtime.kernels import kernel

# The wedge is this much wider than its outer rays, metres and cells: what they touch is in it.
MARGIN = 1e-6


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


@kernel(_nrt=False)
def cast_wedge(px, py, pz, ux, uy, slope, per_slope, best, hit, scene):
    """Walk the strips of cells across a packet's path until all of its n rays have ended.

    Args: as `cast_column`'s, but the directions differ, by less than a right angle.
    """
    meet_planes(pz, slope, per_slope, best, hit, scene)
    start, line, height, face_start = scene.start, scene.line, scene.height, scene.face_start
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
    left, right, shortest, longest = math.inf, -math.inf, math.inf, 0.0
    for i in range(slope.size):
        along = abs(uy[i] if upward else ux[i])
        lean = (ux[i] if upward else uy[i]) / along
        left, right = min(left, lean), max(right, lean)
        shortest, longest = min(shortest, 1.0 / along), max(longest, 1.0 / along)
    flattest, steepest = slope[0], slope[slope.size - 1]
    far = farthest(best)
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
        for across in range(first, last + 1):
            k = strip * step_a + across * step_b
            for j in range(start[k], start[k + 1]):
                if height[j, 0] > highest or height[j, 1] < lowest:
                    continue
                wx, wy = line[j, 0] - px, line[j, 1] - py
                ex, ey = line[j, 2], line[j, 3]
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
                low, high, wall = height[j, 0] - pz, height[j, 1] - pz, scene.item[j]
                met |= _intersect_wall(wx, wy, ex, ey, low, high, wall, ux, uy, slope, best, hit)
            if face_start[k + 1] > face_start[k]:
                met |= meet_faces(
                    k, entered, leave, px, py, pz, ux, uy, slope, per_slope, best, hit, scene
                )
        if met:
            far = farthest(best)
        strip += 1 if forward else -1
