"""Connected regions where two maps differ: level changed, or ambiguous floor that is new."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import ndimage

from ambinav.maps.zones import BAD
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.studies.diff.registration import STATES, CommonLattice, ReadMap

Kind = Literal["worse", "better", "new floor"]

NOTABLE: Final = 0.1
"""Difference in level from which a cell is worse or better."""
LEAST_AREA: Final = 1.0
"""Square metres; smaller regions are not listed."""
_NEIGHBOURS: Final = np.ones((3, 3), dtype=np.bool_)


@dataclass(frozen=True)
class ChangedRegion:
    """A region that differs.

    Attributes:
        number: Rank, from 1: by the change in level times area.
        kind: "worse" or "better" by level, or "new floor": a corridor or open zone on floor that
            the first map does not count.
        x: Metres; the point that has changed most.
        y: Metres.
        area: Square metres.
        change: Mean difference of the level; of new floor its mean level.
        largest: Difference of the level at (x, y); of new floor the level there.
        before: State of most of it in the first map, one of `STATES`.
        after: The same in the second map.
    """

    number: int
    kind: Kind
    x: float
    y: float
    area: float
    change: float
    largest: float
    before: str
    after: str


def changed_regions(
    lattice: CommonLattice, first: ReadMap, second: ReadMap
) -> tuple[ChangedRegion, ...]:
    """Find the regions that differ notably, the most important first.

    Args:
        lattice: Lattice of both maps.
        first: The map before.
        second: The map after.
    """
    rise = second.level - first.level
    ambiguous = np.isin(second.state, BAD) & ~first.counted
    masks: tuple[tuple[Kind, Bools, Floats], ...] = (
        ("worse", rise >= NOTABLE, rise),
        ("better", rise <= -NOTABLE, rise),
        ("new floor", ambiguous, second.level),
    )
    regions = [
        region
        for kind, mask, change in masks
        for region in _regions(lattice, kind, mask, change, first, second)
    ]
    regions.sort(key=lambda region: -abs(region.change) * region.area)
    return tuple(replace(region, number=number) for number, region in enumerate(regions, start=1))


def _regions(
    lattice: CommonLattice, kind: Kind, mask: Bools, change: Floats, first: ReadMap, second: ReadMap
) -> list[ChangedRegion]:
    labels, _ = ndimage.label(mask, structure=_NEIGHBOURS)
    least = LEAST_AREA / lattice.cell_area
    regions = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        inside = labels[box] == label
        cells = int(inside.sum())
        if cells < least:
            continue
        values = np.where(inside, np.abs(change[box]), -1.0)
        row, column = np.unravel_index(int(values.argmax()), values.shape)
        regions.append(
            ChangedRegion(
                0,
                kind,
                float(lattice.x[box[1]][column]),
                float(lattice.y[box[0]][row]),
                cells * lattice.cell_area,
                float(change[box][inside].mean()),
                float(change[box][row, column]),
                _prevailing(first.state[box][inside]),
                _prevailing(second.state[box][inside]),
            )
        )
    return regions


def _prevailing(codes: Bytes) -> str:
    return STATES[int(np.bincount(codes, minlength=len(STATES)).argmax())]
