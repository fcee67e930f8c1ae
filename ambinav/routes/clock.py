"""Speed profile of a route: when a robot is where, if it drives as fast as its limits allow.

At points of the path the speed is bounded by what holds there (curvature, stops, a bound of the
user), and from point to point by the acceleration. The largest speeds under both come from one pass
forwards and one backwards (Bobrow, Dubowsky & Gibson 1985, "Time-optimal control of robotic
manipulators along specified paths"; Consolini, Locatelli, Minari & Piazzi 2017, "An optimal
complexity algorithm for minimum-time velocity planning"). Between two points the acceleration is
even, so that a ramp ends at a point: it takes up to 5 cm / speed longer than it could.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import Positive, as_array, check_fields, check_kind
from ambinav.geometry.frames import wrap_angles
from ambinav.geometry.motion.steering import Steering, checked_poses
from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav.runtime.errors import InputError

SPACING: Final = 0.05
"""Distance between the points of a course, metres: the resolution of nav2's global plans."""
TURN_ACCELERATION: Final = 3.2
"""Default angular acceleration, radians per second squared; see `drive.robot.Robot`."""
LONGEST: Final = 1e9
"""Longest drive, seconds: 31 years; stamps of files count in whole nanoseconds."""

# Headings (radians) and points (metres) that differ by no more than this are the same.
SAME = 1e-9
# Where a straight-line route bends by less than this the robot turns while it drives, over the
# pieces before and after the bend; where by more it stops to turn, as the follower does (its
# `rotate_to_heading_min_angle`).
SHARP = np.pi / 4.0


