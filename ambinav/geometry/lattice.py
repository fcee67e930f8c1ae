"""Lattice of free poses over an environment, and the neighbours that a wall separates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ambinav.casting.plane.raycast import cast_one
from ambinav.config import as_positive
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Bools, Bounds, Bytes, Floats, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# Column and row steps to the eight neighbours; the opposite of direction k is k + 4 (mod 8).
STEPS = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]])
MAX_CELLS = 200_000_000


@dataclass(frozen=True, eq=False)
class Lattice:
    """Square lattice of points; a point is free if it lies in the free space.

    Attributes:
        environment: What it lies over.
        spacing: Distance between neighbours, metres.
        x: Coordinates of the columns, float64, shape (C,), metres, map frame.
        y: Coordinates of the rows, float64, shape (R,), ascending.
        free: bool, shape (R, C).
    """

    environment: Environment
    spacing: float
    x: Floats
    y: Floats
    free: Bools

    @classmethod
    def over(cls, environment: Environment, spacing: float) -> Lattice:
        """Place a lattice over the free space; its points are multiples of `spacing` plus half.

        Raises:
            InputError: the spacing is not a positive number, so small that the lattice does not
                fit into memory, or so large that no point of it is free.
        """
        x, y = cls.axes(environment, spacing)
        inside = np.empty((len(y), len(x)), dtype=np.bool_)
        for row, height in enumerate(y):
            inside[row] = environment.triangulation.contains(x, np.full_like(x, height))
        if not inside.any():
            xmin, ymin, xmax, ymax = environment.free.bounds
            raise InputError(
                f"spacing is {spacing:g} m, and no point of that lattice is free in "
                f"{environment.name} ({xmax - xmin:.2f} x {ymax - ymin:.2f} m); give a smaller "
                "spacing."
            )
        return cls(environment, spacing, x, y, inside)

    @staticmethod
    def axes(
        environment: Environment, spacing: float, most: int = MAX_CELLS
    ) -> tuple[Floats, Floats]:
        """Compute the coordinates of the lattice's columns and rows over an environment.

        Args:
            environment: What it lies over.
            spacing: Distance between neighbours, metres.
            most: Cells that are still of use: those of a lattice that memory is to hold.

        Raises:
            InputError: the spacing is not a positive number, or of no use for its size.
        """
        spacing = as_positive(spacing, "spacing", "metres")
        xmin, ymin, xmax, ymax = environment.free.bounds
        size = f"{xmax - xmin:.2f} x {ymax - ymin:.2f} m"
        if spacing > max(xmax - xmin, ymax - ymin):
            raise InputError(
                f"spacing is {spacing:g} m but the free space of {environment.name} is only "
                f"{size}; give a smaller spacing."
            )
        columns = np.arange(math.floor(xmin / spacing), math.floor(xmax / spacing) + 1)
        rows = np.arange(math.floor(ymin / spacing), math.floor(ymax / spacing) + 1)
        if len(columns) * len(rows) > most:
            raise InputError(
                f"spacing is {spacing:g} m, which makes {len(columns) * len(rows):.3g} cells of "
                f"{environment.name} ({size}); give a larger spacing."
            )
        return (columns + 0.5) * spacing, (rows + 0.5) * spacing

    @property
    def cell_area(self) -> float:
        """Area of one cell, square metres, bit for bit as in a map on this lattice."""
        width, height = (
            (axis[-1] - axis[0]) / (len(axis) - 1) if len(axis) > 1 else self.spacing
            for axis in (self.x, self.y)
        )
        return float(width) * float(height)

    @cached_property
    def index(self) -> Ints32:
        """Index of each free point, row by row, int32, shape (R, C); -1 if not free."""
        index = np.full(self.free.shape, -1, dtype=np.int32)
        index[self.free] = np.arange(int(self.free.sum()), dtype=np.int32)
        return index

    @cached_property
    def rows_columns(self) -> Ints32:
        """Row and column of each free point, int32, shape (N, 2)."""
        return np.argwhere(self.free).astype(np.int32, order="C")

    @property
    def points(self) -> tuple[Floats, Floats]:
        """Coordinates x and y of the free points, each of shape (N,), metres."""
        rows_columns = self.rows_columns
        return self.x[rows_columns[:, 1]], self.y[rows_columns[:, 0]]

    @cached_property
    def links(self) -> Bytes:
        """Links of each free point, uint8, (N,): bit k is set if STEPS[k] crosses no segment."""
        x, y = self.points
        links = np.zeros(len(x), dtype=np.uint8)
        run_rows(
            _link, len(x), self.rows_columns, self.index, x, y, self.spacing, STEPS,
            *self.environment.grid.arrays, links, least=256,
        )  # fmt: skip
        # The second half of the directions is opposite to the first half.
        _link_back(self.rows_columns, self.index, STEPS, links)
        return links

    def links_among(self, mask: Bools) -> Bytes:
        """Return `links` between the free points of the mask, (N,); none from or to others."""
        links = self.links.copy()
        _unlink(self.rows_columns, self.index, STEPS, mask, links)
        return links

    def among(self, mask: Bools) -> Lattice:
        """Return the lattice with only those of its N free points that the mask, (N,), contains."""
        if mask.all():
            return self
        free = np.zeros_like(self.free)
        free[self.free] = mask
        return Lattice(self.environment, self.spacing, self.x, self.y, free)

    def clearance(self, limit: float) -> Floats:
        """Compute each free point's distance, shape (N,), to a segment, at most `limit`."""
        return np.asarray(self.environment.clearance(*self.points, limit))


@kernel
def _link(
    low, high, rows_columns, index, x, y, spacing, steps, x0, y0, cell, rows, columns, start, item,
    line, links,
):  # fmt: skip
    for i in range(low, high):
        bits = 0
        for k in range(4):
            row, column = rows_columns[i, 0] + steps[k, 1], rows_columns[i, 1] + steps[k, 0]
            if row < 0 or column < 0 or row >= index.shape[0] or column >= index.shape[1]:
                continue
            if index[row, column] < 0:
                continue
            length = math.hypot(steps[k, 0], steps[k, 1])
            ux, uy = steps[k, 0] / length, steps[k, 1] / length
            reach = length * spacing
            _, hit = cast_one(x[i], y[i], ux, uy, reach, x0, y0, cell, rows, columns, start, line)
            if hit < 0:
                bits |= 1 << k
        links[i] = bits


@kernel(error_model="python")
def _unlink(rows_columns, index, steps, mask, links):
    for i in range(links.size):
        if not mask[i]:
            links[i] = 0
            continue
        for k in range(8):
            if links[i] & (1 << k):
                j = index[rows_columns[i, 0] + steps[k, 1], rows_columns[i, 1] + steps[k, 0]]
                if not mask[j]:
                    links[i] &= ~(1 << k)


@kernel(error_model="python")
def _link_back(rows_columns, index, steps, links):
    for i in range(links.size):
        for k in range(4):
            if links[i] & (1 << k):
                j = index[rows_columns[i, 0] + steps[k, 1], rows_columns[i, 1] + steps[k, 0]]
                links[j] |= 1 << (k + 4)


def slices_in(bounds: Bounds, x: Floats, y: Floats) -> tuple[slice, slice]:
    """Return the rows and columns of the lattice with axes x and y, metres, within bounds."""
    columns = slice(int(np.searchsorted(x, bounds[0])), int(np.searchsorted(x, bounds[2], "right")))
    rows = slice(int(np.searchsorted(y, bounds[1])), int(np.searchsorted(y, bounds[3], "right")))
    return rows, columns
