"""Navigation by reflectors from the poses of a lattice: how many, how precise, how unique."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.aliased_poses import find_motions, margins
from ambinav.layers.reflectors.precision import position_stds
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, seen_reflectors, sees_all_around
from ambinav.runtime.array_types import Bools, Floats, Ints, Ints32
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True, eq=False)
class Positioning:
    """Navigation by reflectors from the P free points of a lattice, at H headings.

    H is 1 where the scanner sees the same reflectors at every heading.

    Attributes:
        count: Reflectors in view, int32, shape (P, H).
        std: Standard deviation of the position along its worst direction, metres, shape (P, H).
        margin: Those in view that the best wrong pose does not explain, int32, shape (P, H).
        possible: Where the robot can stand, shape (P, H).
        rules: What the robot needs.
    """

    count: Ints32
    std: Floats
    margin: Ints32
    possible: Bools
    rules: ReflectorRules

    @property
    def enough(self) -> Bools:
        """True where enough reflectors are in view at every heading, shape (P,)."""
        return self._at_all(self.count >= self.rules.needed)

    @property
    def unique(self) -> Bools:
        """True where they are enough, and no wrong pose explains all of them, shape (P,)."""
        return self._at_all(self.margin > 0)

    @property
    def precise(self) -> Bools:
        """True where the position is as precise as needed, shape (P,)."""
        return self._at_all(self.std <= self.rules.max_std)

    @property
    def good(self) -> Bools:
        """True where the robot can navigate by reflectors, shape (P,)."""
        return self.enough & self.unique & self.precise

    def _at_all(self, holds: Bools) -> Bools:
        return np.asarray((holds | ~self.possible).all(axis=1))


@dataclass(frozen=True, eq=False)
class Site:
    """Building, scanner and poses from which reflectors are looked for.

    Attributes:
        environment: The building.
        scanner: The scanner, all of its beams.
        lattice: P free points.
        headings: Headings, radians, shape (H,); [0] where all show the same.
        possible: Where the robot can stand, shape (P, H).
        map_std: Standard deviation of a reflector's place, metres.
        rules: What the robot needs.
    """

    environment: Environment
    scanner: RangeScanner
    lattice: Lattice
    headings: Floats
    possible: Bools
    map_std: float
    rules: ReflectorRules

    @classmethod
    def of(cls, context: LayerContext, rules: ReflectorRules) -> Site:
        """Return the site of a map."""
        scanner, possible = context.full_scanner, context.possible
        around = sees_all_around(scanner)
        return cls(
            context.environment,
            scanner,
            context.lattice,
            np.zeros(1) if around else context.headings,
            np.asarray(possible.any(axis=1, keepdims=True)) if around else possible,
            context.map_std,
            rules,
        )

    def coarser(self, spacing: float) -> tuple[Site, Ints]:
        """Return the site on every n-th row and column, at most so far apart, metres.

        And the numbers of its points among those of this site.
        """
        step, fine = max(int(spacing / self.lattice.spacing + 1e-9), 1), self.lattice
        index = np.ascontiguousarray(fine.index[::step, ::step])
        x, y, rows = fine.x[::step], fine.y[::step], index[index >= 0].astype(np.int64)
        if not len(rows):
            return self, np.arange(len(self.possible))
        lattice = Lattice(fine.environment, step * fine.spacing, x, y, index >= 0)
        return replace(self, lattice=lattice, possible=self.possible[rows]), rows

    @property
    def poses(self) -> Floats:
        """Poses, one heading of a point after the other, shape (P * H, 3)."""
        x, y = self.lattice.points
        count = len(self.headings)
        return np.column_stack(
            [np.repeat(x, count), np.repeat(y, count), np.tile(self.headings, len(x))]
        )

    def views(self, targets: Targets) -> Bools:
        """Return which reflectors are in view, shape (P, H, L)."""
        seen = seen_reflectors(self.environment, self.scanner, targets, self.poses, self.rules)
        return seen.reshape(*self.possible.shape, len(targets))

    def positioning(self, targets: Targets, seen: Bools) -> Positioning:
        """Return counts, precision and margins by these reflectors.

        Args:
            targets: L reflectors.
            seen: Which are in view, shape (P, H, L).
        """
        rules, flat = self.rules, seen.reshape(self.possible.size, seen.shape[2])
        count = seen.sum(axis=2, dtype=np.int32)
        std = position_stds(self.scanner, self.map_std, targets, self.poses, flat)
        wide = flat.astype(np.float32)
        together = wide.T @ wide > 0.5
        motions = find_motions(targets, together, rules.tolerance, rules.needed)
        margin = margins(self.lattice, self.possible, self.headings, seen, motions)
        margin[count < rules.needed] = 0
        return Positioning(count, std.reshape(count.shape), margin, self.possible, rules)
