"""Registration of two maps by their frame: the finer one is read on the coarser lattice."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import ZONES
from ambinav.runtime.array_types import Bools, Bytes, Floats, Indices
from ambinav.runtime.errors import InputError

STATES: Final = (*ZONES, "unexplored", "unreachable", "not free", "outside")
"""State of a cell: its zone if it counts, otherwise the reason. Positions are codes.

"outside" is outside of the building as well as beyond the map.
"""
COUNTED: Final = len(ZONES)
"""Codes below this one are of floor that counts."""
UNEXPLORED, UNREACHABLE, NOT_FREE, OUTSIDE = range(COUNTED, COUNTED + 4)

_ON_LATTICE: Final = 1e-3
"""Cells that two lattices may be off each other and still count as one."""


@dataclass(frozen=True, eq=False)
class CommonLattice:
    """Lattice that covers two maps.

    Attributes:
        x: Centres, metres, ascending, shape (nx,).
        y: The same along y, shape (ny,).
        spacing: Between them, metres.
        resampled: Whether the maps' own lattices differ, so that one is read between its cells.
    """

    x: Floats
    y: Floats
    spacing: float
    resampled: bool

    @property
    def cell_area(self) -> float:
        """Area of a cell, square metres."""
        return self.spacing**2

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax), edges of the outermost cells, metres."""
        half = self.spacing / 2
        x, y = self.x, self.y
        return (
            float(x[0] - half), float(y[0] - half), float(x[-1] + half), float(y[-1] + half)
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ReadMap:
    """A map as read on a common lattice.

    Attributes:
        state: Codes of `STATES`, uint8, shape (ny, nx).
        level: Ambiguity level, mean over headings, shape (ny, nx); nan where no floor counts.
    """

    state: Bytes
    level: Floats

    @property
    def counted(self) -> Bools:
        """Mask of the floor that counts, shape (ny, nx)."""
        return np.asarray(self.state < COUNTED)


def common_lattice(first: AmbiguityMap, second: AmbiguityMap) -> CommonLattice:
    """Extend the lattice of the coarser map over both maps; of equals, that of the first.

    Raises:
        InputError: the maps are in different frames, or do not overlap.
    """
    frames = [str(amap.dataset.attrs.get("frame", "map")) for amap in (first, second)]
    if frames[0] != frames[1]:
        raise InputError(
            f"{second.source}: the map is in the frame {frames[1]!r}, {first.source} in "
            f"{frames[0]!r}; give two maps in one frame."
        )
    (ax0, ay0, ax1, ay1), (bx0, by0, bx1, by1) = first.bounds, second.bounds
    if min(ax1, bx1) <= max(ax0, bx0) or min(ay1, by1) <= max(ay0, by0):
        raise InputError(
            f"{second.source}: the map (x {bx0:g} to {bx1:g} m, y {by0:g} to {by1:g} m) does not "
            f"overlap {first.source} (x {ax0:g} to {ax1:g} m, y {ay0:g} to {ay1:g} m); give two "
            "maps of one place in one frame."
        )
    same_step = math.isclose(first.spacing, second.spacing, rel_tol=1e-6)
    base = second if second.spacing > first.spacing and not same_step else first
    steps = [
        float(amap.dataset[axis].values[0] - base.dataset[axis].values[0]) / base.spacing
        for amap in (first, second)
        for axis in ("x", "y")
    ]
    aligned = same_step and all(abs(step - round(step)) <= _ON_LATTICE for step in steps)
    return CommonLattice(
        _centres(base, "x", min(ax0, bx0), max(ax1, bx1)),
        _centres(base, "y", min(ay0, by0), max(ay1, by1)),
        base.spacing,
        not aligned,
    )


def _centres(base: AmbiguityMap, axis: str, low: float, high: float) -> Floats:
    """Extend the cell centres of a lattice axis to cover [low, high]."""
    values, step = base.dataset[axis].values.astype(np.float64), base.spacing
    tolerance = _ON_LATTICE * step
    before = max(math.ceil((values[0] - step / 2 - low - tolerance) / step), 0)
    after = max(math.ceil((high - values[-1] - step / 2 - tolerance) / step), 0)
    # The map's own centres as they are, so that nothing is rounded anew.
    return np.concatenate(
        [
            values[0] - step * np.arange(before, 0, -1),
            values,
            values[-1] + step * np.arange(1, after + 1),
        ]
    )


def read_on(lattice: CommonLattice, amap: AmbiguityMap, parts: JudgedFloor) -> ReadMap:
    """Read a map on a common lattice.

    Codes are of the nearest cell. Levels are too where the lattices are one, else interpolated
    as `AmbiguityMap.sample` does.
    """
    free = np.asarray(amap.dataset["free"].values, dtype=np.bool_)
    state = np.full(free.shape, NOT_FREE, dtype=np.uint8)
    state[free] = UNREACHABLE
    state[parts.unexplored] = UNEXPLORED
    state[parts.outside] = OUTSIDE
    zone = amap.floor("zone").values
    state[parts.counted] = zone[parts.counted]
    rows, columns = (
        _nearest(values, amap.dataset[axis].values, amap.spacing)
        for axis, values in (("y", lattice.y), ("x", lattice.x))
    )
    inside = np.ix_(rows >= 0, columns >= 0)
    cells = np.ix_(rows[rows >= 0], columns[columns >= 0])
    read = np.full((lattice.y.size, lattice.x.size), OUTSIDE, dtype=np.uint8)
    read[inside] = state[cells]
    level = np.full(read.shape, np.nan)
    if lattice.resampled:
        row, column = np.nonzero(read < COUNTED)
        level[row, column] = amap.sample("level", lattice.x[column], lattice.y[row])
    else:
        level[inside] = amap.floor("level").values[cells]
        level[read >= COUNTED] = np.nan
    return ReadMap(read, level)


def _nearest(values: Floats, centres: Floats, step: float) -> Indices:
    """Return indices of the cells that contain coordinates; -1 outside."""
    index = np.floor((values - centres[0]) / step + 0.5).astype(np.intp)
    return np.where((index >= 0) & (index < centres.size), index, -1)
