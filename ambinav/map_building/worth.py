"""Estimate whether a map is updated faster than it is built, from a sample of its poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from scipy.ndimage import distance_transform_edt

from ambinav.ambiguity.neighbourhoods import disc
from ambinav.geometry.lattice import slices_in
from ambinav.map_building.seen_changes import SeenChanges
from ambinav.runtime.array_types import Bools, Bounds, Floats
from ambinav.runtime.lanes import LANES

# One in so many rows and columns is sampled.
SAMPLED: Final = 4
# Seconds that an update takes whatever sees the change.
OVERHEAD: Final = 0.03
# Seconds of one thread of a build, for each pose and heading: to compare it with a neighbour, but
# for the columns of the scan, for each column, and for each column whatever the neighbours, as to
# cast it (fitted to 9 maps of 5 buildings and 5 scanners; their times come out to a third).
PER_NEIGHBOUR: Final = 25e-9
PER_COLUMN: Final = 1.4e-9
PER_RAY: Final = 60e-9
# Share of the time of a pose that its rays take; those of its neighbours are cast too.
CASTING: Final = 0.3
# The sample may be wrong by so much, and to save less is not worth it.
MARGIN: Final = 0.1
# A build of so few seconds is faster than any update.
SMALLEST: Final = OVERHEAD / (1.0 - MARGIN)


@dataclass(frozen=True)
class ExpectedWork:
    """Work of an update, by a sample of poses.

    Attributes:
        asks_cells: Whether checking each pose within reach for a view of the change saves time.
        share: Time for the poses checked or computed, relative to a build of all poses.
    """

    asks_cells: bool
    share: float

    @classmethod
    def of(
        cls,
        seen: SeenChanges,
        reach: Sequence[Bounds],
        free: Bools,
        x: Floats,
        y: Floats,
        spacing: float,
        radius: float,
    ) -> ExpectedWork:
        """Ask a sample of the poses.

        Args:
            seen: The change.
            reach: Boxes within which it may be seen, metres.
            free: Where the robot could stand before, shape (R, C).
            x: Coordinates of the columns, shape (C,), metres.
            y: Coordinates of the rows, shape (R,), metres.
            spacing: Of both, metres.
            radius: Radius of the neighbourhood of a pose, metres.
        """
        first = min(SAMPLED, *free.shape) // 2
        free, x, y = free[first::SAMPLED, first::SAMPLED], x[first::SAMPLED], y[first::SAMPLED]
        stale = np.zeros_like(free)
        for box in reach:
            stale[slices_in(box, x, y)] = True
        stale &= free
        row, column = np.nonzero(stale)
        if not len(row):
            return cls(True, 0.0)
        within_reach, asks_cells = stale.sum() / free.sum(), False
        if not seen.countless:
            sees = seen.by(x[column], y[row])
            asks_cells = bool(sees.mean() <= seen.most)
            if asks_cells:
                stale[row, column] = sees
        if not stale.any():
            return cls(asks_cells, float(seen.asking * within_reach))
        step = SAMPLED * spacing
        # A change that is seen between two samples is half a step nearer on the average.
        away = step * (distance_transform_edt(~stale)[free] - 0.5)
        share = (1.0 - CASTING) * (away <= radius).mean() + CASTING * (away <= 2.0 * radius).mean()
        return cls(asks_cells, float(share + asks_cells * seen.asking * within_reach))

    def with_more_floor(self, grown: float) -> ExpectedWork:
        """Return the work with new floor of `grown` times the old floor computed as well."""
        return replace(self, share=(self.share + grown) / (1.0 + grown))

    def pays(self, seconds: float) -> bool:
        """Return whether an update is expected to be faster than a build of `seconds`."""
        return self.share + OVERHEAD / seconds < 1.0 - MARGIN


def is_small(seconds: float) -> bool:
    """Return whether a build of `seconds` is at least as fast as any update."""
    return seconds < SMALLEST


def build_seconds(poses: int, beams: int, radius: float, spacing: float) -> float:
    """Estimate the seconds of a build.

    Args:
        poses: Number of poses, each heading counted.
        beams: Beams that take part.
        radius: Radius of the neighbourhood of a pose, metres.
        spacing: Spacing of the lattice, metres.
    """
    columns = LANES * math.ceil(beams / LANES)
    compared = len(disc(radius, spacing)) * (PER_NEIGHBOUR + PER_COLUMN * columns)
    each = compared + PER_RAY * columns
    return float(poses * each / numba.get_num_threads())
