"""Kernels that tell whether a pose is free and whether a motion is.

Both take the arrays of a `CollisionChecker` and are called one by one by planners written in
Python, or from other kernels.
"""

from __future__ import annotations

import math

from ambinav.geometry.collision.disc_sweep import clear_along, place
from ambinav.geometry.collision.forbidden import enters, is_forbidden
from ambinav.geometry.collision.obstacles import (
    CORNERS,
    INNER,
    OUTER,
    TURNS,
    around,
    in_triangles,
    nearest_gap,
)
from ambinav.geometry.collision.polygon_sweep import moved_clear, polygon_clear
from ambinav.geometry.footprint import ROUNDING
from ambinav.geometry.motion.curves import FACING, STRAIGHT, curve_pieces
from ambinav.runtime.kernels import kernel


@kernel
def pose_free(x, y, t, table, bound, forbidden):
    """Return whether the footprint fits at a pose; for a disc the same as `Environment.is_free`.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        t: Heading, radians.
        table: The first of `CollisionChecker.arrays`.
        bound: The second.
        forbidden: The third.
    """
    value, away = around(x, y, table, bound)
    if not (value > -math.inf and math.isfinite(t)) or is_forbidden(x, y, table, forbidden):
        return False
    # All points within a lattice point's clearance lie on the same side of the walls.
    if abs(value) > away:
        if value < 0.0:
            return False
    elif not in_triangles(x, y, table):
        return False
    outer = table[OUTER]
    if value - away >= outer:
        return True
    gap = nearest_gap(x, y, outer * (1.0 + 1e-6) + 1e-9, table)
    if gap >= max(outer - ROUNDING, ROUNDING):
        return True
    if table[CORNERS] == 0.0 or table[TURNS] != 0.0 or gap < table[INNER]:
        return False
    return moved_clear(x, y, x, y, t, ROUNDING, table, bound)


@kernel
def _piece_free(x, y, ux, uy, curvature, length, heading, turn, table, bound, forbidden):
    """Return whether a line or an arc is free; see `polygon_clear` for the arguments."""
    outer = max(table[OUTER] - ROUNDING, ROUNDING)
    clear, gone = clear_along(x, y, ux, uy, curvature, length, outer, table, bound)
    if not clear:
        if table[CORNERS] == 0.0:
            return False
        inner = max(table[INNER] - ROUNDING, ROUNDING)
        clear, _ = clear_along(x, y, ux, uy, curvature, length, inner, table, bound)
        share = gone / length if length > 0.0 else 0.0
        if not clear or not polygon_clear(
            x, y, ux, uy, curvature, length, heading, turn, share, ROUNDING, table, bound
        ):
            return False
    return forbidden.size == 0 or not enters(x, y, ux, uy, curvature, length, table, forbidden)


@kernel
def line_free(x0, y0, x1, y1, table, bound, forbidden):
    """Return `motion_free` of a disc on a line, much faster than the check for polygons."""
    dx, dy = x1 - x0, y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    ux, uy = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)
    reach = max(table[OUTER] - ROUNDING, ROUNDING)
    clear, _ = clear_along(x0, y0, ux, uy, 0.0, length, reach, table, bound)
    return clear and (
        forbidden.size == 0 or not enters(x0, y0, ux, uy, 0.0, length, table, forbidden)
    )


@kernel
def motion_free(kind, radius, x0, y0, t0, x1, y1, t1, table, bound, forbidden):
    """Return whether a motion from a free pose meets no wall and no forbidden cell.

    Args:
        kind: Kind of motion, a code of `ambinav.geometry.motion.curves`.
        radius: Smallest turning radius in metres, of the kinds that have one; None for others, see
            `Steering.kernel_radius`.
        x0: Start, metres, map frame; it is assumed to be free.
        y0: The same.
        t0: Its heading, radians.
        x1: End; whether it is free is found out.
        y1: The same.
        t1: Its heading, radians.
        table: The first of `CollisionChecker.arrays`.
        bound: The second.
        forbidden: The third.
    """
    if kind in (FACING, STRAIGHT):
        dx, dy = x1 - x0, y1 - y0
        length = math.sqrt(dx * dx + dy * dy)
        ux, uy = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)
        heading, turn = t0, 0.0
        if kind == STRAIGHT:
            turn = (t1 - t0 + math.pi) % (2.0 * math.pi) - math.pi
        elif table[CORNERS] != 0.0 and length > 0.0:
            heading = math.atan2(dy, dx)
        if not _piece_free(x0, y0, ux, uy, 0.0, length, heading, turn, table, bound, forbidden):
            return False
        if table[TURNS] == 0.0:
            return True
        reach = max(table[OUTER] - ROUNDING, ROUNDING)
        clear, _ = clear_along(x1, y1, 1.0, 0.0, 0.0, 0.0, reach, table, bound)
        return clear
    if radius is not None:
        pieces = curve_pieces(kind, radius, x0, y0, t0, x1, y1, t1)
        x, y, t = x0, y0, t0
        for k in range(5):
            signed, curvature = pieces[k], pieces[k + 5]
            if signed == 0.0:
                continue
            # In reverse the robot travels in the other direction, and what was left is right.
            sign = 1.0 if signed > 0.0 else -1.0
            ux, uy, bend = sign * math.cos(t), sign * math.sin(t), sign * curvature
            length, turn = sign * signed, signed * curvature
            if not _piece_free(x, y, ux, uy, bend, length, t, turn, table, bound, forbidden):
                return False
            x, y = place(x, y, ux, uy, bend, length)
            t += turn
        return True
    # A curve of radius 0 is no curve.
    return False


@kernel
def poses_free(low, high, poses, table, bound, forbidden, out):
    """Write `pose_free` of some rows of poses, shape (N, 3), to out, bool, shape (N,)."""
    for i in range(low, high):
        out[i] = pose_free(poses[i, 0], poses[i, 1], poses[i, 2], table, bound, forbidden)


@kernel
def motions_free(low, high, kind, radius, a, b, table, bound, forbidden, out):
    """Write `motion_free` between some rows of a and b, (N, 3), to out, bool, shape (N,)."""
    for i in range(low, high):
        out[i] = motion_free(
            kind, radius, a[i, 0], a[i, 1], a[i, 2], b[i, 0], b[i, 1], b[i, 2],
            table, bound, forbidden,
        )  # fmt: skip
