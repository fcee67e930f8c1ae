"""Sine and cosine without branches, of which the compiler takes several at a time.

In loops over particles they take an eighth of the time of the C library's, which are called one by
one. They are the polynomials of FreeBSD's msun (k_sin.c and k_cos.c), and agree with the C
library's but for the last bit.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel

_QUARTERS = 2.0 / math.pi
# A quarter of a turn in two parts, the first of 33 bits: exact times a whole number below 2^20.
_QUARTER, _QUARTER_REST = 1.57079632673412561417, 6.07710050650619224932e-11


# Not inlined by numba, which would hand on `fastmath` of the caller.
@kernel(forceinline=True)
def sine_cosine(angle):
    """Return sine and cosine of an angle, at most a million radians."""
    quarter = np.floor(angle * _QUARTERS + 0.5)
    r = (angle - quarter * _QUARTER) - quarter * _QUARTER_REST
    z = r * r
    sine = r + r * z * (
        -1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * (
        -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))))  # fmt: skip
    cosine = 1.0 - 0.5 * z + z * z * (
        4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (
        2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * (
        2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)))))  # fmt: skip
    # Of the quarter only its place in a turn counts: 0, 1, 2 or 3.
    place = quarter - 4.0 * np.floor(0.25 * quarter)
    swapped = (place == 1.0) | (place == 3.0)
    s, c = cosine if swapped else sine, sine if swapped else cosine
    return -s if place >= 2.0 else s, -c if (place == 1.0) | (place == 2.0) else c
