"""Uniform grid over the segments, so that a query checks only nearby segments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambinav.geometry.segments import Segments
from ambinav.runtime.array_types import Floats, Ints32
from ambinav.runtime.kernels import kernel

MAX_CELLS = 4_000_000
# Cells touched by a segment are found with this slack, in cells, so that a segment on a cell's
# edge stands on both sides of it.
SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class SegmentGrid:
    """Segments sorted into square cells; each cell lists every segment that touches it.

    Attributes:
        origin: Lower left corner of the grid, float64, shape (2,), metres.
        cell: Edge of a cell in metres.
        shape: (rows, columns); row 0 lies at the smallest y.
        start: int32, shape (rows * columns + 1,): the items of cell k are start[k]:start[k+1].
        item: int32: index of the segment.
        line: float64, shape (items, 4): ax, ay and the vector to the other end, laid out by item
            so that the segments of a cell are read in one go.
    """

    origin: Floats
    cell: float
    shape: tuple[int, int]
    start: Ints32
    item: Ints32
    line: Floats

    @classmethod
    def build(cls, segments: Segments, cell: float | None = None) -> SegmentGrid:
        """Sort `segments` into cells of edge `cell` metres (chosen from their density if None)."""
        xmin, ymin, xmax, ymax = segments.bounds
        width, height = xmax - xmin, ymax - ymin
        if cell is None:
            # About one cell for each metre of wall: flat between half and twice this value.
            cell = min(max(0.4 * width * height / float(segments.lengths.sum()), 0.2), 0.5)
        cell = max(cell, math.sqrt(width * height / MAX_CELLS), max(width, height) / MAX_CELLS)
        # One cell of margin on every side keeps a walk inside without a test for each step.
        rows, columns = int(height / cell) + 3, int(width / cell) + 3
        origin = np.array([xmin - cell, ymin - cell])
        counts = np.zeros(rows * columns + 1, dtype=np.int64)
        _sort_into_cells(segments.xy, origin, cell, columns, counts, np.empty(0, dtype=np.int32))
        start = np.cumsum(counts)
        item = np.empty(int(start[-1]), dtype=np.int32)
        _sort_into_cells(segments.xy, origin, cell, columns, start[:-1].copy(), item)
        line = np.empty((len(item), 4))
        line[:, :2] = segments.xy[item, :2]
        line[:, 2:] = segments.xy[item, 2:] - segments.xy[item, :2]
        return cls(origin, cell, (rows, columns), start.astype(np.int32), item, line)

    @property
    def arrays(self) -> tuple[Any, ...]:
        """Arguments of the kernels, in their order."""
        x, y = self.origin
        rows, columns = self.shape
        return float(x), float(y), self.cell, rows, columns, self.start, self.item, self.line


@kernel(error_model="python")
def _sort_into_cells(xy, origin, cell, columns, cursor, item):
    """Count items into cursor[k + 1] if `item` is empty, else write them and advance cursor[k]."""
    for s in range(xy.shape[0]):
        ax, ay = (xy[s, 0] - origin[0]) / cell, (xy[s, 1] - origin[1]) / cell
        bx, by = (xy[s, 2] - origin[0]) / cell, (xy[s, 3] - origin[1]) / cell
        if ay > by:
            ax, ay, bx, by = bx, by, ax, ay
        slope = (bx - ax) / (by - ay) if by - ay > SLACK else 0.0
        for row in range(int(ay - SLACK), int(by + SLACK) + 1):
            left, right = min(ax, bx), max(ax, bx)
            if by - ay > SLACK:
                x0 = ax + slope * (max(row - SLACK, ay) - ay)
                x1 = ax + slope * (min(row + 1 + SLACK, by) - ay)
                left, right = max(min(x0, x1), left), min(max(x0, x1), right)
            for column in range(int(left - SLACK), int(right + SLACK) + 1):
                k = row * columns + column
                if item.size > 0:
                    item[cursor[k]] = s
                    cursor[k] += 1
                else:
                    cursor[k + 1] += 1
