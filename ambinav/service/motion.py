"""Integral of a field over a motion of any kind, used by every report and planner.

Planners' objectives, the reference search, the improvement of routes and their evaluation all
call `motion_integral`.
"""

from __future__ import annotations

import math

from ambinav.geometry.motion.curves import FACING, STRAIGHT, advance, curve_pieces
from ambinav.maps.lattice_values import value_at, value_on_floor
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.kernels import float32_at, kernel
from ambinav.runtime.threads import run_rows

POINTS = 4
"""On an arc, per cell of the lattice and per heading of the field; no arc has fewer."""

# Headings beyond so many radians are reduced to one turn.
_MANY_TURNS = 1e3


@kernel(inline="always")
def next_crossing(u, rate):
    """Return the motion's share to the next whole lattice coordinate, at `rate` per share."""
    if rate > 0.0:
        return (math.floor(u + 1e-9) + 1.0 - u) / rate
    if rate < 0.0:
        return (math.ceil(u - 1e-9) - 1.0 - u) / rate
    return math.inf


@kernel(inline="always")
def _next_line(u, rate, last):
    """Return `next_crossing` with the lines 0 to `last`; the field does not change beyond them."""
    if (rate > 0.0 and u >= last) or (rate < 0.0 and u <= 0.0):
        return math.inf
    if rate > 0.0 and u < 0.0:
        return -u / rate
    if rate < 0.0 and u > last:
        return (last - u) / rate
    return next_crossing(u, rate)


@kernel
def integral_straight(x0, y0, theta0, x1, y1, theta1, values, left, low, inverse):
    """Compute the exact integral of the field over the length of one straight motion."""
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
    if abs(theta0) > _MANY_TURNS:  # steps from heading to heading would be lost in its rounding
        theta0 %= 2.0 * math.pi
    return length * _mean_turning(u, v, theta0 * per_turn, du, dv, turn * per_turn, values)


@kernel(forceinline=True)
def _mean_on_floor(u0, v0, du, dv, values):
    """Average a field without headings along a line, in lattice coordinates.

    In a cell the field is f + a (x) + b (y) + d (x y): along a line a parabola, whose mean is its
    value in the middle plus d du dv step^2 / 12. So one cell costs one value. All that lies before
    the lattice's first line is one cell, and all that lies beyond its last.
    """
    rows, columns, _ = values.shape
    c, to_u, each_u, side_u = _first_line(u0, du, columns - 1)
    r, to_v, each_v, side_v = _first_line(v0, dv, rows - 1)
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
            to_u = to_u + each_u if 0 <= c < columns - 1 else math.inf
        else:
            r += side_v
            to_v = to_v + each_v if 0 <= r < rows - 1 else math.inf
        t = end
    return total


@kernel(inline="always")
def _first_line(u, du, last):
    """Return the cell, the share to the next line, that from line to line, and the cell's step.

    The lines are 0 to `last`, and the cells -1 to `last`.
    """
    cell = min(max(int(math.floor(min(max(u, -1.0), last))), -1), last)
    if du > 0.0 and cell < last:
        return cell, (cell + 1.0 - u) / du, 1.0 / du, 1
    if du < 0.0 and cell >= 0:
        return cell, (cell - u) / du, -1.0 / du, -1
    return cell, math.inf, math.inf, 0


@kernel(forceinline=True)
def _mean_turning(u0, v0, w0, du, dv, dw, values):
    """Average a field with headings along a line: a cubic between lattice planes, by Simpson."""
    rows, columns, _ = values.shape
    total, t = 0.0, 0.0
    first = value_at(u0, v0, w0, values)
    while t < 1.0:
        u, v, w = u0 + t * du, v0 + t * dv, w0 + t * dw
        step = min(
            _next_line(u, du, columns - 1), _next_line(v, dv, rows - 1), next_crossing(w, dw)
        )
        end = min(t + max(step, 1e-9), 1.0)
        half = 0.5 * (t + end)
        middle = value_at(u0 + half * du, v0 + half * dv, w0 + half * dw, values)
        last = value_at(u0 + end * du, v0 + end * dv, w0 + end * dw, values)
        total += (end - t) * (first + 4.0 * middle + last)
        first = last
        t = end
    return total / 6.0


@kernel
def integral_in_space(x0, y0, z0, x1, y1, z1, values, left, low, bottom, inverse, inverse_z):
    """Compute the exact integral over the length of a straight motion in space.

    The heights of the field take the place of headings: within them the axis never comes round.
    """
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        return 0.0
    return length * _mean_turning(
        (x0 - left) * inverse, (y0 - low) * inverse, (z0 - bottom) * inverse_z,
        dx * inverse, dy * inverse, dz * inverse_z, values,
    )  # fmt: skip


@kernel
def line_integral(x0, y0, x1, y1, values, left, low, inverse):
    """Compute `motion_integral` of the kind FACING; few arguments make calls from Python fast."""
    heading = math.atan2(y1 - y0, x1 - x0) if values.shape[2] > 1 else 0.0
    return integral_straight(x0, y0, heading, x1, y1, heading, values, left, low, inverse)


@kernel
def motion_integral(kind, radius, x0, y0, t0, x1, y1, t1, values, left, low, inverse):
    """Integrate a field over one motion's length in metres; reverse counts as forwards.

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
        # No curve leads from or to what is no number.
        total = 0.0 * (x0 + y0 + t0 + x1 + y1 + t1)
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
def line_cost_at(x0, y0, x1, y1, address, rows, columns, headings, left, low, inverse):
    """Compute `line_integral` over values at an address, infinite from or to no number."""
    values = float32_at(address, (rows, columns, headings))
    cost = line_integral(x0, y0, x1, y1, values, left, low, inverse)
    return math.inf if math.isnan(cost) else cost


@kernel
def motion_cost_at(
    kind, radius, x0, y0, t0, x1, y1, t1, address, rows, columns, headings, left, low, inverse
):
    """Compute `motion_integral` over values at an address, infinite from or to no number."""
    values = float32_at(address, (rows, columns, headings))
    cost = motion_integral(kind, radius, x0, y0, t0, x1, y1, t1, values, left, low, inverse)
    return math.inf if math.isnan(cost) else cost


@kernel
def _integral_arc(x, y, t, length, curvature, values, left, low, inverse):
    """Integrate over an arc by the midpoint rule; points turn a vector about the centre.

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
            total += value_on_floor(u + radius * sine, v - radius * cosine, 0, values)
        else:
            w = (t + (i + 0.5) * each) * per_turn
            total += value_at(u + radius * sine, v - radius * cosine, w, values)
        sine, cosine = (
            sine * step_cosine + cosine * step_sine,
            cosine * step_cosine - sine * step_sine,
        )
    return total * abs(length) / count


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
    values: Floats32,
    left: float,
    low: float,
    inverse: float,
    out: Floats,
) -> None:
    """Write `motion_integral` from each pose of a to that of b, shape (N, 3) each, into out."""
    run_rows(_integrals, len(a), kind, radius, a, b, values, left, low, inverse, out, least=128)
