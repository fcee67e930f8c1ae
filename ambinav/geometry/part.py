"""Part of a building near a box: poses there see exactly the same, bit for bit.

`Environment.window` cuts the floor and triangulates it anew, which is what an edit needs. Here the
building's own triangles are kept whole, in their order, with the segments that their edges stand
for. A ray that stays within the box then takes the same steps with the same numbers as in the
building, so that a map can be made of parts anywhere and is the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from ambinav.casting.plane.triangulation import Triangulation
from ambinav.geometry.border_cover import meeting
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.runtime.array_types import Bounds, Bytes, Floats, Indices, Ints32


class EnvironmentPart(Environment):
    """Part of a building's floor that rays, clearances and footprints near a box need.

    What rays meet in space is added by `in_space`.

    Its rim, where kept triangles border on others, is a frontier and lies outside of the box. Its
    `free` is no more than a box around it: what is free, the triangles tell. All else that an
    `Environment` knows about its source is not known here. It is sent to other processes as the
    arrays that it is made of.

    Args:
        triangles: Corners, counter-clockwise, shape (T, 3, 2), metres.
        segment: Index of the segment of each of the K open edges of these, int32, shape (K,).
        lines: End points of a piece of its line, shape (K, 4), metres.
        xy: End points of the segments, shape (N, 4), metres.
        kind: See `Segments`, shape (N,).
        name: Name of the building.
        resolution: Resolution of the building.
        collision: The same part of `Environment.collision`, where footprints ask for it; None: it
            is this part itself.
    """

    def __init__(
        self,
        triangles: Floats,
        segment: Ints32,
        lines: Floats,
        xy: Floats,
        kind: Bytes,
        name: str,
        resolution: float | None,
        collision: EnvironmentPart | None,
    ) -> None:
        self._made_of = triangles, segment, lines, xy, kind, name, resolution, collision
        self.segments = Segments(xy, kind)
        corners = triangles.reshape(-1, 2)
        self.free = shapely.box(*corners.min(axis=0), *corners.max(axis=0))
        self.name = name
        self.source = None
        self.checksum = ""
        self.resolution = resolution
        self.notes = ()
        self.extent = self.occupancy = self._drivable = None
        self.space, self.floor = None, 0.0
        # These replace properties that `Environment` computes from segments and floor.
        vars(self).update(
            border_segment=segment,
            border_lines=lines,
            collision=self if collision is None else collision,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle only the arrays."""
        return EnvironmentPart, self._made_of

    @cached_property
    def triangulation(self) -> Triangulation:
        """Its triangles."""
        return Triangulation.from_triangles(self._made_of[0])

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        arrays = sum(array.nbytes for array in self._made_of if isinstance(array, np.ndarray))
        collision = self._made_of[-1]
        return arrays + (0 if collision is None else collision.nbytes)


@dataclass(frozen=True, eq=False)
class PartCutter:
    """Building prepared for cutting into parts.

    Attributes:
        environment: The building.
        collision: Its `collision`, ready likewise; None: footprints do not ask for it, or it is
            the building itself.
        low: Least x and y of each triangle, shape (T, 2), metres.
        high: Largest x and y.
    """

    environment: Environment
    collision: PartCutter | None
    low: Floats
    high: Floats
    _band: tuple[float, float, Indices, Indices] | None = None

    @classmethod
    def of(cls, environment: Environment, *, footprints: bool) -> PartCutter:
        """Prepare a building.

        Args:
            environment: The building.
            footprints: Whether it is asked of parts where a body fits.
        """
        corners = environment.triangulation.corner.reshape(-1, 3, 2)
        apart = footprints and environment.drivable is not None
        return cls(
            environment,
            cls.of(environment.collision, footprints=False) if apart else None,
            corners.min(axis=1),
            corners.max(axis=1),
        )

    def meets(self, box: Bounds) -> bool:
        """Return whether a triangle of the floor may lie in a box."""
        return bool(len(self._within(box)))

    def _near(self, box: Bounds) -> tuple[Indices, Indices]:
        """Return triangles and segments that may lie in the rows of a box, ascending.

        Boxes come row by row: those of a band are kept, not to look through all for each box.
        """
        _, low, _, high = box
        if self._band is None or not (self._band[0] <= low and high <= self._band[1]):
            wide = (high - low) / 2
            low, high = low - wide, high + wide
            triangles = np.flatnonzero((self.low[:, 1] <= high) & (self.high[:, 1] >= low))
            segments = meeting(self.environment.segments.xy, (-np.inf, low, np.inf, high))
            object.__setattr__(self, "_band", (low, high, triangles, segments))
        assert self._band is not None
        return self._band[2], self._band[3]

    def _within(self, box: Bounds) -> Indices:
        near, _ = self._near(box)
        return near[
            (self.low[near] <= box[2:]).all(axis=1) & (self.high[near] >= box[:2]).all(axis=1)
        ]

    def part(self, box: Bounds, footprints: Bounds | None = None) -> EnvironmentPart | None:
        """Return the part of the building in a box; None if no floor lies there.

        Args:
            box: (xmin, ymin, xmax, ymax), metres.
            footprints: All that bodies touch lies in this one; None: in `box`.
        """
        members = self._within(box)
        if not len(members):
            return None
        env = self.environment
        mesh = env.triangulation
        half = (3 * members[:, None] + np.arange(3)).ravel()
        triangles = mesh.corner[half].reshape(-1, 3, 2)
        twin = mesh.twin[half]
        beside = np.maximum(twin, 0) // 3
        place = np.minimum(np.searchsorted(members, beside), len(members) - 1)
        cut = (twin >= 0) & (members[place] != beside)
        # In the order in which `Triangulation.from_triangles` numbers open edges.
        open_half = np.flatnonzero((twin < 0) | cut)
        is_rim = cut[open_half]
        following = half // 3 * 3 + (half + 1) % 3
        edges = np.hstack([mesh.corner[half], mesh.corner[following]])[open_half]
        border = -1 - twin[open_half][~is_rim]
        lines = edges.copy()
        lines[~is_rim] = env.border_lines[border]
        _, near = self._near(box)
        near = near[meeting(env.segments.xy[near], box)]
        used = np.union1d(env.border_segment[border], near)
        segment = len(used) + np.cumsum(is_rim) - 1
        segment[~is_rim] = np.searchsorted(used, env.border_segment[border])
        collision = None
        if self.collision is not None:
            collision = self.collision.part(footprints or box) or _solid(box)
        return EnvironmentPart(
            triangles,
            segment.astype(np.int32),
            np.ascontiguousarray(lines),
            np.concatenate([env.segments.xy[used], edges[is_rim]]),
            np.append(env.segments.kind[used], np.full(int(is_rim.sum()), FRONTIER, np.uint8)),
            env.name,
            env.resolution,
            collision,
        )


def _solid(box: Bounds) -> EnvironmentPart:
    """Return a part in which no body fits: a sliver of floor, far away."""
    xmin, ymin, _, _ = box
    away = np.array([xmin, ymin]) - 1e6
    triangles = away + np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    edges = np.hstack([triangles[0], np.roll(triangles[0], -1, axis=0)])
    kind = np.zeros(3, dtype=np.uint8)
    return EnvironmentPart(
        triangles, np.arange(3, dtype=np.int32), edges, edges, kind, "", None, None
    )
