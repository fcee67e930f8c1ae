"""A density over poses and its exact integral along straight lines.

Between lattice points the density is linear in x, y and heading. Along a straight motion it is
then a cubic between two crossings of the lattice, which Simpson's rule integrates exactly: what
comes out does not depend on a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.motion.steering import Steering
from ambinav.kernels import kernel
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.threads import run_rows

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Field:
    """Values on the lattice of a map, linear in between, continued into what is not free.

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

    values: NDArray[np.float32]
    free: NDArray[np.bool_]
    origin: tuple[float, float]
    spacing: float
    possible: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, amap: AmbiguityMap, layer: str) -> Field:
        """Take a layer of a map; the layer's name must be one of `amap.layers`."""
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
        """What the kernels take, in their order."""
        return self.values, self.free, *self.origin, 1.0 / self.spacing

    def at(self, x: Floats, y: Floats, theta: Floats) -> Floats:
        """Value at poses, each of shape (N,); nan where the nearest one is not possible."""
        out = np.empty(len(x))
        run_rows(_values, len(x), x, y, theta, *self._checked, out, least=2048)
        return out

    def near(self, x: float, y: float, theta: float) -> float:
        """Value at one pose; where it is not free, that of the nearest free cell."""
        u, v = (x - self.origin[0]) / self.spacing, (y - self.origin[1]) / self.spacing
        w = theta * self.values.shape[2] / (2.0 * math.pi)
        return float(_value(u, v, w, self.values))

    def on(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float32]:
        """Values on another lattice, float32; where that is not free, of the nearest free cell.

        Args:
            x: Of its columns, shape (M,), metres.
            y: Of its rows, shape (N,).

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
        """Derivative by x and y at poses, shape (N, 2), per metre; nan where not possible."""
        out = np.empty((len(x), 2))
        run_rows(_slopes, len(x), x, y, theta, *self._checked, out, least=512)
        return out

    @property
    def _checked(self) -> tuple[Any, ...]:
        """`arrays` with what is possible in place of what is free."""
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
        """Integral over the length of motions, each argument of shape (N,).

        Without a steering they are straight and the heading turns evenly, the short way round.
        Unit of the field times metres.
        """
        # That module's kernels are built on this one's.
        from ambinav.service.motion import motion_integrals

        steering = Steering("se2") if steering is None else steering
        a, b = np.column_stack((x0, y0, theta0)), np.column_stack((x1, y1, theta1))
        out = np.empty(len(a))
        values, _, left, low, inverse = self.arrays
        motion_integrals(
            steering.kind, steering.kernel_radius, a, b, values, left, low, inverse, out
        )
        return out


def nearest_possible(
    possible: NDArray[np.bool_], heading: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """Where the value of each cell at a heading is read: itself, or the nearest possible cell.

    Args:
        possible: Where a robot can stand, shape (rows, columns, headings).
        heading: An index.

    Returns:
        Rows and columns, each of shape (rows, columns), and the heading: this one, or the nearest
        that is possible anywhere.
    """
    from scipy.ndimage import distance_transform_edt

    count = possible.shape[2]
    some = np.flatnonzero(possible.any(axis=(0, 1)))
    near = int(some[np.abs((some - heading + count // 2) % count - count // 2).argmin()])
    row, column = distance_transform_edt(
        ~possible[:, :, near], return_distances=False, return_indices=True
    )
    return row, column, near


def _between(u: NDArray[Any], count: int) -> tuple[NDArray[np.int64], Floats]:
    """`corner` for many."""
    u = np.clip(u, 0.0, count - 1.0)
    low = np.minimum(u.astype(np.int64), max(count - 2, 0))
    return low, u - low


@kernel(inline="always")
def corner(u, count):
    """Lower lattice index and share of the upper one for a lattice coordinate, held at edges."""
    u = min(max(u, 0.0), count - 1.0)
    low = min(int(u), max(count - 2, 0))
    return low, u - low


@kernel(forceinline=True)
def value_at(u, v, w, values):
    """Value at lattice coordinates u (columns), v (rows), w (headings, periodic)."""
    rows, columns, headings = values.shape
    c, a = corner(u, columns)
    r, b = corner(v, rows)
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    turn = math.floor(w)
    share = w - turn
    t0 = int(turn) % headings
    total = 0.0
    for side in range(2 if headings > 1 else 1):
        t = t0 if side == 0 else (t0 + 1) % headings
        low = values[r, c, t] * (1.0 - a) + values[r, c1, t] * a
        high = values[r1, c, t] * (1.0 - a) + values[r1, c1, t] * a
        weight = 1.0 if headings == 1 else (share if side else 1.0 - share)
        total += weight * (low * (1.0 - b) + high * b)
    return total


@kernel
def _value(u, v, w, values):
    return value_at(u, v, w, values)


@kernel(inline="always")
def is_open(u, v, w, possible):
    """Whether the pose nearest to the lattice coordinates is there and possible."""
    rows, columns, headings = possible.shape
    if not (u >= -0.5 and v >= -0.5 and u < columns - 0.5 and v < rows - 0.5):
        return False
    if not math.isfinite(w):
        return False
    k = int(math.floor(w + 0.5)) % headings if headings > 1 else 0
    return possible[int(v + 0.5), int(u + 0.5), k]


@kernel(inline="always")
def next_crossing(u, rate):
    """Path share from lattice coordinate u to the next whole number at `rate` per share."""
    if rate > 0.0:
        return (math.floor(u + 1e-9) + 1.0 - u) / rate
    if rate < 0.0:
        return (math.ceil(u - 1e-9) - 1.0 - u) / rate
    return math.inf


@kernel
def integral_straight(x0, y0, theta0, x1, y1, theta1, values, left, low, inverse):
    """Exact integral of the field over the length of one straight motion."""
    length = math.hypot(x1 - x0, y1 - y0)
    if length == 0.0:
        return 0.0
    u, v = (x0 - left) * inverse, (y0 - low) * inverse
    du, dv = (x1 - x0) * inverse, (y1 - y0) * inverse
    headings = values.shape[2]
    if headings == 1:
        return length * _mean_on_floor(u, v, du, dv, values)
    per_turn = headings / (2.0 * math.pi)
    turn = (theta1 - theta0 + math.pi) % (2.0 * math.pi) - math.pi
    return length * _mean_turning(u, v, theta0 * per_turn, du, dv, turn * per_turn, values)


@kernel(forceinline=True)
def _mean_on_floor(u0, v0, du, dv, values):
    """Mean of a field without headings along a line, in lattice coordinates.

    In a cell the field is f + a (x) + b (y) + d (x y): along a line a parabola, whose mean is its
    value in the middle plus d du dv step^2 / 12. So one cell costs one value.
    """
    rows, columns, _ = values.shape
    c, r = int(math.floor(u0)), int(math.floor(v0))
    to_u, each_u, side_u = _first_line(u0, du, c)
    to_v, each_v, side_v = _first_line(v0, dv, r)
    bend = du * dv / 12.0
    total, t = 0.0, 0.0
    while t < 1.0:
        end = min(to_u, to_v, 1.0)
        step, half = end - t, 0.5 * (t + end)
        inside = 0 <= c < columns - 1 and 0 <= r < rows - 1
        c0, r0 = min(max(c, 0), columns - 1), min(max(r, 0), rows - 1)
        c1, r1 = min(max(c + 1, 0), columns - 1), min(max(r + 1, 0), rows - 1)
        f, right = values[r0, c0, 0], values[r0, c1, 0]
        above, across = values[r1, c0, 0], values[r1, c1, 0]
        a, b = u0 + half * du - c, v0 + half * dv - r
        d = f - right - above + across
        mean = f + a * (right - f) + b * (above - f) + a * b * d
        if inside:
            mean += d * bend * step * step
        total += step * mean
        if to_u <= to_v:
            c += side_u
            to_u += each_u
        else:
            r += side_v
            to_v += each_v
        t = end
    return total


@kernel(inline="always")
def _first_line(u, du, cell):
    """Share of the way to the next lattice line, share from line to line, and the cell's step."""
    if du > 0.0:
        return (cell + 1.0 - u) / du, 1.0 / du, 1
    if du < 0.0:
        return (cell - u) / du, -1.0 / du, -1
    return math.inf, math.inf, 0


