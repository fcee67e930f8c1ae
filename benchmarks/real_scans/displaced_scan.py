"""The ambiguity of a pose from the single scan taken there, without any map.

A robot passes a place a few times at most, so pairs of scans sample few displacements. But one
scan shows surfaces, and from them follows what the laser would read a little beside: the scan
is compared with itself, displaced over the whole neighbourhood, by the model's definition.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import TABLE, BeamTable
from ambinav.ambiguity.kernel import around_arrays, batch_arrays, listed, pose_sums
from ambinav.ambiguity.returns import BEYOND, BLIND
from ambinav.ambiguity.tensor import relative_radii
from ambinav.runtime.array_types import Floats
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from real_scans.real_returns import STEEPEST, WINDOW, same_surface, surface_slopes

# Surfaces this near to the displaced laser are ignored, metres.
SKIN = 1e-3


def displaced_figures(
    ranges: NDArray[np.float32],
    angles: Floats,
    heading: Floats,
    steps: NDArray[np.int64],
    spacing: float,
    free: NDArray[np.bool_],
    directions: Floats,
    beams: BeamTable,
    evidence: NDArray[np.float32] | None,
    tau: float,
    cell_variance: tuple[float, float],
) -> dict[str, Floats]:
    """Return the model's figures of scans, each compared with itself from displaced poses.

    Neighbouring readings of one surface are joined by a segment. A ray from the displaced laser
    that passes between two surfaces, or meets none, ends where the scan saw nothing: that beam
    tells nothing.

    Args:
        ranges: Readings, shape (S, B), metres.
        angles: Their directions, shape (B,), radians, rising.
        heading: Heading of each scan's laser in the map frame, shape (S,), radians.
        steps: Displacements along y and x in steps, shape (K, 2), map frame; one is (0, 0).
        spacing: Length of a step, metres.
        free: Which of them a robot can reach, shape (S, K).
        directions: Beams to compare, shape (P,), radians.
        beams: Their limits and caps.
        evidence: Table of evidence, or None where all bins are fine.
        tau: Beams per independent piece of evidence.
        cell_variance: Variance of the offset in x and y, square metres, and theta, square
            radians.

    Returns:
        See `relative_radii`; each of shape (S,).
    """
    slopes = surface_slopes(ranges, angles)
    sums = np.empty((len(ranges), 7))
    # The displaced scans are the poses of a lattice around the one that was taken.
    reach = np.abs(steps).max()
    index = np.full((2 * reach + 1, 2 * reach + 1), -1, dtype=np.int32)
    index[tuple((steps + reach).T)] = np.arange(len(steps))
    run_rows(
        _displaced, len(ranges), ranges.astype(np.float64), slopes, angles, heading, steps,
        spacing, index, free, directions, beams.limit, beams.inverse_cap, beams.use,
        beams.spread[0], evidence, tau, *cell_variance, sums,
    )  # fmt: skip
    return relative_radii(sums)


@kernel
def displaced_returns(
    ranges, slopes, angles, x, y, solid, heading, ex, ey, directions, limit, spread, data
):
    """Write what a laser moved by (ex, ey) in its own frame reads of a scan's surfaces."""
    count = angles.size
    for i in range(directions.size):
        ux, uy = math.cos(directions[i]), math.sin(directions[i])
        best, hit, share = np.inf, -1, 0.0
        for b in range(count - 1):
            if solid[b] < 0:
                continue
            ax, ay = x[b] - ex, y[b] - ey
            side_a = ux * ay - uy * ax
            c = b + solid[b]
            bx, by = x[c] - ex, y[c] - ey
            side_b = ux * by - uy * bx
            if (side_a <= 0.0) == (side_b <= 0.0):
                continue
            along = side_a / (side_a - side_b)
            r = (ax + along * (bx - ax)) * ux + (ay + along * (by - ay)) * uy
            if SKIN < r < best:
                best, hit, share = r, b, along
        data[0, i], data[1, i], data[2, i], data[3, i] = limit + BEYOND, 0.0, 0.0, 0.0
        data[4, i] = BLIND
        if hit < 0 or solid[hit] > 1:
            continue
        near = hit + 1 if share >= 0.5 else hit
        gap = not same_surface(ranges[hit], ranges[hit + 1])
        if gap:
            near = hit + 1 if ranges[hit + 1] > ranges[hit] else hit
        # Normal of the surface, from its slope as the undisplaced laser sees it.
        vx, vy = math.cos(angles[near]), math.sin(angles[near])
        nx, ny = vx + slopes[near] * vy, vy - slopes[near] * vx
        facing = nx * ux + ny * uy
        slant = ny * ux - nx * uy
        if gap:
            # The farther surface goes on behind the edge of the nearer one.
            behind = (nx * (x[near] - ex) + ny * (y[near] - ey)) / facing
            if not best <= behind <= best + 2.0 * (ranges[near] - best) + WINDOW:
                continue
            best = behind
        if abs(slant) >= STEEPEST * abs(facing):
            slope = -math.copysign(STEEPEST, slant * facing)
        else:
            slope = -slant / facing
        if best < limit + BEYOND:
            bearing = heading + directions[i]
            co, si = math.cos(bearing), math.sin(bearing)
            data[0, i] = best
            data[1, i], data[2, i], data[3, i] = -co - slope * si, -si + slope * co, slope * best
        place = min(best / limit, 1.0) * (TABLE - 1)
        low = min(int(place), TABLE - 2)
        data[4, i] = spread[low] + (spread[low + 1] - spread[low]) * (place - low)


@kernel
def join(ranges, solid):
    """Write the distance to the next valid reading, in beams; -1 where a reading is not valid."""
    count = ranges.size
    solid[:] = -1
    for b in range(count):
        if not (np.isfinite(ranges[b]) and ranges[b] > 0.0):
            continue
        for c in range(b + 1, count):
            if np.isfinite(ranges[c]) and ranges[c] > 0.0:
                solid[b] = c - b
                break


@kernel
def _displaced(
    low, high, ranges, slopes, angles, heading, steps, spacing, index, free, directions, limit,
    icap, use, spread, evidence, tau, c0, c2, sums,
):  # fmt: skip
    data = np.zeros((steps.shape[0], 5, limit.size), dtype=np.float32)
    data[:, 4] = 1.0
    solid = np.empty(angles.size, dtype=np.int64)
    marks = np.zeros(index.size, dtype=np.uint8)
    middle = index.shape[0] // 2
    arrays, around = batch_arrays(limit.size), around_arrays(len(steps))
    for s in range(low, high):
        join(ranges[s], solid)
        x, y = ranges[s] * np.cos(angles), ranges[s] * np.sin(angles)
        co, si = math.cos(heading[s]), math.sin(heading[s])
        for k in range(steps.shape[0]):
            row, column = steps[k, 0], steps[k, 1]
            marks[(row + middle) * index.shape[1] + column + middle] = 2 if free[s, k] else 0
            if not (free[s, k] or row == column == 0):
                continue
            ox, oy = column * spacing, row * spacing
            displaced_returns(
                ranges[s], slopes[s], angles, x, y, solid, heading[s], co * ox + si * oy,
                co * oy - si * ox, directions, limit[0], spread, data[k],
            )  # fmt: skip
        count = listed(
            middle, middle, index, 0, marks, steps, index.shape[0], spacing, c0, around, sums[s]
        )
        middle_pose = int(index[middle, middle])
        pose_sums(
            middle_pose, around, count, data, limit, icap, use, evidence, tau, c0, c2, arrays,
            sums[s],
        )  # fmt: skip
