"""Connected regions where two maps differ: level changed, or ambiguous floor that is new."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from scipy import ndimage

from ambinav.maps.zones import BAD
from ambinav.reports.fields import Metres, Part, SquareMetres, rounded
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.studies.diff.registration import STATES, CommonLattice, ReadMap

Kind = Literal["worse", "better", "new floor"]

NOTABLE: Final = 0.1
"""Difference in level from which a cell is worse or better."""
LEAST_AREA: Final = 1.0
"""Square metres; smaller regions are not listed."""
_NEIGHBOURS: Final = np.ones((3, 3), dtype=np.bool_)


LevelChange = Annotated[float, rounded(4)]


class RegionPart(Part):
    """A region that differs."""

    number: int = Field(description="rank, from 1: by the change in level times area")
    kind: Kind
    x_m: Metres = Field(description="the point that has changed most")
    y_m: Metres
    area_m2: SquareMetres
    change: LevelChange = Field(description="mean difference of the level; of new floor its level")
    largest: LevelChange = Field(description="the same at (x, y)")
    before: str
    after: str


def changed_regions(
    lattice: CommonLattice, first: ReadMap, second: ReadMap
) -> tuple[RegionPart, ...]:
    """Find the regions that differ notably, the most important first."""
    rise = second.level - first.level
    ambiguous = np.isin(second.state, BAD) & ~first.counted
    masks: tuple[tuple[Kind, Bools, Floats], ...] = (
        ("worse", rise >= NOTABLE, rise),
        ("better", rise <= -NOTABLE, rise),
        ("new floor", ambiguous, second.level),
    )
    weighed = [
        found
        for kind, mask, change in masks
        for found in _regions(lattice, kind, mask, change, first, second)
    ]
    weighed.sort(key=lambda found: -found[0])
    return tuple(
        region.model_copy(update={"number": number})
        for number, (_, region) in enumerate(weighed, start=1)
    )


def _regions(
    lattice: CommonLattice, kind: Kind, mask: Bools, change: Floats, first: ReadMap, second: ReadMap
) -> list[tuple[float, RegionPart]]:
    """Return the regions of a kind, each with its change in level times area."""
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
        area, mean = cells * lattice.cell_area, float(change[box][inside].mean())
        region = RegionPart(
            number=0,
            kind=kind,
            x_m=lattice.x[box[1]][column],
            y_m=lattice.y[box[0]][row],
            area_m2=area,
            change=mean,
            largest=change[box][row, column],
            before=_prevailing(first.state[box][inside]),
            after=_prevailing(second.state[box][inside]),
        )
        regions.append((abs(mean) * area, region))
    return regions


def _prevailing(codes: Bytes) -> str:
    return STATES[int(np.bincount(codes, minlength=len(STATES)).argmax())]
