"""Walls added in front of those of a building: rays that meet them end there.

An obstacle only ever shortens rays. So what a building with one more obstacle returns is, ray by
ray, the nearer of what it returned before and of the obstacle's own edges: no triangulation is made
anew. Each obstacle is looked at only by rays that come near it (a circle around it).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# Margin of `AddedWalls.seen_by` for the rounding of ranges, metres.
ROUNDING = 1e-5
# Distances that differ by at most this, metres, are equal: the obstacle's surface is reported.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class AddedWalls:
    """Edges of K added obstacles.

    Attributes:
        xy: End points of the E edges, float64, shape (E, 4), metres, map frame.
        kind: Kind of each edge, see `ambinav.geometry.segments`, uint8, shape (E,).
        start: Obstacle k owns the edges start[k] to start[k + 1] - 1, int64, shape (K + 1,).
        circle: x, y and radius of a circle around each, float64, shape (K, 3).
    """

    xy: NDArray[np.float64]
    kind: NDArray[np.uint8]
    start: NDArray[np.int64]
    circle: NDArray[np.float64]

    @classmethod
    def of(cls, edges: Sequence[NDArray[np.float64]], kinds: Sequence[int]) -> AddedWalls:
        """Make the walls from the edges of each obstacle, shape (E_k, 4), and the kind of each."""
        counts = [len(part) for part in edges]
        circle = np.empty((len(edges), 3))
        for row, part in zip(circle, edges, strict=True):
            corners = part.reshape(-1, 2)
            row[:2] = (corners.min(axis=0) + corners.max(axis=0)) / 2
            row[2] = np.hypot(*(corners - row[:2]).T).max()
        return cls(
            np.ascontiguousarray(np.concatenate([*edges, np.empty((0, 4))])),
            np.repeat(np.array(kinds, dtype=np.uint8), counts),
            np.cumsum([0, *counts]),
            circle,
        )

    def __add__(self, other: AddedWalls) -> AddedWalls:
        """Return the walls of both."""
        return AddedWalls(
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.kind, other.kind]),
            np.concatenate([self.start, self.start[-1] + other.start[1:]]),
            np.concatenate([self.circle, other.circle]),
        )

    @property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals of the edges, to the left of a to b, shape (E, 2)."""
        along = self.xy[:, 2:] - self.xy[:, :2]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return normal

    def shorten(
        self,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        theta: float,
        rays: NDArray[np.float64],
        reach: float,
        first: int,
        hits: tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]],
    ) -> None:
        """Shorten the rays that meet an edge before they meet the building.

        Args:
            x: Poses, shape (N,), metres, map frame.
            y: Poses, shape (N,), metres.
            theta: Heading of all of them, radians.
            rays: Angle (radians) and origin x, y (metres) of R rays, robot frame, shape (R, 3).
            reach: How far they look, metres.
            first: Number that hits give to the first edge.
            hits: Written: what `scan_rays` returns.
        """
        run_rows(
            _shorten, len(x), x, y, theta, rays, reach, first, self.xy, self.start, self.circle,
            *hits, least=256,
        )  # fmt: skip

    def seen_by(
        self,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        rays: NDArray[np.float64],
        beam: NDArray[np.int64],
        limit: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Return which poses see an edge nearer than the range of their beams without it.

        Args:
            x: Poses, shape (N,), metres, map frame.
            y: Poses, shape (N,), metres.
            rays: Angle (radians) and origin x, y (metres) of R rays at heading 0, shape (R, 3).
            beam: Which column of `limit` each ray belongs to, int64, shape (R,).
            limit: Farthest that a beam sees at each pose, metres, shape (N, B).

        Returns:
            Shape (N,). Some may be named that do not see it, by rounding.
        """
        seen = np.zeros(len(x), dtype=np.bool_)
        run_rows(
            _seen, len(x), x, y, rays, beam, limit, self.xy, self.start, self.circle, seen,
            least=256,
        )  # fmt: skip
        return seen


@kernel
def _nearest_edge(px, py, ux, uy, reach, xy, start, circle):
    """Return the distance to the nearest edge along a ray, and its index; `reach`, -1 for none."""
    best, nearest = reach, -1
    for k in range(circle.shape[0]):
        cx, cy = circle[k, 0] - px, circle[k, 1] - py
        r = circle[k, 2]
        if abs(ux * cy - uy * cx) > r or not -r <= ux * cx + uy * cy <= best + r:
            continue
        for e in range(start[k], start[k + 1]):
            ax, ay = xy[e, 0] - px, xy[e, 1] - py
            ex, ey = xy[e, 2] - xy[e, 0], xy[e, 3] - xy[e, 1]
            cross = ux * ey - uy * ex
            if cross == 0.0:
                continue
            along = (ax * ey - ay * ex) / cross
            share = (ax * uy - ay * ux) / cross
            if 0.0 <= share <= 1.0 and 0.0 <= along < best:
                best, nearest = along, e
    return best, nearest


@kernel
def _shorten(
    begin, end, x, y, theta, rays, reach, first, xy, start, circle, distance, segment, incidence
):
    c, s = math.cos(theta), math.sin(theta)
    ux, uy = np.cos(rays[:, 0] + theta), np.sin(rays[:, 0] + theta)
    for p in range(begin, end):
        for r in range(rays.shape[0]):
            if math.isnan(distance[p, r]):
                continue
            px = x[p] + c * rays[r, 1] - s * rays[r, 2]
            py = y[p] + s * rays[r, 1] + c * rays[r, 2]
            far = min(distance[p, r] + SAME, reach)
            d, e = _nearest_edge(px, py, ux[r], uy[r], far, xy, start, circle)
            if e < 0:
                continue
            distance[p, r], segment[p, r] = d, first + e
            if incidence.size > 0:
                ex, ey = xy[e, 2] - xy[e, 0], xy[e, 3] - xy[e, 1]
                along = abs(ux[r] * ex + uy[r] * ey)
                incidence[p, r] = math.atan2(along, abs(ux[r] * ey - uy[r] * ex))


@kernel
def _seen(begin, end, x, y, rays, beam, limit, xy, start, circle, seen):
    ux, uy = np.cos(rays[:, 0]), np.sin(rays[:, 0])
    for p in range(begin, end):
        for r in range(rays.shape[0]):
            px, py = x[p] + rays[r, 1], y[p] + rays[r, 2]
            far = limit[p, beam[r]] + ROUNDING
            _, e = _nearest_edge(px, py, ux[r], uy[r], far, xy, start, circle)
            if e >= 0:
                seen[p] = True
                break
