"""Poses that see a segment: a ray meets it, or passes it within the rounding error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.raycast import cast_one
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# A ray that passes a segment's end this near may meet it, metres; how rays that graze a corner go
# on is decided by rounding, so rays turned by as many radians are asked too.
GRAZE = 1e-6
# Ranges are float32: what is nearer by this much, metres, hides for certain.
HIDDEN = 1e-5
# Segments whose middles lie in the same square of this edge, metres, are passed by together.
TOGETHER = 1.0


class SightRays(NamedTuple):
    """Rays of a robot: origin and direction in its frame, and the range of each.

    Attributes:
        x: Origins, shape (R,), metres.
        y: Likewise.
        angle: Directions, shape (R,), radians.
        reach: Metres, shape (R,).
    """

    x: Floats
    y: Floats
    angle: Floats
    reach: Floats

    def turned(self, headings: Floats) -> SightRays:
        """Return the rays of robots at all of these headings, in the frame of the map."""
        c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
        return SightRays(
            (c * self.x - s * self.y).ravel(),
            (s * self.x + c * self.y).ravel(),
            (headings[:, None] + self.angle).ravel(),
            np.tile(self.reach, len(headings)),
        )


def sees(grid: SegmentGrid, lines: Floats, x: Floats, y: Floats, rays: SightRays) -> Bools:
    """Return whether a ray of each pose, shape (N,), meets one of the given segments.

    In doubt it does: at corners that a ray grazes, and at the ends of segments.

    Args:
        grid: All segments of the building.
        lines: End points of the segments in question, shape (K, 4), metres.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        rays: The rays of a pose at all headings, in the frame of the map (`SightRays.turned`).
    """
    seen = np.zeros(len(x), dtype=np.bool_)
    if not len(lines):
        return seen
    grouped, start, circle = _groups(lines)
    run_rows(
        _sees, len(x), x, y, *rays[:2], np.cos(rays.angle), np.sin(rays.angle), rays.reach, grouped,
        start, circle, *grid.arrays, seen, least=64,
    )  # fmt: skip
    return seen


def _groups(lines: Floats) -> tuple[Floats, Ints, Floats]:
    """Sort lines into groups that lie together.

    Returns:
        The lines, group by group; where each group begins, and where the last one ends; x, y and
        radius of a circle around each, metres.
    """
    cell = np.floor((lines[:, :2] + lines[:, 2:]) / 2 / TOGETHER).astype(np.int64)
    _, group = np.unique(cell, axis=0, return_inverse=True)
    order = np.argsort(group.reshape(-1), kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(group.reshape(-1)))])
    grouped = np.ascontiguousarray(lines[order])
    circle = np.empty((len(start) - 1, 3))
    for row, low, high in zip(circle, start[:-1], start[1:], strict=True):
        ends = grouped[low:high].reshape(-1, 2)
        row[:2] = (ends.min(axis=0) + ends.max(axis=0)) / 2
        row[2] = np.hypot(*(ends - row[:2]).T).max() + 2 * GRAZE
    return grouped, start, circle


@kernel(inline="always")
def _meeting(px, py, ux, uy, reach, lines, low, high, best):
    """Return a lower bound of the distance along the ray to the first line, at most `best`."""
    for k in range(low, high):
        ax, ay = lines[k, 0] - px, lines[k, 1] - py
        bx, by = lines[k, 2] - px, lines[k, 3] - py
        left, right = ux * ay - uy * ax, ux * by - uy * bx
        if min(left, right) > GRAZE or max(left, right) < -GRAZE:
            continue
        start, end = ax * ux + ay * uy, bx * ux + by * uy
        nearest = min(start, end)
        if abs(left - right) > 4 * GRAZE:
            share = min(max(left / (left - right), 0.0), 1.0)
            nearest = max(start + share * (end - start), nearest)
        if max(start, end) >= -GRAZE and nearest <= reach:
            best = min(best, nearest)
    return best


@kernel
def _sees(
    begin, end, x, y, ray_x, ray_y, ray_cos, ray_sin, ray_reach, lines, group, circle, x0, y0, cell,
    rows, columns, start, item, line, seen,
):  # fmt: skip
    for i in range(begin, end):
        for r in range(ray_cos.size):
            px, py = x[i] + ray_x[r], y[i] + ray_y[r]
            ux, uy = ray_cos[r], ray_sin[r]
            nearest = np.inf
            for g in range(circle.shape[0]):
                cx, cy, size = circle[g, 0] - px, circle[g, 1] - py, circle[g, 2]
                along, across = cx * ux + cy * uy, ux * cy - uy * cx
                if abs(across) > size or along < -size or along - size > ray_reach[r]:
                    continue
                nearest = _meeting(
                    px, py, ux, uy, ray_reach[r] + HIDDEN, lines, group[g], group[g + 1], nearest
                )
            if nearest == np.inf:
                continue
            reach = max(nearest, 0.0) + HIDDEN
            for turn in range(-1, 2):
                vx, vy = ux - turn * GRAZE * uy, uy + turn * GRAZE * ux
                distance, _ = cast_one(
                    px, py, vx, vy, reach, x0, y0, cell, rows, columns, start, line
                )
                if distance >= nearest - HIDDEN:
                    seen[i] = True
                    break
            if seen[i]:
                break