@kernel(forceinline=True)
def _mean_turning(u0, v0, w0, du, dv, dw, values):
    """Mean of a field with headings along a line: a cubic between lattice planes, by Simpson."""
    total, t = 0.0, 0.0
    first = value_at(u0, v0, w0, values)
    while t < 1.0:
        u, v, w = u0 + t * du, v0 + t * dv, w0 + t * dw
        step = min(next_crossing(u, du), next_crossing(v, dv), next_crossing(w, dw))
        end = min(t + max(step, 1e-9), 1.0)
        half = 0.5 * (t + end)
        middle = value_at(u0 + half * du, v0 + half * dv, w0 + half * dw, values)
        last = value_at(u0 + end * du, v0 + end * dv, w0 + end * dw, values)
        total += (end - t) * (first + 4.0 * middle + last)
        first = last
        t = end
    return total / 6.0


@kernel
def _values(begin, end, x, y, theta, values, possible, left, low, inverse, out):
    per_turn = values.shape[2] / (2.0 * math.pi)
    for i in range(begin, end):
        u, v = (x[i] - left) * inverse, (y[i] - low) * inverse
        w = theta[i] * per_turn
        if is_open(u, v, w, possible):
            out[i] = value_at(u, v, w, values)
        else:
            out[i] = math.nan


@kernel
def _slopes(begin, end, x, y, theta, values, possible, left, low, inverse, out):
    per_turn = values.shape[2] / (2.0 * math.pi)
    rows, columns, _ = values.shape
    for i in range(begin, end):
        u, v = (x[i] - left) * inverse, (y[i] - low) * inverse
        w = theta[i] * per_turn
        if not is_open(u, v, w, possible):
            out[i] = math.nan
            continue
        c, _ = corner(u, columns)
        r, _ = corner(v, rows)
        across = along = 0.0  # beyond the outermost cells' centres the field stays as it is
        if 0.0 <= u <= columns - 1.0:
            across = value_at(c + 1.0, v, w, values) - value_at(float(c), v, w, values)
        if 0.0 <= v <= rows - 1.0:
            along = value_at(u, r + 1.0, w, values) - value_at(u, float(r), w, values)
        out[i, 0], out[i, 1] = across * inverse, along * inverse
