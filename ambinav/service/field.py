"""Density over poses and its exact integral along straight lines.

Between lattice points the density is linear in x, y and heading. Along a straight motion it is
then a cubic between two crossings of the lattice, which Simpson's rule integrates exactly: what
comes out does not depend on a step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.lattice_values import slopes_at, value_at, values_at
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.threads import run_rows
from ambinav.service.motion import motion_integrals


def check_cost(layer: str, attrs: Mapping[Any, Any], values: Floats32) -> None:
    """Check that a layer can be a cost.

    Args:
        layer: Its name.
        attrs: Its attributes, see `schema`.
        values: Its values where a robot can be.

    Raises:
        InputError: it is high where a robot is well localized, or has a value below 0 or one that
            is not finite.
    """
    if attrs.get("worse") == "low" or attrs.get("better") == "high":
        raise InputError(
            f"layer {layer!r} is high where a robot is well localized; a cost needs one that is "
            "high where it is not, such as level."
        )
    for value in (values.min(), values.max()):
        if not 0.0 <= value < np.inf:
            raise InputError(
                f"layer {layer!r} holds {value:g}; a cost needs a layer that is finite and never "
                "below 0, such as level."
            )


@dataclass(frozen=True, eq=False)
class Field:
    """Values on the lattice of a map, linear in between, extended into cells that are not free.

    Attributes:
        values: float32, shape (rows, columns, headings), headings 1 if it does not matter. What
            is not free holds the value of the nearest free cell, so that the field is continuous
            up to the walls. So does, of the cells that are possible at its heading, what is not.
        free: bool, shape (rows, columns).
        origin: x and y of the first cell's centre, metres.
        spacing: Metres.
        possible: bool, shape (rows, columns, headings): where a robot can stand; None: wherever
            it is free.
    """

    values: Floats32
    free: Bools
    origin: tuple[float, float]
    spacing: float
    possible: Bools | None = None

    @classmethod
    def of(cls, amap: AmbiguityMap, layer: str) -> Field:
        """Make a field from a layer of a map, one of `amap.layers`."""
        data = amap.dataset[layer]
        values = data.values.astype(np.float32)
        if values.ndim == 2:
            values = values[:, :, np.newaxis]
        free = np.ascontiguousarray(amap.dataset["free"].values, dtype=np.bool_)
        possible = amap.possible if values.shape[2] > 1 else free[:, :, np.newaxis]
        filled = np.empty_like(values)
        for k in range(values.shape[2]):
            filled[:, :, k] = values[nearest_possible(possible, k)]
        origin = (float(amap.dataset["x"].values[0]), float(amap.dataset["y"].values[0]))
        return cls(filled, free, origin, amap.spacing, possible)

    @property
    def arrays(self) -> tuple[Any, ...]:
        """Arguments of the kernels, in their order."""
        return self.values, self.free, *self.origin, 1.0 / self.spacing

    def at(self, x: Floats, y: Floats, theta: Floats, missing: float = math.nan) -> Floats:
        """Return values at poses, shape (N,) each; `missing` where the nearest is not possible."""
        out = np.empty(len(x))
        run_rows(values_at, len(x), x, y, theta, *self._checked, missing, out, least=2048)
        return out

    def near(self, x: float, y: float, theta: float) -> float:
        """Return the value at one pose; where it is not free, that of the nearest free cell."""
        u, v = (x - self.origin[0]) / self.spacing, (y - self.origin[1]) / self.spacing
        w = theta * self.values.shape[2] / (2.0 * math.pi)
        return float(value_at(u, v, w, self.values))

    def on(self, x: NDArray[Any], y: NDArray[Any]) -> Floats32:
        """Return float32 values on another lattice; where not free, of the nearest free cell.

        Args:
            x: x of its columns, shape (M,), metres.
            y: y of its rows, shape (N,).

        Returns:
            Shape (N, M, headings).
        """
        rows, columns, _ = self.values.shape
        row, up = _between((y - self.origin[1]) / self.spacing, rows)
        column, right = _between((x - self.origin[0]) / self.spacing, columns)
        up, right = up[:, None, None], right[:, None]
        beside = np.minimum(column + 1, columns - 1)
        lines = self.values[:, column] * (1.0 - right) + self.values[:, beside] * right
        above = np.minimum(row + 1, rows - 1)
        return np.asarray(lines[row] * (1.0 - up) + lines[above] * up, dtype=np.float32)

    def slope(self, x: Floats, y: Floats, theta: Floats) -> Floats:
        """Return derivatives by x and y at poses, (N, 2), per metre; nan where not possible."""
        out = np.empty((len(x), 2))
        run_rows(slopes_at, len(x), x, y, theta, *self._checked, out, least=512)
        return out

    @property
    def _checked(self) -> tuple[Any, ...]:
        """Arguments `arrays` with the mask of possible poses in place of free cells."""
        possible = self.free[:, :, np.newaxis] if self.possible is None else self.possible
        return self.values, possible, *self.origin, 1.0 / self.spacing

    def integral(
        self,
        x0: Floats,
        y0: Floats,
        theta0: Floats,
        x1: Floats,
        y1: Floats,
        theta1: Floats,
        steering: Steering | None = None,
    ) -> Floats:
        """Integrate over the length of motions, each argument of shape (N,).

        Without a steering they are straight and the heading turns evenly, the short way round.
        Unit of the field times metres.
        """
        steering = Steering("se2") if steering is None else steering
        a, b = np.column_stack((x0, y0, theta0)), np.column_stack((x1, y1, theta1))
        out = np.empty(len(a))
        values, _, left, low, inverse = self.arrays
        motion_integrals(
            steering.kind, steering.kernel_radius, a, b, values, left, low, inverse, out
        )
        return out


def nearest_possible(possible: Bools, heading: int) -> tuple[Ints32, Ints32, int]:
    """Find the cell from which each cell's value is read: itself, or the nearest possible cell.

    Args:
        possible: Where a robot can stand, shape (rows, columns, headings).
        heading: An index.

    Returns:
        Rows and columns, each of shape (rows, columns), and the heading: this one, or the nearest
        that is possible anywhere.
    """
    from scipy.ndimage import distance_transform_edt

    count = possible.shape[2]
    headings = np.flatnonzero(possible.any(axis=(0, 1)))
    near = int(headings[np.abs((headings - heading + count // 2) % count - count // 2).argmin()])
    row, column = distance_transform_edt(
        ~possible[:, :, near], return_distances=False, return_indices=True
    )
    return row, column, near


def _between(u: NDArray[Any], count: int) -> tuple[Ints, Floats]:
    """Compute `corner` for many coordinates."""
    u = np.clip(u, 0.0, count - 1.0)
    low = np.minimum(u.astype(np.int64), max(count - 2, 0))
    return low, u - low
