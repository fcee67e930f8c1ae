"""Interpolation of values on a lattice, for maps, fields, planners and localizers.

Lattice coordinates count cells from the centre of the first one: u along x (columns), v along y
(rows), w in headings, which are periodic. `linear` and `nearest` read lattices with holes, as maps
are stored; `value_at` and what follows it read lattices whose holes are filled, as `Field` has
them.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.kernels import kernel


@kernel(inline="always")
def is_within(u, v, rows, columns):
    """Return whether the lattice coordinates lie in a cell of the lattice; False for nan."""
    return u >= -0.5 and v >= -0.5 and u < columns - 0.5 and v < rows - 0.5


@kernel(inline="always")
def bilinear(here, right, above, across, a, b):
    """Interpolate in a cell from its corner values; a and b rise from 0 to 1 with x and y."""
    low = here * (1.0 - a) + right * a
    high = above * (1.0 - a) + across * a
    return low * (1.0 - b) + high * b


@kernel
def linear(
    values: Floats32,
    possible: Bools,
    origin: tuple[float, float, float],
    step: tuple[float, float, float],
    x: Floats,
    y: Floats,
    theta: Floats,
) -> Floats:
    """Interpolate linearly in x and y, and periodically in heading.

    A corner whose value is NaN is left out and the weights of the others are made to sum to 1.

    Args:
        values: (ny, nx, nt), NaN where not known; nt = 1 if the heading does not matter.
        possible: (ny, nx, nt), True where a robot can stand.
        origin: x, y, theta of cell [0, 0, 0], metres and radians.
        step: distance between cells along x, y, theta; metres and radians.
        x: (n,) metres.
        y: (n,) metres.
        theta: (n,) radians; not read if nt = 1.

    Returns:
        (n,); NaN where the nearest pose is not possible or outside of the lattice.
    """
    ny, nx, nt = values.shape
    out = np.full(x.size, np.nan)
    for i in range(x.size):
        u = (x[i] - origin[0]) / step[0]
        v = (y[i] - origin[1]) / step[1]
        if not is_within(u, v, ny, nx):
            continue
        t0, t1, wt = 0, 0, 0.0
        if nt > 1:
            w = (theta[i] - origin[2]) / step[2]
            if not math.isfinite(w):
                continue
            below = math.floor(w)
            wt = w - below
            t0 = int(below % nt)
            t1 = (t0 + 1) % nt
        near = t1 if wt >= 0.5 else t0
        if not possible[int(math.floor(v + 0.5)), int(math.floor(u + 0.5)), near]:
            continue
        column, row = int(math.floor(u)), int(math.floor(v))
        wx, wy = u - column, v - row
        total, weights = 0.0, 0.0
        for b in range(2):
            r = row + b
            if r < 0 or r >= ny:
                continue
            for a in range(2):
                c = column + a
                if c < 0 or c >= nx:
                    continue
                weight = (wx if a else 1.0 - wx) * (wy if b else 1.0 - wy)
                for t, share in ((t0, 1.0 - wt), (t1, wt)):
                    value = values[r, c, t]
                    if weight * share > 0.0 and not math.isnan(value):
                        total += weight * share * value
                        weights += weight * share
        if weights > 0.0:
            out[i] = total / weights
    return out


@kernel
def nearest(
    values: Floats32,
    origin: tuple[float, float, float],
    step: tuple[float, float, float],
    x: Floats,
    y: Floats,
    theta: Floats,
) -> Floats:
    """Return the value of the nearest cell: arguments as in `linear`, nan off the lattice."""
    ny, nx, nt = values.shape
    out = np.full(x.size, np.nan)
    for i in range(x.size):
        u = (x[i] - origin[0]) / step[0]
        v = (y[i] - origin[1]) / step[1]
        if not is_within(u, v, ny, nx):
            continue
        t = 0
        if nt > 1:
            w = (theta[i] - origin[2]) / step[2]
            if not math.isfinite(w):
                continue
            t = int(math.floor(w + 0.5) % nt)
        out[i] = values[int(math.floor(v + 0.5)), int(math.floor(u + 0.5)), t]
    return out


@kernel(inline="always")
def corner(u, count):
    """Return a coordinate's lower lattice index and upper share, clamped at the edges."""
    u = min(max(u, 0.0), count - 1.0)
    low = min(int(u), max(count - 2, 0))
    return low, u - low


@kernel(inline="always")
def value_on_floor(u, v, t, values):
    """Return the value at lattice coordinates u (columns) and v (rows) of one heading."""
    rows, columns = values.shape[0], values.shape[1]
    c, a = corner(u, columns)
    r, b = corner(v, rows)
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    return bilinear(values[r, c, t], values[r, c1, t], values[r1, c, t], values[r1, c1, t], a, b)


@kernel(forceinline=True)
def value_at(u, v, w, values):
    """Return the value at lattice coordinates u (columns), v (rows), w (headings, periodic)."""
    headings = values.shape[2]
    turn = math.floor(w)
    share = w - turn
    t0 = int(turn) % headings
    total = 0.0
    for side in range(2 if headings > 1 else 1):
        t = t0 if side == 0 else (t0 + 1) % headings
        weight = 1.0 if headings == 1 else (share if side else 1.0 - share)
        total += weight * value_on_floor(u, v, t, values)
    return total


@kernel(inline="always")
def is_open(u, v, w, possible):
    """Return whether the pose nearest to the lattice coordinates exists and is possible."""
    rows, columns, headings = possible.shape
    if not is_within(u, v, rows, columns):
        return False
    if not math.isfinite(w):
        return False
    k = int(math.floor(w + 0.5)) % headings if headings > 1 else 0
    return possible[int(v + 0.5), int(u + 0.5), k]


@kernel
def values_at(begin, end, x, y, theta, values, possible, left, low, inverse, missing, out):
    """Write the value at each pose, metres and radians; `missing` where none is."""
    per_turn = values.shape[2] / (2.0 * math.pi)
    for i in range(begin, end):
        u, v = (x[i] - left) * inverse, (y[i] - low) * inverse
        w = theta[i] * per_turn
        if is_open(u, v, w, possible):
            out[i] = value_at(u, v, w, values)
        else:
            out[i] = missing


@kernel
def slopes_at(begin, end, x, y, theta, values, possible, left, low, inverse, out):
    """Write the derivatives by x and y at each pose, per metre; nan where not possible."""
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
