"""Regulated pure pursuit: the next command of a robot that follows a course.

Macenski, Singh, Martin, Gines, "Regulated pure pursuit for robot path tracking", Autonomous
Robots 47 (2023), section 3, with the names and defaults of its implementation in nav2. Not taken
over: slowing down near obstacles and stopping before a collision, which need a local costmap.
Added: the robot's limits (`limited`), which keep the command's curvature where they can.
"""

from __future__ import annotations

import math

from ambinav.geometry.motion.circles import wrap
from ambinav.runtime.kernels import kernel

# What a robot on its course is doing.
FOLLOWING, TURNING, ARRIVED = 0, 1, 2
# A carrot nearer than this, in metres squared, says nothing about the direction.
AT_CARROT = 1e-3
# A command slower than this, in metres per second, is one to stand or to turn on the spot.
STILL = 1e-6


@kernel
def _project(x, y, piece, points, along, end, reach):
    """Find the nearest point ahead on the present stretch: its piece, and its share of it."""
    best, at, share = math.inf, piece, 0.0
    i = piece
    while i < end[piece] and along[i] <= along[piece] + reach:
        ex, ey = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        wx, wy = x - points[i, 0], y - points[i, 1]
        s = min(max((wx * ex + wy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        away = (wx - s * ex) ** 2 + (wy - s * ey) ** 2
        if away < best:
            best, at, share = away, i, s
        i += 1
    return at, share


@kernel
def _carrot(x, y, piece, share, points, end, lookahead):
    """Find the first point ahead on the stretch that is `lookahead` metres away.

    If that point itself is farther away, that; if none is so far away, the end.
    """
    last = end[piece]
    px = points[piece, 0] + share * (points[piece + 1, 0] - points[piece, 0])
    py = points[piece, 1] + share * (points[piece + 1, 1] - points[piece, 1])
    for i in range(piece + 1, last + 1):
        wx, wy = px - x, py - y
        if wx * wx + wy * wy >= lookahead * lookahead:
            break
        qx, qy = points[i, 0], points[i, 1]
        if (qx - x) ** 2 + (qy - y) ** 2 >= lookahead * lookahead:
            # Where the piece leaves the circle: |w + s e| = lookahead, the larger s.
            ex, ey = qx - px, qy - py
            a, b = ex * ex + ey * ey, wx * ex + wy * ey
            c = wx * wx + wy * wy - lookahead * lookahead
            s = (math.sqrt(max(b * b - a * c, 0.0)) - b) / a
            return px + s * ex, py + s * ey
        px, py = qx, qy
    return px, py


@kernel
def _turn(angle, rate, p, limits, dt):
    """Return the turn rate for a turn on the spot by `angle`, so that it can stop in time."""
    change = limits[3] * dt
    want = math.copysign(min(p.rotate_to_heading_angular_vel, limits[1]), angle)
    want = min(max(want, rate - change), rate + change)
    most = math.sqrt(2.0 * limits[3] * abs(angle))
    return math.copysign(most, angle) if abs(want) > most else want


@kernel
def limited(speed, rate, want_speed, want_rate, limits, dt):
    """Return a robot's speeds one time step after a command.

    Limits of speed, turn rate and acceleration leave it on the commanded arc; that of turn
    acceleration need not.

    Args:
        speed: Now, metres per second.
        rate: Now, radians per second.
        want_speed: Commanded.
        want_rate: Commanded.
        limits: `Robot.limits`.
        dt: The time step, seconds.
    """
    most, fastest, acceleration, turn_acceleration = limits
    driving = abs(want_speed) > STILL
    curvature = want_rate / want_speed if driving else 0.0
    top = min(most, fastest / abs(curvature)) if curvature != 0.0 else most
    change = acceleration * dt
    speed = min(max(min(max(want_speed, -top), top), speed - change), speed + change)
    if driving:
        # While it gains or loses speed the robot stays on the arc.
        want_rate = speed * curvature
    want_rate = min(max(want_rate, -fastest), fastest)
    turn = turn_acceleration * dt
    return speed, min(max(want_rate, rate - turn), rate + turn)


@kernel
def pursue(x, y, t, speed, rate, piece, stage, course, goal, turns, p, limits, dt):
    """Compute the robot's next command.

    Args:
        x: Where the robot believes it is, metres, map frame.
        y: The same.
        t: Its heading, radians.
        speed: Present speed, metres per second.
        rate: Present turn rate, radians per second.
        piece: Piece of the course, on which it was last; 0 at the start.
        stage: FOLLOWING, TURNING or ARRIVED, as it was last.
        course: `Course.arrays`.
        goal: `Course.goal`.
        turns: `Course.turns`.
        p: `FollowerParameters.packed`.
        limits: `Robot.limits`.
        dt: The time step, seconds.

    Returns:
        Speed and turn rate that are wanted, the piece, the stage. A robot that has arrived is to
        stop.
    """
    points, along, directions, end = course
    if stage == ARRIVED:
        return 0.0, 0.0, piece, stage
    piece, share = _project(x, y, piece, points, along, end, p.max_robot_pose_search_dist)
    last = len(directions)
    left = along[end[piece]] - along[piece] - share * (along[piece + 1] - along[piece])
    if end[piece] < last and left <= p.inversion_xy_tolerance:
        piece, share = end[piece], 0.0
        left = along[end[piece]] - along[piece]
    gx, gy = goal[0] - x, goal[1] - y
    near = p.xy_goal_tolerance
    # A route may pass by its goal before its end: that does not count.
    at_end = end[piece] == last and left <= 2.0 * near
    if stage == FOLLOWING and at_end and gx * gx + gy * gy <= near * near:
        if not (turns and p.use_rotate_to_heading):
            return 0.0, 0.0, piece, ARRIVED
        stage = TURNING
    if stage == TURNING:
        angle = wrap(goal[2] - t)
        if abs(angle) <= p.yaw_goal_tolerance:
            return 0.0, 0.0, piece, ARRIVED
        return 0.0, _turn(angle, rate, p, limits, dt), piece, stage
    lookahead = p.lookahead_dist
    if p.use_velocity_scaled_lookahead_dist:
        lookahead = abs(speed) * p.lookahead_time
        lookahead = min(max(lookahead, p.min_lookahead_dist), p.max_lookahead_dist)
    cx, cy = _carrot(x, y, piece, share, points, end, lookahead)
    dx, dy = cx - x, cy - y
    co, si = math.cos(t), math.sin(t)
    ahead, left_of = co * dx + si * dy, co * dy - si * dx
    sign = directions[piece]
    angle = math.atan2(sign * left_of, sign * ahead)
    if p.use_rotate_to_heading and abs(angle) > p.rotate_to_heading_min_angle:
        return 0.0, _turn(angle, rate, p, limits, dt), piece, stage
    square = dx * dx + dy * dy
    curvature = 2.0 * left_of / square if square > AT_CARROT else 0.0
    want = p.desired_linear_vel
    if p.use_regulated_linear_velocity_scaling:
        # In a bend of radius r below the limit: speed * r / limit.
        bend = abs(curvature) * p.regulated_linear_scaling_min_radius
        if bend > 1.0:
            want = max(want / bend, p.regulated_linear_scaling_min_speed)
    if left < p.approach_velocity_scaling_dist:
        ex, ey = points[end[piece], 0] - x, points[end[piece], 1] - y
        slower = want * math.sqrt(ex * ex + ey * ey) / p.approach_velocity_scaling_dist
        want = min(want, max(slower, p.min_approach_linear_velocity))
    want = sign * min(want, p.desired_linear_vel)
    return want, want * curvature, piece, stage
