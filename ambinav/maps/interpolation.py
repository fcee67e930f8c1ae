"""Reading a lattice of cells between its centres: the kernel behind `AmbiguityMap.sample`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.kernels import kernel

Floats = NDArray[np.float64]


@kernel
def linear(
    values: NDArray[np.float32],
    possible: NDArray[np.bool_],
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
        # Written so that NaN fails: casting NaN to an integer is undefined.
        if not (-0.5 <= u < nx - 0.5 and -0.5 <= v < ny - 0.5):
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
                low = values[r, c, t0]
                high = values[r, c, t1]
                if weight * (1.0 - wt) > 0.0 and not math.isnan(low):
                    total += weight * (1.0 - wt) * low
                    weights += weight * (1.0 - wt)
                if weight * wt > 0.0 and not math.isnan(high):
                    total += weight * wt * high
                    weights += weight * wt
        if weights > 0.0:
            out[i] = total / weights
    return out


@kernel
def nearest(
    values: NDArray[np.float32],
    origin: tuple[float, float, float],
    step: tuple[float, float, float],
    x: Floats,
    y: Floats,
    theta: Floats,
) -> Floats:
    """Value of the nearest cell: arguments as in `linear`, NaN outside of the lattice."""
    ny, nx, nt = values.shape
    out = np.full(x.size, np.nan)
    for i in range(x.size):
        u = (x[i] - origin[0]) / step[0]
        v = (y[i] - origin[1]) / step[1]
        if not (-0.5 <= u < nx - 0.5 and -0.5 <= v < ny - 0.5):
            continue
        t = 0
        if nt > 1:
            w = (theta[i] - origin[2]) / step[2]
            if not math.isfinite(w):
                continue
            t = int(math.floor(w + 0.5) % nt)
        out[i] = values[int(math.floor(v + 0.5)), int(math.floor(u + 0.5)), t]
    return out
