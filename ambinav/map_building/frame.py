"""Window of lattice points, by which maps of different extents are laid on each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats


@dataclass(frozen=True)
class Frame:
    """Lattice points from a first column and row on, counted in spacings."""

    column: int
    row: int
    columns: int
    rows: int

    @classmethod
    def of(cls, x: Floats, y: Floats, spacing: float) -> Frame:
        """Return the frame of a lattice."""
        return cls(
            round(float(x[0]) / spacing - 0.5), round(float(y[0]) / spacing - 0.5), len(x), len(y)
        )

    def around(self, other: Frame) -> Frame:
        """Return the smallest frame that contains both."""
        column, row = min(self.column, other.column), min(self.row, other.row)
        right = max(self.column + self.columns, other.column + other.columns)
        top = max(self.row + self.rows, other.row + other.rows)
        return Frame(column, row, right - column, top - row)

    def axes(self, spacing: float) -> tuple[Floats, Floats]:
        """Return coordinates of columns and rows, metres, equal to `Lattice.axes` bit for bit."""
        x = (np.arange(self.column, self.column + self.columns) + 0.5) * spacing
        y = (np.arange(self.row, self.row + self.rows) + 0.5) * spacing
        return np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)

    def taken(self, values: NDArray[Any], frame: Frame, empty: Any) -> NDArray[Any]:
        """Copy values over another frame, shape (rows, columns, ...), to this one."""
        if frame == self:
            return values.copy()
        full = np.full((self.rows, self.columns, *values.shape[2:]), empty, dtype=values.dtype)
        down, left = frame.row - self.row, frame.column - self.column
        rows = slice(max(down, 0), max(min(down + frame.rows, self.rows), 0))
        columns = slice(max(left, 0), max(min(left + frame.columns, self.columns), 0))
        overlap = values[
            max(-down, 0) : max(self.rows - down, 0), max(-left, 0) : max(self.columns - left, 0)
        ]
        full[rows, columns] = overlap
        return full
