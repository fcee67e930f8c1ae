"""Robot motion between poses: straight, or along curves with a minimum turning radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_array, as_positive
from ambinav.geometry.motion.curves import DUBINS as DUBINS
from ambinav.geometry.motion.curves import FACING as FACING
from ambinav.geometry.motion.curves import REEDS_SHEPP as REEDS_SHEPP
from ambinav.geometry.motion.curves import STRAIGHT as STRAIGHT
from ambinav.geometry.motion.curves import advance, curve_pieces, motion_length
from ambinav.runtime.array_types import Floats, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

MOST_POINTS: Final = 50_000_000
"""Points that a route is sampled at, at the most."""
TOO_MANY: Final = 1e12
"""Counted as so many, more do not overflow."""
POSES: Final = "poses x, y, theta in the shape (N, 3)"
"""What messages ask for where poses are wanted."""
KINDS = {"r2": FACING, "se2": STRAIGHT, "dubins": DUBINS, "reeds-shepp": REEDS_SHEPP}
"""Names of the spaces, and the codes that kernels take for their kinds of motion."""


@dataclass(frozen=True)
class Steering:
    """State space, and the motion between two of its poses.

    - `r2`: a straight line; the robot looks along it.
    - `se2`: a straight line; the heading turns evenly, the short way round.
    - `dubins`: the shortest curve forwards (Dubins 1957).
    - `reeds-shepp`: the shortest curve forwards and backwards (Reeds and Shepp 1990).

    Attributes:
        space: One of the four names.
        radius: Smallest turning radius of the two kinds of curve, metres; 0 for the others.

    Raises:
        InputError: unknown space, or a radius that does not suit it.
    """

    space: str = "r2"
    radius: float = 0.0

    def __post_init__(self) -> None:
        if self.space not in KINDS:
            raise InputError(f"space is {self.space!r}; choose from {', '.join(KINDS)}.")
        if self.turns and not (math.isfinite(self.radius) and self.radius > 0.0):
            raise InputError(
                f"radius is {self.radius:g} m; {self.space} needs a turning radius above 0."
            )
        if not self.turns and self.radius != 0.0:
            raise InputError(
                f"radius is {self.radius:g} m; {self.space} turns on the spot: leave it at 0, or "
                "choose dubins or reeds-shepp."
            )

    @property
    def kind(self) -> int:
        """Code of the kind of motion: FACING, STRAIGHT, DUBINS or REEDS_SHEPP."""
        return KINDS[self.space]

    @property
    def turns(self) -> bool:
        """True if motions are curves with a minimum turning radius."""
        return self.space in ("dubins", "reeds-shepp")

    @property
    def kernel_radius(self) -> float | None:
        """`radius` as kernels take it, None for straight motions.

        With None numba leaves out the curves, which take as long to compile as all the rest.
        """
        return float(self.radius) if self.turns else None

    def lengths(self, a: ArrayLike, b: ArrayLike) -> Floats:
        """Compute the length of each motion from a to b, metres, (N,); reverse counts too.

        Args:
            a: Poses x, y, theta, shape (N, 3), metres and radians.
            b: Poses, shape (N, 3).

        Raises:
            InputError: the poses are not of that shape or not finite, or not equally many.
        """
        a, b = checked_poses(a, "a"), checked_poses(b, "b")
        if len(a) != len(b):
            raise InputError(f"a has {len(a)} poses and b {len(b)}; give as many of each.")
        out = np.empty(len(a))
        least = 64 if self.turns else 8192
        run_rows(_lengths, len(a), self.kind, self.kernel_radius, a, b, out, least=least)
        return out

    def dense(self, poses: ArrayLike, step: float) -> tuple[Floats, Ints32, Floats]:
        """Sample points along a whole route, at most `step` apart.

        Both ends of every motion and of every piece of a curve are among them, so a vertex is
        listed for both motions that meet there: in r2 the heading jumps between the two.

        Args:
            poses: The route, shape (N, 3).
            step: Metres.

        Returns:
            Poses, shape (M, 3); of each the motion that it lies on, int32, shape (M,); and its
            distance along the route from the start, metres, shape (M,). One pose alone is
            returned as it is, on motion 0.

        Raises:
            InputError: the step is not a positive number, or much too small for the route, or the
                poses are not usable.
        """
        route = checked_poses(poses, "poses")
        step = as_positive(step, "step", "metres")
        if len(route) < 2:
            return route, np.zeros(len(route), dtype=np.int32), np.zeros(len(route))
        motions = self.kind, self.kernel_radius, route, float(step)
        count = _trace_all(*motions, *_nothing())
        if count > MOST_POINTS:
            length = float(self.lengths(route[:-1], route[1:]).sum())
            raise InputError(
                f"step is {step:g} m on a route of {length:.3g} m; give at least "
                f"{length / MOST_POINTS:.2g} m, or correct the route or its turning radius."
            )
        out, leg, along = np.empty((count, 3)), np.empty(count, dtype=np.int32), np.empty(count)
        _trace_all(*motions, out, leg, along)
        return out, leg, along

    def oriented(self, poses: ArrayLike) -> Floats:
        """Return the route with headings that suit the space, shape (N, 3).

        In r2 they point along the travel, at the last pose as at the one before; where the route
        stays in one place, as at the next motion. There points, shape (N, 2), will do. In the other
        spaces they are left.

        Raises:
            InputError: see `checked_poses`.
        """
        array = as_array(poses, "poses", POSES)
        if self.kind == FACING and array.ndim == 2 and array.shape[1] == 2:
            array = np.column_stack([array, np.zeros(len(array))])
        route = checked_poses(array, "poses")
        if self.kind != FACING or len(route) < 2:
            return route
        step = np.diff(route[:, :2], axis=0)
        moving = np.flatnonzero(step.any(axis=1))
        if not len(moving):
            return route
        legs = np.searchsorted(moving, np.arange(len(route)))
        along = step[moving[np.minimum(legs, len(moving) - 1)]]
        route[:, 2] = np.arctan2(along[:, 1], along[:, 0])
        return route


def checked_poses(poses: ArrayLike, name: str) -> Floats:
    """Return a checked copy of poses as float64, shape (N, 3), C order.

    Raises:
        InputError: they are not of that shape, or not finite.
    """
    out = as_array(poses, name, POSES)
    if out.ndim != 2 or out.shape[1] != 3:
        raise InputError(f"{name} has the shape {out.shape}; give {POSES}.")
    if not np.isfinite(out).all():
        row = int(np.flatnonzero(~np.isfinite(out).all(axis=1))[0])
        raise InputError(
            f"{name}[{row}] is {out[row].tolist()}, which is not finite; give metres and radians."
        )
    return out


def _nothing() -> tuple[Floats, Ints32, Floats]:
    """Return empty arrays, with which `_trace_all` only counts."""
    return np.empty((0, 3)), np.empty(0, dtype=np.int32), np.empty(0)


@kernel
def _lengths(low, high, kind, radius, a, b, out):
    for i in range(low, high):
        out[i] = motion_length(
            kind, radius, a[i, 0], a[i, 1], a[i, 2], b[i, 0], b[i, 1], b[i, 2]
        )  # fmt: skip


@kernel
def _trace_all(kind, radius, route, step, out, leg, along):
    """Write the dense points of a route; with empty arrays, only count them."""
    count, gone = 0, 0.0
    for i in range(len(route) - 1):
        first = count
        x0, y0, t0 = route[i]
        x1, y1, t1 = route[i + 1]
        if kind in (FACING, STRAIGHT):
            count = _trace_line(kind, x0, y0, t0, x1, y1, t1, step, gone, out, along, count)
            gone += math.hypot(x1 - x0, y1 - y0)
        elif radius is not None:
            pieces = curve_pieces(kind, radius, x0, y0, t0, x1, y1, t1)
            count = _trace_pieces(pieces, x0, y0, t0, step, gone, out, along, count)
            for k in range(5):
                gone += abs(pieces[k])
        leg[first:count] = i
    return count


@kernel
def _trace_line(kind, x0, y0, t0, x1, y1, t1, step, gone, out, along, count):
    """Write points of a straight motion, `gone` metres after the start; return the new count."""
    turn = 0.0
    if kind == STRAIGHT:
        turn = (t1 - t0 + math.pi) % (2.0 * math.pi) - math.pi
    elif x1 != x0 or y1 != y0:
        t0 = math.atan2(y1 - y0, x1 - x0)
    length = math.hypot(x1 - x0, y1 - y0)
    parts = max(int(math.ceil(min(length / step, TOO_MANY))), 1)
    if along.size:
        for j in range(parts + 1):
            share, last = j / parts, j == parts
            out[count + j, 0] = x1 if last else x0 + share * (x1 - x0)
            out[count + j, 1] = y1 if last else y0 + share * (y1 - y0)
            out[count + j, 2] = t0 + share * turn
            along[count + j] = gone + share * length
    return count + parts + 1


@kernel
def _trace_pieces(pieces, x, y, t, step, gone, out, along, count):
    """Write points of a curve; for a curve of length 0, its two ends."""
    points = 1
    if along.size:
        out[count, 0], out[count, 1], out[count, 2], along[count] = x, y, t, gone
    for k in range(5):
        length, curvature = pieces[k], pieces[k + 5]
        parts = int(math.ceil(min(abs(length) / step, TOO_MANY)))
        if along.size:
            for j in range(parts):
                share = (j + 1) / parts
                i = count + points + j
                out[i, 0], out[i, 1], out[i, 2] = advance(x, y, t, share * length, curvature)
                along[i] = gone + share * abs(length)
        points += parts
        gone += abs(length)
        x, y, t = advance(x, y, t, length, curvature)
    if points == 1:
        if along.size:
            last = count + 1
            out[last, 0], out[last, 1], out[last, 2], along[last] = x, y, t, gone
        points = 2
    return count + points
