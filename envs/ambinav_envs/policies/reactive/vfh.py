"""VFH+: the free direction of least cost in a polar histogram of the obstacles.

Ulrich, Borenstein, "VFH+: reliable obstacle avoidance for fast mobile robots", ICRA 1998. Cells of
its grid are the points of the scan here, each certain. Of several in a sector the one of greatest
magnitude counts, not their sum: how many beams a scanner has changes nothing. Obstacles beyond the
waypoint do not count, so that a goal before a wall can be reached.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.drive.robot import Robot
from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav_envs.policies.reactive.arcs import free_lengths, room_around, stopping_speed
from ambinav_envs.policies.reactive.echoes import nearest_by_direction
from ambinav_envs.policies.reactive.parameters import VfhParameters
from ambinav_envs.policies.reactive.situation import Situation


class Vfh:
    """Computes speeds for N robots; remembers blocked sectors and the last direction of each.

    Sectors keep their direction while the robot turns: their frame is that of the robot's heading
    when its episode began, turned on by its turn rate.

    Args:
        parameters: See there.
        robot: Its disc and limits.
        dt: Time step, seconds.
    """

    def __init__(self, parameters: VfhParameters, robot: Robot, dt: float) -> None:
        self._parameters, self._robot, self._dt = parameters, robot, dt
        self._sectors = np.arange(parameters.sectors) * (2.0 * math.pi / parameters.sectors)
        self._blocked: Bools = np.empty((0, parameters.sectors), dtype=np.bool_)
        self._turned = self._steered = np.empty(0)

    def command(self, now: Situation) -> Floats:
        """Return the commanded speed (m/s) and turn rate (rad/s) of each robot, shape (N, 2)."""
        self._remember(now)
        x, y = nearest_by_direction(now.x, now.y, 2 * self._parameters.sectors)
        sectors = wrap_angles(self._sectors - self._turned[:, None])
        blocked = self._binary(x, y, sectors, now)
        masked = blocked | self._unreachable(x, y, sectors, now.speed)
        # Where none is within the turning circles the robot stops and turns on the spot.
        stop = np.asarray(masked.all(axis=1) & ~blocked.all(axis=1))
        direction = self._direction(np.where(stop[:, None], blocked, masked), sectors, now)
        trapped = blocked.all(axis=1)
        self._steered = np.where(trapped, self._steered, direction + self._turned)
        want = self._speeds(x, y, direction, stop, now)
        want[trapped] = 0.0
        return want

    def _remember(self, now: Situation) -> None:
        """Reset the memory of robots whose episode starts, and rotate the frame of the others."""
        if len(self._turned) != len(now.speed):
            count = len(now.speed)
            self._blocked = np.zeros((count, len(self._sectors)), dtype=np.bool_)
            self._turned, self._steered = np.zeros((2, count))
        self._turned = np.where(now.starts, 0.0, self._turned + now.turned)
        self._blocked[now.starts] = False
        self._steered = np.where(now.starts, now.bearing, self._steered)

    def _binary(self, x: Floats, y: Floats, sectors: Floats, now: Situation) -> Bools:
        """Return which sectors are blocked, shape (N, S): primary histogram and two thresholds."""
        parameters = self._parameters
        magnitude = self._magnitude(x, y, sectors, now.distance, parameters.clearance)
        blocked = np.where(
            magnitude > parameters.high,
            True,
            np.where(magnitude < parameters.low, False, self._blocked),
        )
        tight = blocked.all(axis=1)
        if tight.any():
            # Narrower than with the clearance: the robot itself may still fit.
            bare = self._magnitude(x[tight], y[tight], sectors[tight], now.distance[tight], 0.0)
            blocked[tight] = bare > parameters.high
        self._blocked = blocked
        return blocked.copy()

    def _magnitude(
        self, x: Floats, y: Floats, sectors: Floats, most: Floats, clearance: float
    ) -> Floats:
        """Return the greatest magnitude of an obstacle in each sector, shape (N, S), 0 to 1."""
        distance = np.hypot(x, y)
        counts = distance <= np.minimum(self._parameters.window, most)[:, None]
        distance = np.where(counts, distance, np.inf)
        angle = np.arctan2(np.where(counts, y, 0.0), np.where(counts, x, 1.0))
        share = (self._robot.radius + clearance) / np.maximum(distance, 1e-9)
        half = np.arcsin(np.minimum(share, 1.0))
        weight = np.maximum(1.0 - (distance / self._parameters.window) ** 2, 0.0)
        weight = np.where(counts, weight, 0.0)
        # Compared by their cosines, which are a product of matrices: ten times as fast.
        cosine = np.stack([np.cos(sectors), np.sin(sectors)], axis=2) @ np.stack(
            [np.cos(angle), np.sin(angle)], axis=1
        )
        within = cosine >= np.cos(half)[:, None, :] - 1e-12
        magnitude: Floats = (within * weight[:, None, :]).max(axis=2)
        return magnitude

    def _unreachable(self, x: Floats, y: Floats, sectors: Floats, speed: Floats) -> Bools:
        """Return the sectors that no turning circle at the present speed reaches, shape (N, S).

        A circle to one side is blocked by an obstacle that its disc would touch: directions from
        that obstacle on to straight behind are masked on that side. On the spot all are reached.
        """
        turning = (np.abs(speed) / self._robot.max_turn_rate)[:, None]
        reach = turning + self._robot.radius + self._parameters.clearance
        is_echo = np.isfinite(x) & (turning > 1e-6)
        px, py = np.where(is_echo, x, 0.0), np.where(is_echo, y, 0.0)
        angle = np.arctan2(py, px)
        left = is_echo & (angle > 0.0) & (np.hypot(px, py - turning) < reach)
        right = is_echo & (angle < 0.0) & (np.hypot(px, py + turning) < reach)
        most = np.where(left, angle, np.inf).min(axis=1)[:, None]
        least = np.where(right, angle, -np.inf).max(axis=1)[:, None]
        return np.asarray((sectors > most) | (sectors < least))

    def _direction(self, blocked: Bools, sectors: Floats, now: Situation) -> Floats:
        """Return the candidate of least cost, shape (N,), radians in the robot's frame."""
        parameters = self._parameters
        count = len(self._sectors)
        half = max(1, round(0.5 * parameters.wide / (2.0 * math.pi) * count))
        before, after = free_run(blocked[:, ::-1])[:, ::-1], free_run(blocked)
        wide = before + after + 1 >= 2 * half
        middle = (before == after) | (before == after + 1)
        edge = (before == half) | (after == half)
        inside = (before >= half) & (after >= half)
        at_target = np.abs(wrap_angles(sectors - now.bearing[:, None])).argmin(axis=1)
        target = np.arange(count) == at_target[:, None]
        candidate = ~blocked & np.where(wide, edge | (target & inside), middle)
        # The middle of an even number of sectors lies between two; the target's own direction is
        # not that of the middle of its sector.
        between = np.where(wide, 0.0, 0.5 * (after - before) * (2.0 * math.pi / count))
        angle = np.where(target & inside, now.bearing[:, None], wrap_angles(sectors + between))
        previous = (self._steered - self._turned)[:, None]
        cost = (
            parameters.target * np.abs(wrap_angles(angle - now.bearing[:, None]))
            + parameters.heading * np.abs(angle)
            + parameters.previous * np.abs(wrap_angles(angle - previous))
        )
        best = np.where(candidate, cost, np.inf).argmin(axis=1)
        return np.asarray(np.take_along_axis(angle, best[:, None], axis=1)[:, 0])

    def _speeds(
        self, x: Floats, y: Floats, direction: Floats, stop: Bools, now: Situation
    ) -> Floats:
        """Return speeds on the arc into the direction, low enough to stop, or a turn in place."""
        parameters, robot = self._parameters, self._robot
        spot = (np.abs(direction) > parameters.spot) | stop
        curvature = np.where(spot, 0.0, 2.0 * np.sin(direction) / parameters.ahead)
        reach = robot.max_speed**2 / robot.acceleration + 2.0 * robot.max_speed * self._dt
        room = room_around(x, y, robot.radius, parameters.margin)
        arcs = np.stack([curvature, self._reached(curvature, now)], axis=1)
        length = free_lengths(x, y, arcs, room, reach).min(axis=1)
        limit = 1.0 if now.limit is None else now.limit
        most, fastest = limit * robot.max_speed, limit * robot.max_turn_rate
        top = np.minimum(most, stopping_speed(length, robot.acceleration, self._dt))
        speed = top * np.maximum(np.cos(direction), 0.0)
        speed = np.minimum(speed, robot.max_turn_rate / np.maximum(np.abs(curvature), 1e-9))
        # An arc without clearance: the robot turns until there is some.
        spot |= speed < 0.05 * robot.max_speed
        rate = np.where(spot, parameters.gain * direction, speed * curvature)
        rate = np.clip(rate, -fastest, fastest)
        return np.stack([np.where(spot, 0.0, speed), rate], axis=1)

    def _reached(self, curvature: Floats, now: Situation) -> Floats:
        """Return the curvature of the arc after a step, 1/m: the turn rate lags behind."""
        robot = self._robot
        speed = np.minimum(now.speed + robot.acceleration * self._dt, robot.max_speed)
        speed = np.maximum(speed, 0.1 * robot.max_speed)
        turn = robot.turn_acceleration * self._dt
        return np.asarray(np.clip(speed * curvature, now.rate - turn, now.rate + turn) / speed)


def free_run(blocked: Bools) -> Ints:
    """Count the consecutive free sectors after each sector, shape (N, S); at most S - 1.

    Sectors go round; of a blocked one the number says nothing.
    """
    count = blocked.shape[1]
    twice = np.concatenate([blocked, blocked], axis=1)
    places = np.where(twice, np.arange(2 * count), 2 * count + count)
    following = np.minimum.accumulate(places[:, ::-1], axis=1)[:, ::-1]
    after = following[:, 1 : count + 1] - np.arange(count) - 1
    return np.asarray(np.minimum(after, count - 1), dtype=np.int64)
