"""Integral of a field over a motion of any kind: the one number that everything reports.

Planners' objectives, the reference search, the improvement of routes and their evaluation all
call `motion_integral`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.motion.curves import FACING, STRAIGHT, advance, curve_pieces
from ambinav.kernels import kernel
from ambinav.service.field import corner, integral_straight, value_at
from ambinav.threads import run_rows

Floats = NDArray[np.float64]

POINTS = 4
"""On an arc, per cell of the lattice and per heading of the field; no arc has fewer."""


@kernel
def line_integral(x0, y0, x1, y1, values, left, low, inverse):
    """`motion_integral` of the kind FACING, with few arguments: called from Python, each counts."""
    heading = math.atan2(y1 - y0, x1 - x0) if values.shape[2] > 1 else 0.0
    return integral_straight(x0, y0, heading, x1, y1, heading, values, left, low, inverse)


@kernel
def motion_integral(kind, radius, x0, y0, t0, x1, y1, t1, values, left, low, inverse):
    """Integral of a field over the metres travelled by one motion; reverse counts as forwards.

    Straight lines are integrated exactly, arcs by the midpoint rule. FACING takes no notice of t0
    and t1: the field is read at the direction of travel.

    Kind and radius as in `ambinav.geometry.collision.sweep.motion_free`; poses in metres and
    radians; then what `Field.arrays` holds, but for what is free. Returns the field's unit times
    metres.
    """
    if kind == STRAIGHT:
        return integral_straight(x0, y0, t0, x1, y1, t1, values, left, low, inverse)
    if kind == FACING:
        return line_integral(x0, y0, x1, y1, values, left, low, inverse)
    if radius is not None:
        total = 0.0
        pieces = curve_pieces(kind, radius, x0, y0, t0, x1, y1, t1)
        x, y, t = x0, y0, t0
        for i in range(5):
            length, curvature = pieces[i], pieces[i + 5]
            if length == 0.0:
                continue
            x2, y2, t2 = advance(x, y, t, length, curvature)
            if curvature == 0.0:
                total += integral_straight(x, y, t, x2, y2, t, values, left, low, inverse)
            else:
                total += _integral_arc(x, y, t, length, curvature, values, left, low, inverse)
            x, y, t = x2, y2, t2
        return total
    return math.nan


@kernel
def _integral_arc(x, y, t, length, curvature, values, left, low, inverse):
    """Integral over an arc by the midpoint rule; points by turning a vector from its centre.

    The field has a kink at every lattice line. There Simpson's rule is worse: with as many points
    (four a cell, level map of configs/demo.geojson, arcs of 0.2 to 2 m) it was off by up to 0.2 %,
    the midpoints by up to 0.07 %.
    """
    headings = values.shape[2]
    per_turn = headings / (2.0 * math.pi)
    turn = length * curvature
    cells = abs(length) * inverse
    if headings > 1:
        cells = max(cells, abs(turn) * per_turn)
    count = max(int(math.ceil(POINTS * cells)), POINTS)
    radius = inverse / curvature
    sine, cosine = math.sin(t), math.cos(t)
    u, v = (x - left) * inverse - radius * sine, (y - low) * inverse + radius * cosine
    each = turn / count
    sine, cosine = math.sin(t + 0.5 * each), math.cos(t + 0.5 * each)
    step_sine, step_cosine = math.sin(each), math.cos(each)
    total = 0.0
    for i in range(count):
        if headings == 1:
            total += _value_on_floor(u + radius * sine, v - radius * cosine, values)
        else:
            w = (t + (i + 0.5) * each) * per_turn
            total += value_at(u + radius * sine, v - radius * cosine, w, values)
        sine, cosine = (
            sine * step_cosine + cosine * step_sine,
            cosine * step_cosine - sine * step_sine,
        )
    return total * abs(length) / count


@kernel(inline="always")
def _value_on_floor(u, v, values):
    """As `value_at`, of a field without headings."""
    c, a = corner(u, values.shape[1])
    r, b = corner(v, values.shape[0])
    c1, r1 = min(c + 1, values.shape[1] - 1), min(r + 1, values.shape[0] - 1)
    low = values[r, c, 0] * (1.0 - a) + values[r, c1, 0] * a
    high = values[r1, c, 0] * (1.0 - a) + values[r1, c1, 0] * a
    return low * (1.0 - b) + high * b


@kernel
def _integrals(begin, end, kind, radius, a, b, values, left, low, inverse, out):
    for i in range(begin, end):
        out[i] = motion_integral(
            kind, radius, a[i, 0], a[i, 1], a[i, 2], b[i, 0], b[i, 1], b[i, 2],
            values, left, low, inverse,
        )  # fmt: skip


def motion_integrals(
    kind: int,
    radius: float | None,
    a: Floats,
    b: Floats,
    values: NDArray[np.float32],
    left: float,
    low: float,
    inverse: float,
    out: Floats,
) -> None:
    """Write `motion_integral` from each pose of a to that of b, shape (N, 3) each, into out."""
    run_rows(_integrals, len(a), kind, radius, a, b, values, left, low, inverse, out, least=128)
