"""Walls added in front of those of a building: rays that meet them end there.

An obstacle only ever shortens rays. So what a building with one more obstacle returns is, ray by
ray, the nearer of what it returned before and of the obstacle's own faces: no triangulation is made
anew. Each obstacle is looked at only by rays that come near it (a circle around it).

In space an edge is a wall between two heights, and an obstacle with an area has a bottom and a top
besides. In the plane rays are level, and walls have no end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# Margin of `AddedWalls.seen_by` for the rounding of ranges, metres.
ROUNDING = 1e-5
# Distances that differ by at most this, metres, are equal: the obstacle's surface is reported.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class AddedWalls:
    """Edges of K added obstacles.

    Faces are numbered: the E edges, then bottom and top of each obstacle.

    Attributes:
        xy: End points of the E edges, float64, shape (E, 4), metres, map frame.
        kind: Kind of each obstacle, see `ambinav.geometry.segments`, uint8, shape (K,).
        start: Obstacle k owns the edges start[k] to start[k + 1] - 1, int64, shape (K + 1,).
        circle: x, y and radius of a circle around each, float64, shape (K, 3).
        z: Lowest and highest z of each, float64, shape (K, 2), metres; without end in the plane.
        solid: Whether its edges enclose an area, bool, shape (K,).
    """

    xy: Floats
    kind: Bytes
    start: Ints
    circle: Floats
    z: Floats
    solid: Bools

    @classmethod
    def of(
        cls,
        edges: Sequence[Floats],
        kinds: Sequence[int],
        z: Sequence[tuple[float, float]] | None = None,
        solid: Sequence[bool] | None = None,
    ) -> AddedWalls:
        """Make the walls of obstacles.

        Args:
            edges: Edges of each, shape (E_k, 4).
            kinds: Kind of each.
            z: Lowest and highest z of each, metres; None: in the plane.
            solid: Whether its edges enclose an area; read in space alone.
        """
        counts = [len(part) for part in edges]
        circle = np.empty((len(edges), 3))
        for row, part in zip(circle, edges, strict=True):
            corners = part.reshape(-1, 2)
            row[:2] = (corners.min(axis=0) + corners.max(axis=0)) / 2
            row[2] = np.hypot(*(corners - row[:2]).T).max()
        return cls(
            np.ascontiguousarray(np.concatenate([*edges, np.empty((0, 4))])),
            np.array(kinds, dtype=np.uint8),
            np.cumsum([0, *counts]),
            circle,
            np.array([(-math.inf, math.inf)] * len(edges) if z is None else z).reshape(-1, 2),
            np.array([False] * len(edges) if solid is None else solid, dtype=np.bool_),
        )

    def __add__(self, other: AddedWalls) -> AddedWalls:
        """Return the walls of both."""
        return AddedWalls(
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.kind, other.kind]),
            np.concatenate([self.start, self.start[-1] + other.start[1:]]),
            np.concatenate([self.circle, other.circle]),
            np.concatenate([self.z, other.z]),
            np.concatenate([self.solid, other.solid]),
        )

    @property
    def faces(self) -> int:
        """Number of faces: those of the edges, and two of each obstacle."""
        return len(self.xy) + 2 * len(self.kind)

    @property
    def normals(self) -> Floats:
        """Unit normals of the faces: left of a to b, or upward; shape (E + 2 K, 3)."""
        along = self.xy[:, 2:] - self.xy[:, :2]
        normal = np.zeros((self.faces, 3))
        normal[: len(along), 0], normal[: len(along), 1] = -along[:, 1], along[:, 0]
        normal[len(along) :, 2] = 1.0
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return normal

    @property
    def face_kind(self) -> Bytes:
        """Kind of each face, shape (E + 2 K,)."""
        return np.concatenate([np.repeat(self.kind, np.diff(self.start)), np.repeat(self.kind, 2)])

    def shorten(
        self,
        x: Floats,
        y: Floats,
        theta: float,
        rays: Floats,
        reach: float,
        first: int,
        hits: tuple[Floats32, Ints32, Floats32],
    ) -> None:
        """Shorten the rays that meet a face before they meet the building.

        Args:
            x: Poses, shape (N,), metres, map frame.
            y: Poses, shape (N,), metres.
            theta: Heading of all of them, radians.
            rays: Angle (radians), origin x, y and z (metres, z in the map frame) and elevation
                (radians) of R rays, robot frame, shape (R, 5).
            reach: How far they look, metres.
            first: Number that hits give to the first face.
            hits: Written: what `scan_rays` returns.
        """
        run_rows(
            _shorten, len(x), x, y, theta, rays, reach, first, self.xy, self.start, self.circle,
            self.z, self.solid, *hits, least=256,
        )  # fmt: skip

    def seen_by(self, x: Floats, y: Floats, rays: Floats, beam: Ints, limit: Floats) -> Bools:
        """Return which poses see a face nearer than the range of their beams without it.

        Args:
            x: Poses, shape (N,), metres, map frame.
            y: Poses, shape (N,), metres.
            rays: R rays at heading 0 as `shorten` takes them, shape (R, 5).
            beam: Which column of `limit` each ray belongs to, int64, shape (R,).
            limit: Farthest that a beam sees at each pose, metres, shape (N, B).

        Returns:
            Shape (N,). Some may be named that do not see it, by rounding.
        """
        seen = np.zeros(len(x), dtype=np.bool_)
        run_rows(
            _seen, len(x), x, y, rays, beam, limit, self.xy, self.start, self.circle, self.z,
            self.solid, seen, least=256,
        )  # fmt: skip
        return seen


@kernel
def _nearest_face(px, py, pz, ux, uy, slope, reach, xy, start, circle, z, solid):
    """Return the level distance to the nearest face along a ray, and the face; `reach`, -1: none.

    (ux, uy) is the ray's direction seen from above, `slope` the tangent of its elevation.
    """
    best, nearest = reach, -1
    for k in range(circle.shape[0]):
        cx, cy = circle[k, 0] - px, circle[k, 1] - py
        r = circle[k, 2]
        if abs(ux * cy - uy * cx) > r or not -r <= ux * cx + uy * cy <= best + r:
            continue
        bottom = top = np.inf
        if slope != 0.0:
            bottom, top = (z[k, 0] - pz) / slope, (z[k, 1] - pz) / slope
        over_bottom = over_top = False
        for e in range(start[k], start[k + 1]):
            ax, ay = xy[e, 0] - px, xy[e, 1] - py
            ex, ey = xy[e, 2] - xy[e, 0], xy[e, 3] - xy[e, 1]
            cross = ux * ey - uy * ex
            if cross == 0.0:
                continue
            along = (ax * ey - ay * ex) / cross
            share = (ax * uy - ay * ux) / cross
            # A point is above the outline if the ray crosses that an odd number of times after it;
            # where it only touches a corner, both edges there must count, or none.
            bx, by = xy[e, 2] - px, xy[e, 3] - py
            if (ux * ay - uy * ax >= 0.0) != (ux * by - uy * bx >= 0.0):
                over_bottom ^= along > bottom
                over_top ^= along > top
            if not 0.0 <= share <= 1.0:
                continue
            if 0.0 <= along < best and z[k, 0] <= pz + slope * along <= z[k, 1]:
                best, nearest = along, e
        if solid[k] and over_bottom and 0.0 <= bottom < best:
            best, nearest = bottom, xy.shape[0] + 2 * k
        if solid[k] and over_top and 0.0 <= top < best:
            best, nearest = top, xy.shape[0] + 2 * k + 1
    return best, nearest


@kernel
def _shorten(
    begin, end, x, y, theta, rays, reach, first, xy, start, circle, z, solid, distance, segment,
    incidence,
):  # fmt: skip
    c, s = math.cos(theta), math.sin(theta)
    ux, uy = np.cos(rays[:, 0] + theta), np.sin(rays[:, 0] + theta)
    flat, rise = np.cos(rays[:, 4]), np.sin(rays[:, 4])
    for p in range(begin, end):
        for r in range(rays.shape[0]):
            if math.isnan(distance[p, r]):
                continue
            px = x[p] + c * rays[r, 1] - s * rays[r, 2]
            py = y[p] + s * rays[r, 1] + c * rays[r, 2]
            far = min(distance[p, r] + SAME, reach) * flat[r]
            slope = rise[r] / flat[r]
            d, f = _nearest_face(
                px, py, rays[r, 3], ux[r], uy[r], slope, far, xy, start, circle, z, solid
            )
            if f < 0:
                continue
            distance[p, r], segment[p, r] = d / flat[r], first + f
            if incidence.size > 0:
                facing, aside = abs(rise[r]), flat[r]
                if f < xy.shape[0]:
                    ex, ey = xy[f, 2] - xy[f, 0], xy[f, 3] - xy[f, 1]
                    facing = abs(ux[r] * ey - uy[r] * ex) * flat[r]
                    along = (ux[r] * ex + uy[r] * ey) * flat[r]
                    aside = math.hypot(along, rise[r] * math.hypot(ex, ey))
                incidence[p, r] = math.atan2(aside, facing)


@kernel
def _seen(begin, end, x, y, rays, beam, limit, xy, start, circle, z, solid, seen):
    ux, uy = np.cos(rays[:, 0]), np.sin(rays[:, 0])
    flat, rise = np.cos(rays[:, 4]), np.sin(rays[:, 4])
    for p in range(begin, end):
        for r in range(rays.shape[0]):
            px, py = x[p] + rays[r, 1], y[p] + rays[r, 2]
            far = (limit[p, beam[r]] + ROUNDING) * flat[r]
            _, f = _nearest_face(
                px, py, rays[r, 3], ux[r], uy[r], rise[r] / flat[r], far, xy, start, circle, z,
                solid,
            )  # fmt: skip
            if f >= 0:
                seen[p] = True
                break
