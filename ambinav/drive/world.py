"""True motion of the simulated robot: it moves as commanded, until it collides."""

from __future__ import annotations

import math

from ambinav.drive.follower import ARRIVED, limited, pursue
from ambinav.drive.noise import sample_odometry
from ambinav.geometry.collision.disc_sweep import clear_along
from ambinav.geometry.footprint import ROUNDING
from ambinav.localization.odometry import wrapped
from ambinav.runtime.kernels import kernel

# Outcomes of a run.
DRIVING, REACHED, COLLIDED, TIMED_OUT = 0, 1, 2, 3
OUTCOMES = ("driving", "reached", "collided", "timed out")
"""Outcome of a run, by code: `reached` is what the robot believes."""

# A step counts as straight, for what it may meet, that strays from its chord by no more than this
# in metres, or is shorter than that: the circles of almost straight arcs have no usable centre.
STRAY = 1e-7
SHORT = 1e-4
BISECTIONS = 40


@kernel
def unicycle(x, y, t, speed, rate, dt):
    """Return the pose after driving with constant speed and turn rate: an exact arc."""
    half = 0.5 * rate * dt
    # sin(half) / half, which rounding spoils near 0.
    chord = speed * dt * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
    return x + chord * math.cos(t + half), y + chord * math.sin(t + half), wrapped(t + 2.0 * half)


@kernel
def moved(x, y, t, speed, rate, dt, reach, table, bound):
    """Return the pose after a time step, or where the disc first touches a wall.

    Args:
        x: Metres, map frame; the disc is free there.
        y: The same.
        t: Heading, radians.
        speed: Metres per second, negative backwards.
        rate: Radians per second.
        dt: Seconds.
        reach: Radius of the disc, metres.
        table: The first of `CollisionChecker.arrays`.
        bound: The second.

    Returns:
        x, y, heading, and whether the disc touches a wall there.
    """
    length, ux, uy, bend = path(t, speed, rate, dt)
    share = free_share(x, y, ux, uy, bend, length, reach, table, bound)
    x, y, t = unicycle(x, y, t, speed, rate, share * dt)
    return x, y, t, share < 1.0


@kernel
def path(t, speed, rate, dt):
    """Return length (metres), direction of travel (x, y), curvature (1/m) of a motion in `dt`.

    A motion counts as straight that strays from its chord by less than rounding.
    """
    length = abs(speed) * dt
    sign = 1.0 if speed > 0.0 else -1.0
    if length < SHORT or abs(rate) * dt * length < 8.0 * STRAY:
        middle = t + 0.5 * rate * dt
        return length, sign * math.cos(middle), sign * math.sin(middle), 0.0
    return length, sign * math.cos(t), sign * math.sin(t), rate / abs(speed)


@kernel
def free_share(x, y, ux, uy, bend, length, reach, table, bound):
    """Return the share of a path (see `path`) that a disc travels before it touches a wall.

    1: the whole path.

    Arguments x, y, reach, table and bound as in `moved`.
    """
    if length == 0.0:
        return 1.0
    reach = max(reach - ROUNDING, ROUNDING)
    clear, _ = clear_along(x, y, ux, uy, bend, length, reach, table, bound)
    if clear:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        share = 0.5 * (low + high)
        clear_part, _ = clear_along(x, y, ux, uy, bend, share * length, reach, table, bound)
        low, high = (share, high) if clear_part else (low, share)
    return low


@kernel
def tick(
    truth, odometry, belief, speeds, piece, stage, outcome, course, goal, turns, p, limits, dt,
    noise, states, reach, table, bound,
):  # fmt: skip
    """Advance every run that still drives by one time step, in place.

    Args:
        truth: True poses, shape (R, 3), metres and radians, map frame.
        odometry: Odometry poses, shape (R, 3), odometry frame.
        belief: Poses by which the robots steer, shape (R, 3), map frame; left as they are.
        speeds: Speed (m/s) and turn rate (rad/s), shape (R, 2).
        piece: See `pursue`, int64, shape (R,).
        stage: The same.
        outcome: DRIVING, REACHED or COLLIDED, int64, shape (R,).
        course: `Course.arrays`.
        goal: `Course.goal`.
        turns: `Course.turns`.
        p: `FollowerParameters.packed`.
        limits: `Robot.limits`.
        dt: Seconds.
        noise: `OdometryNoise.packed`.
        states: States of the random numbers of odometry, shape (R, 4).
        reach: Radius of the robot, metres.
        table: The first of `CollisionChecker.arrays`.
        bound: The second.
    """
    for r in range(len(truth)):
        if outcome[r] != DRIVING:
            continue
        bx, by, bt = belief[r]
        want_speed, want_rate, piece[r], stage[r] = pursue(
            bx, by, bt, speeds[r, 0], speeds[r, 1], piece[r], stage[r], course, goal, turns, p,
            limits, dt,
        )  # fmt: skip
        if stage[r] == ARRIVED:
            outcome[r] = REACHED
            continue
        _step_run(
            r, want_speed, want_rate, truth, odometry, speeds, outcome, limits, dt, noise, states,
            reach, table, bound,
        )  # fmt: skip


@kernel
def tick_commanded(
    truth, odometry, belief, speeds, outcome, want, goal, near, limits, dt, noise, states, reach,
    table, bound,
):  # fmt: skip
    """Advance robots whose speeds are commanded; see `tick`.

    Args:
        truth: See `tick`, as all that is not listed here.
        odometry: See there.
        belief: See there.
        speeds: See there.
        outcome: See there.
        want: Speed (m/s) and turn rate (rad/s) commanded of each, shape (R, 2).
        goal: See there.
        near: A robot that believes it is within this distance of the goal stops there, metres.
        limits: See there.
        dt: See there.
        noise: See there.
        states: See there.
        reach: See there.
        table: See there.
        bound: See there.
    """
    for r in range(len(truth)):
        if outcome[r] != DRIVING:
            continue
        if math.hypot(goal[0] - belief[r, 0], goal[1] - belief[r, 1]) <= near:
            outcome[r] = REACHED
            continue
        _step_run(
            r, want[r, 0], want[r, 1], truth, odometry, speeds, outcome, limits, dt, noise, states,
            reach, table, bound,
        )  # fmt: skip


@kernel(inline="always")
def _step_run(
    r, want_speed, want_rate, truth, odometry, speeds, outcome, limits, dt, noise, states, reach,
    table, bound,
):  # fmt: skip
    """Move run r by one time step, and sample its odometry."""
    speed, rate = limited(speeds[r, 0], speeds[r, 1], want_speed, want_rate, limits, dt)
    speeds[r, 0], speeds[r, 1] = speed, rate
    x0, y0, t0 = truth[r]
    x1, y1, t1, met = moved(x0, y0, t0, speed, rate, dt, reach, table, bound)
    truth[r, 0], truth[r, 1], truth[r, 2] = x1, y1, t1
    if met:
        outcome[r] = COLLIDED
    ox, oy, ot = odometry[r]
    odometry[r, 0], odometry[r, 1], odometry[r, 2] = sample_odometry(
        ox, oy, ot, x0, y0, t0, x1, y1, t1, noise, states[r]
    )


@kernel
def report_all(odometry, before, after, noise, states):
    """Apply `sample_odometry` to each run, in place: poses of shape (R, 3)."""
    for r in range(len(odometry)):
        ox, oy, ot = odometry[r]
        x0, y0, t0 = before[r]
        x1, y1, t1 = after[r]
        odometry[r, 0], odometry[r, 1], odometry[r, 2] = sample_odometry(
            ox, oy, ot, x0, y0, t0, x1, y1, t1, noise, states[r]
        )
