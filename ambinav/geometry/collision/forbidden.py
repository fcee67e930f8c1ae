"""Cells that the robot's reference point must not enter, whatever the clearance there."""

from __future__ import annotations

import math

from ambinav.geometry.collision.disc_sweep import place
from ambinav.geometry.collision.obstacles import FORBIDDEN_INVERSE, FORBIDDEN_X, FORBIDDEN_Y
from ambinav.runtime.kernels import kernel

# An arc is followed in chords that leave it by at most this share of a cell.
SAGITTA = 0.01
# Two borders that are crossed within this share of a line are crossed in their corner.
TIE = 1e-9


@kernel(inline="always")
def is_forbidden(x, y, table, forbidden):
    """Return whether the cell nearest to a point is forbidden; False outside of the array."""
    u = (x - table[FORBIDDEN_X]) * table[FORBIDDEN_INVERSE] + 0.5
    v = (y - table[FORBIDDEN_Y]) * table[FORBIDDEN_INVERSE] + 0.5
    if not (u >= 0.0 and v >= 0.0 and u < forbidden.shape[1] and v < forbidden.shape[0]):
        return False
    return forbidden[int(v), int(u)]


@kernel(inline="always")
def _is_closed(row, column, forbidden):
    there = 0 <= row < forbidden.shape[0] and 0 <= column < forbidden.shape[1]
    return there and forbidden[row, column]


@kernel
def _line_enters(px, py, qx, qy, table, forbidden):
    """Return whether a line meets a forbidden cell (the walk of Amanatides and Woo 1987)."""
    inverse = table[FORBIDDEN_INVERSE]
    u, v = (px - table[FORBIDDEN_X]) * inverse + 0.5, (py - table[FORBIDDEN_Y]) * inverse + 0.5
    du, dv = (qx - px) * inverse, (qy - py) * inverse
    column, row = int(math.floor(u)), int(math.floor(v))
    last_column, last_row = int(math.floor(u + du)), int(math.floor(v + dv))
    right, up = (1 if du > 0.0 else -1), (1 if dv > 0.0 else -1)
    # Path shares: from one crossing to the next, and to the first one.
    step_u, step_v = 1.0 / max(abs(du), 1e-300), 1.0 / max(abs(dv), 1e-300)
    to_u = (column + 1 - u if du > 0.0 else u - column) * step_u
    to_v = (row + 1 - v if dv > 0.0 else v - row) * step_v
    while True:
        if _is_closed(row, column, forbidden):
            return True
        if row == last_row and column == last_column:
            return False
        if row != last_row and column != last_column and abs(to_u - to_v) < TIE:
            # Through a corner: between two closed cells nothing gets, and past one everything does,
            # whichever way it goes.
            if _is_closed(row, column + right, forbidden) and _is_closed(
                row + up, column, forbidden
            ):
                return True
            column += right
            row += up
            to_u += step_u
            to_v += step_v
        # Rounding may not lead past the last row or column.
        elif row == last_row or (column != last_column and to_u < to_v):
            column += right
            to_u += step_u
        else:
            row += up
            to_v += step_v


@kernel
def enters(px, py, ux, uy, curvature, length, table, forbidden):
    """Return whether a path, given as in `disc_sweep.clear_along`, meets a forbidden cell."""
    count = 1
    if curvature != 0.0:
        chord = math.sqrt(8.0 * SAGITTA / (table[FORBIDDEN_INVERSE] * abs(curvature)))
        count = int(math.ceil(length / chord)) if length > 0.0 else 1
    x, y = px, py
    for k in range(1, count + 1):
        qx, qy = place(px, py, ux, uy, curvature, length * k / count)
        if _line_enters(x, y, qx, qy, table, forbidden):
            return True
        x, y = qx, qy
    return False