@dataclass(frozen=True, kw_only=True)
class SpeedLimits:
    """Limits of a robot's speed; the defaults are those of nav2's example for a TurtleBot.

    Attributes:
        max_speed: Maximum speed, metres per second, forwards and backwards.
        acceleration: Maximum acceleration and deceleration, metres per second squared.
        max_turn_rate: Maximum turn rate, radians per second.
        turn_acceleration: Maximum angular acceleration in turns on the spot, radians per second
            squared; None: the turn rate is reached at once.
        lateral_acceleration: Maximum acceleration across the path, speed^2 times curvature, metres
            per second squared; None: no limit.

    Raises:
        InputError: a number is not finite or not above 0.
    """

    max_speed: Positive = 0.5
    acceleration: Positive = 2.5
    max_turn_rate: Positive = 2.0
    turn_acceleration: Positive | None = TURN_ACCELERATION
    lateral_acceleration: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self, "speed limits")


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Poses over time along a route, at M points at most 5 cm apart.

    Between two points the acceleration is even; a turn on the spot is a piece of no length.

    Attributes:
        poses: x, y (metres) and heading (radians, without jumps of 2 pi), map frame, shape (M, 3).
        distance: Metres along the route, shape (M,).
        stamps: Seconds from the start, shape (M,).
        speeds: Metres per second, also backwards at least 0, shape (M,).
        vertices: Index of each pose of the route among the points, shape (N,): where the robot has
            the pose's heading, after any turn on the spot.
    """

    poses: Floats
    distance: Floats
    stamps: Floats
    speeds: Floats
    vertices: Indices

    @property
    def duration(self) -> float:
        """Seconds from start to goal."""
        return float(self.stamps[-1])

    def at(self, times: Floats) -> Floats:
        """Return poses at times, linear between the points, headings in -pi .. pi.

        Args:
            times: Seconds from the start, shape (T,); before it and after the end the robot stands.

        Returns:
            Shape (T, 3).

        Raises:
            InputError: the times are no numbers, or of another shape.
        """
        times = np.atleast_1d(as_array(times, "times", "seconds, shape (T,)"))
        if times.ndim > 1:
            raise InputError(f"times has the shape {times.shape}; give seconds, shape (T,).")
        # Where two points share a time the later one stands for it.
        keep = np.append(np.diff(self.stamps) > 0.0, True)
        columns = [np.interp(times, self.stamps[keep], row) for row in self.poses[keep].T]
        out = np.column_stack(columns)
        out[:, 2] = wrap_angles(out[:, 2])
        return out

    def integral(self, power: Callable[[Floats, Floats], ArrayLike]) -> float:
        """Integrate a function of the motion over time, such as power (W) to energy (J).

        By Simpson's rule from point to point, exact where it is a cubic of the speed.

        Args:
            power: From speeds (m/s) and accelerations along the path (m/s^2), arrays of one shape,
                to values of that shape, or one for all. Turns on the spot have speed 0.

        Raises:
            InputError: the values have another shape, or are not finite.
        """
        seconds, speed = np.diff(self.stamps), self.speeds
        first, last = speed[:-1], speed[1:]
        rate = np.divide(last - first, seconds, out=np.zeros_like(seconds), where=seconds > 0.0)
        speeds = np.stack([first, 0.5 * (first + last), last])
        values = np.asarray(power(speeds, np.broadcast_to(rate, speeds.shape)), dtype=np.float64)
        if values.shape not in ((), speeds.shape) or not np.isfinite(values).all():
            raise InputError(
                f"power returned values of the shape {values.shape}, or some that are not finite; "
                "return a finite number for each speed."
            )
        start, middle, end = np.broadcast_to(values, speeds.shape)
        return float((seconds * (start + 4.0 * middle + end)).sum() / 6.0)


def speed_profile(
    poses: ArrayLike,
    steering: Steering,
    limits: SpeedLimits | None = None,
    *,
    stops: Sequence[int] = (),
    bound: ArrayLike | None = None,
) -> SpeedProfile:
    """Compute the fastest drive along a route under limits, from standstill to standstill.

    The robot stops for turns on the spot (where the route says so, and in "r2" at corners sharper
    than 45 degrees) and at cusps. In bends its turn rate bounds the speed. In "se2" it turns while
    it drives, and corners of less than 90 degrees do not slow it, but by `lateral_acceleration`.

    Args:
        poses: The route, shape (N, 3): metres, radians, map frame.
        steering: The kind of motion.
        limits: Limits of the robot; None: the default ones.
        stops: Indices of poses at which it stops; a turn to the next heading is then on the spot.
        bound: Rows of metres along the route and the speed allowed there, m/s, shape (K, 2), by
            rising metres; linear in between, the first and last value beyond.

    Raises:
        InputError: the poses or the bound are not usable, there are fewer than two poses, or the
            drive takes more than `LONGEST` seconds.
    """
    limits = SpeedLimits() if limits is None else limits
    check_kind(limits, SpeedLimits, "limits")
    check_kind(steering, Steering, "steering")
    route = steering.oriented(checked_poses(poses, "poses"))
    if len(route) < 2:
        raise InputError(f"poses has {len(route)} of them; a route needs a start and a goal.")
    dense, leg, along = steering.dense(route, SPACING)
    heading = np.unwrap(dense[:, 2])
    # A vertex stands there for both motions that meet in it; where the robot does not turn, once.
    here, change = np.diff(along) <= SAME, np.diff(heading)
    drop = here & (np.abs(change) <= SAME)
    first = np.searchsorted(leg, np.arange(len(route) - 1))
    if not all(isinstance(k, int | np.integer) and 0 <= k <= len(first) for k in stops):
        raise InputError(
            f"stops is {reprlib.repr(list(stops))}; the route has the poses 0 to {len(first)}."
        )
    halts = first[[k for k in stops if 0 < k < len(first)]]
    if steering.space == "r2":
        bend = here & (np.abs(change) < SHARP)
        bend[halts - 1] = False
        heading[:-1][bend] += 0.5 * change[bend]
        drop |= bend
    keep = np.concatenate([[True], ~drop])
    # Of two points at one position keep the first, with the heading between theirs.
    points, along = np.column_stack([dense[:, :2], heading])[keep], along[keep]
    kept_index = np.cumsum(keep) - 1
    vertices = kept_index[np.append(first, len(keep) - 1)]
    halt = np.zeros(len(points), dtype=np.bool_)
    halt[[0, -1]] = halt[kept_index[halts - 1]] = True
    on_spot = np.flatnonzero(np.diff(along) <= SAME)
    halt[on_spot] = halt[on_spot + 1] = True
    halt[1:-1] |= _reverses(points)
    # From stop to stop the robot gains speed on the first half, and brakes on the other.
    hop = np.flatnonzero(halt[:-1] & halt[1:] & (np.diff(along) > SAME))
    points, along = (
        np.insert(a, hop + 1, 0.5 * (a[hop] + a[hop + 1]), axis=0) for a in (points, along)
    )
    halt, vertices = np.insert(halt, hop + 1, False), vertices + np.searchsorted(hop, vertices)
    lengths, turn = np.diff(along), np.abs(np.diff(points[:, 2]))
    # In a bend the speed is bounded by turn rate / curvature at both of a piece's ends.
    moving = lengths > SAME
    bends = moving & (limits.max_turn_rate * lengths < limits.max_speed * turn)
    allowed = np.full(len(lengths) + 2, limits.max_speed)
    rates = limits.max_turn_rate * lengths[bends] / turn[bends]
    allowed[1:-1][bends] = np.minimum(rates, limits.max_speed)
    fastest = np.minimum(allowed[:-1], allowed[1:])
    if limits.lateral_acceleration is not None:
        with np.errstate(divide="ignore"):
            across = np.sqrt(limits.lateral_acceleration / _curvature(points, lengths, steering))
        fastest[1:-1] = np.minimum(fastest[1:-1], across)
    if bound is not None:
        fastest = np.minimum(fastest, np.interp(along, *_checked_bound(bound).T))
    fastest[halt] = 0.0
    speed = _reachable(fastest, lengths, limits.acceleration)
    with np.errstate(over="ignore", divide="ignore"):  # said below
        seconds = _turning(turn, limits)
        seconds[moving] = 2.0 * lengths[moving] / (speed[:-1] + speed[1:])[moving]
    stamps = np.concatenate([[0.0], np.cumsum(seconds)])
    if not stamps[-1] <= LONGEST:
        raise InputError(
            f"the drive takes {stamps[-1]:g} s, more than {LONGEST:g}; give higher limits of speed."
        )
    return SpeedProfile(points, along, stamps, speed, vertices)


def _turning(angle: Floats, limits: SpeedLimits) -> Floats:
    """Return the seconds of turns on the spot by angles, from standstill to standstill."""
    rate, gain = limits.max_turn_rate, limits.turn_acceleration
    if gain is None:
        return angle / rate
    reached = angle * gain > rate * rate
    return np.where(reached, angle / rate + rate / gain, 2.0 * np.sqrt(angle / gain))


def _reverses(points: Floats) -> Bools:
    """Return which inner points are cusps, where the path reverses, shape (M - 2,)."""
    steps = np.diff(points[:, :2], axis=0)
    return np.asarray((steps[:-1] * steps[1:]).sum(axis=1) < 0.0)


def _curvature(points: Floats, lengths: Floats, steering: Steering) -> Floats:
    """Return the change of the direction of travel per metre at inner points, shape (M - 2,)."""
    if steering.turns:
        # Where arcs meet, the larger one: their mean vanishes between a left and a right turn.
        turn = np.abs(np.diff(points[:, 2]))
        piece = np.divide(turn, lengths, out=np.zeros_like(turn), where=lengths > SAME)
        return np.asarray(np.maximum(piece[:-1], piece[1:]))
    steps = np.diff(points[:, :2], axis=0)
    change = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    change = np.abs(wrap_angles(change))
    metres = 0.5 * (lengths[:-1] + lengths[1:])
    return np.divide(change, metres, out=np.zeros_like(change), where=metres > 0.0)


def _reachable(fastest: Floats, lengths: Floats, acceleration: float) -> Floats:
    """Return the speed at each point: at most `fastest`, within the acceleration."""
    speed = fastest.tolist()
    gain = (2.0 * acceleration * lengths).tolist()
    for i in range(len(lengths)):
        speed[i + 1] = min(speed[i + 1], (speed[i] * speed[i] + gain[i]) ** 0.5)
    for i in range(len(lengths) - 1, -1, -1):
        speed[i] = min(speed[i], (speed[i + 1] * speed[i + 1] + gain[i]) ** 0.5)
    return np.array(speed)


def _checked_bound(bound: ArrayLike) -> Floats:
    rows = as_array(bound, "bound", "rows of metres along the route and m/s")
    if rows.ndim != 2 or rows.shape[1] != 2 or not len(rows):
        raise InputError(
            f"bound has the shape {rows.shape}; give rows of metres along the route and m/s."
        )
    if not np.isfinite(rows).all() or (np.diff(rows[:, 0]) < 0.0).any() or rows[:, 1].min() <= 0.0:
        raise InputError(
            "bound has metres that fall, or a speed that is not above 0; give finite rows by "
            "rising metres, with speeds above 0 m/s."
        )
    return rows
