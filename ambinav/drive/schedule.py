"""Open-loop schedule of a route: the robot's pose over time if it stays on the route."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.course import SPACING
from ambinav.drive.robot import Robot
from ambinav.geometry.motion.steering import Steering, checked_poses
from ambinav.runtime.errors import InputError

# Headings that differ by less than this are the same, radians.
SAME = 1e-9
# Where a straight-line route bends by less than this the robot turns while it drives, over the
# pieces before and after the bend; where by more it stops to turn, as the follower does (its
# `rotate_to_heading_min_angle`).
SHARP = math.pi / 4.0

Floats = NDArray[np.float64]


def scheduled(
    poses: NDArray[np.float64],
    steering: Steering,
    robot: Robot,
    desired: float,
    dt: float,
) -> Floats:
    """Return poses at times 0, dt, 2 dt ... of a robot that drives exactly along a route.

    It gains speed and brakes at the robot's acceleration, stops for turns on the spot (where the
    route says so, and at corners sharper than 45 degrees), which it makes at its turn rate at
    once, and is no faster in bends than its turn rate allows. Between two points of the route,
    5 cm apart, its speed is even.

    Args:
        poses: The route, shape (N, 3).
        steering: The kind of motion.
        robot: The robot.
        desired: Speed on a free straight path, metres per second.
        dt: Seconds.

    Returns:
        Shape (T, 3); the last one is the goal.

    Raises:
        InputError: the poses are not usable.
    """
    route = steering.oriented(checked_poses(poses, "poses"))
    if len(route) < 2:
        raise InputError(f"poses has {len(route)} of them; a route needs a start and a goal.")
    dense, _, along = steering.dense(route, SPACING)
    heading = np.unwrap(dense[:, 2])
    # A vertex stands there for both motions that meet in it; where the robot does not turn, once.
    here, change = np.diff(along) <= 0.0, np.diff(heading)
    drop = here & (np.abs(change) <= SAME)
    if steering.space == "r2":
        bend = here & (np.abs(change) < SHARP)
        heading[:-1][bend] += 0.5 * change[bend]
        drop |= bend
    keep = np.concatenate([[True], ~drop])
    # Of two points at one position keep the first, with the heading between theirs.
    dense, along, heading = dense[keep], along[keep], heading[keep]
    lengths, turn = np.diff(along), np.abs(np.diff(heading))
    fastest = np.full(len(dense), min(desired, robot.max_speed))
    fastest[[0, -1]] = 0.0
    on_spot = lengths <= 0.0
    fastest[:-1][on_spot] = 0.0
    fastest[1:][on_spot] = 0.0
    fastest[1:-1][_reverses(dense)] = 0.0
    # In a bend the speed is bounded by turn rate / curvature at both of a piece's ends.
    bends = (lengths > 0.0) & (turn > 0.0)
    bound = np.full(len(lengths), np.inf)
    bound[bends] = robot.max_turn_rate * lengths[bends] / turn[bends]
    fastest[:-1] = np.minimum(fastest[:-1], bound)
    fastest[1:] = np.minimum(fastest[1:], bound)
    speed = _reachable(fastest, lengths, robot.acceleration)
    seconds = turn / robot.max_turn_rate
    moving = lengths > 0.0
    both = speed[:-1] + speed[1:]
    hop = moving & (both <= 0.0)
    ride = moving & ~hop
    seconds[ride] = 2.0 * lengths[ride] / both[ride]
    # From stop to stop: half of it gaining speed, half of it braking.
    seconds[hop] = 2.0 * np.sqrt(lengths[hop] / robot.acceleration)
    when = np.concatenate([[0.0], np.cumsum(seconds)])
    count = int(np.ceil(when[-1] / dt - 1e-9)) + 1
    times = np.minimum(dt * np.arange(count), when[-1])
    # Where two points share a time the later one stands for it.
    keep = np.append(np.diff(when) > 0.0, True)
    columns = (dense[keep, 0], dense[keep, 1], heading[keep])
    out = np.column_stack([np.interp(times, when[keep], column) for column in columns])
    out[:, 2] = (out[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return out


def _reverses(points: Floats) -> NDArray[np.bool_]:
    """Return which inner points are cusps, where the path reverses, shape (M - 2,)."""
    steps = np.diff(points[:, :2], axis=0)
    return np.asarray((steps[:-1] * steps[1:]).sum(axis=1) < 0.0)


def _reachable(fastest: Floats, lengths: Floats, acceleration: float) -> Floats:
    """Return the speed at each point: at most `fastest`, within the acceleration."""
    speed = fastest.tolist()
    gain = (2.0 * acceleration * lengths).tolist()
    for i in range(len(lengths)):
        speed[i + 1] = min(speed[i + 1], (speed[i] * speed[i] + gain[i]) ** 0.5)
    for i in range(len(lengths) - 1, -1, -1):
        speed[i] = min(speed[i], (speed[i + 1] * speed[i + 1] + gain[i]) ** 0.5)
    return np.array(speed)
