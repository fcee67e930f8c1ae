"""Poses whose scans a change of the building affects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ambinav.ambiguity.changes import Changes, changed_faces, comparable
from ambinav.ambiguity.returns import BEYOND, panorama_returns
from ambinav.ambiguity.sight import GRAZE, SightRays, sees
from ambinav.ambiguity.sight_in_space import sees_in_space
from ambinav.casting.added import AddedWalls
from ambinav.casting.prisms.prisms import Prisms
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.runtime.array_types import Bools, Floats

# Where a larger share of poses sees a change, the rest is not asked; the second is of meshes, where
# each is cast twice.
MOST_SEEING = 0.8
MOST_DIFFERING = 0.25
# See `SeenChanges.asking`.
ASKING_IN_PLANE = 0.05
# With more changed walls than this, computing all poses within reach is faster than asking.
MOST_CHANGES = 1000
# Beams of poses in a mesh whose returns are compared at a time.
SCANNED = 4_000_000


@dataclass(frozen=True, eq=False)
class SeenChanges:
    """Changes of a building as a scanner sees them.

    Attributes:
        old: The building before.
        new: The building now.
        changes: Between the two.
        context: Scanner, headings and parameters of the map.
    """

    old: Environment
    new: Environment
    changes: Changes
    context: LayerContext

    @cached_property
    def rays(self) -> SightRays:
        """Rays of the beams at all headings."""
        rays = self.context.scanner.rays(self.new.space is not None)
        x, y = rays.origin.T
        return SightRays(x, y, rays.angle, self._reach).turned(self.context.headings)

    @property
    def reach(self) -> float:
        """Distance from the robot within which a change is seen, metres."""
        return float((np.hypot(self.rays.x, self.rays.y) + self.rays.reach).max())

    @cached_property
    def countless(self) -> bool:
        """True if too many walls changed to check for each pose whether it sees one of them."""
        count = len(self.changes.removed) + len(self.changes.added)
        if self.new.space is not None:
            count = sum(len(faces.kind) for faces in self._faces)
        return count > MOST_CHANGES

    @property
    def most(self) -> float:
        """Largest share of poses that see the change at which checking them still saves time."""
        return MOST_DIFFERING if self._by_returns else MOST_SEEING

    @property
    def asking(self) -> float:
        """Time to check poses relative to the time to compute them."""
        return ASKING_IN_PLANE if self.new.space is None else 1.0 - self.most

    def by(self, x: Floats, y: Floats) -> Bools:
        """Return which poses within reach, shape (N,), may see a change; in doubt they do."""
        if self.countless:
            return np.ones(len(x), dtype=np.bool_)
        if self.new.space is None:
            return self._in_plane(x, y)
        return self._by_scans(x, y) if self._by_returns else self._in_prisms(x, y)

    @property
    def _by_returns(self) -> bool:
        """True in space where the walls that changed are not known."""
        old, new = self.old, self.new
        return new.space is not None and (
            not comparable(old.space, new.space) or old.floor != new.floor
        )

    @property
    def _reach(self) -> Floats:
        """Range of each ray of the beams, metres, shape (R,)."""
        rays, table = self.context.scanner.rays(self.new.space is not None), self.context.table
        limit = table.limit[: table.beams].astype(np.float64) + BEYOND
        return np.repeat(limit, np.diff(rays.start))

    def _in_plane(self, x: Floats, y: Floats) -> Bools:
        """Return at which poses a ray meets a new wall, or met one that is gone."""
        seen = sees(self.old.grid, self.changes.removed, x, y, self.rays)
        return seen | sees(self.new.grid, self.changes.added, x, y, self.rays)

    @cached_property
    def _faces(self) -> list[AddedWalls]:
        """Faces of prisms that are gone, and those that are new; none of other buildings."""
        old, new = self.old.space, self.new.space
        if not (isinstance(old, Prisms) and isinstance(new, Prisms)):
            return []
        return changed_faces(old, new, GRAZE)

    def _in_prisms(self, x: Floats, y: Floats) -> Bools:
        rays, headings = self.context.scanner.rays(in_space=True), self.context.headings
        seen = np.zeros(len(x), dtype=np.bool_)
        for env, faces in zip((self.old, self.new), self._faces, strict=True):
            assert isinstance(env.space, Prisms)
            seen |= sees_in_space(env.space, env.floor, faces, x, y, headings, rays, self._reach)
        return seen

    def _by_scans(self, x: Floats, y: Floats) -> Bools:
        """Return at which poses a beam returns something else than before."""
        scanner, table, headings = self.context.scanner, self.context.table, self.context.headings
        step = max(SCANNED // (len(headings) * len(table.limit)), 1)
        differ = np.empty(len(x), dtype=np.bool_)
        for low in range(0, len(x), step):
            part = slice(low, low + step)
            returns = np.empty((2, len(headings), len(x[part]), 5, len(table.limit)), np.float32)
            for env, data in zip((self.old, self.new), returns, strict=True):
                panorama_returns(env, scanner, table, x[part], y[part], headings, data)
            differ[part] = (returns[0] != returns[1]).any(axis=(0, 2, 3))
        return differ
