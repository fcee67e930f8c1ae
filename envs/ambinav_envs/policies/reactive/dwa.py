"""The dynamic window approach: the best speeds that are reachable and allow a stop.

Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", IEEE Robotics and
Automation Magazine 4(1), 1997.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.drive.robot import Robot
from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Floats
from ambinav_envs.policies.reactive.arcs import free_lengths, room_around, stopping_speed
from ambinav_envs.policies.reactive.echoes import nearest_by_direction
from ambinav_envs.policies.reactive.parameters import DwaParameters
from ambinav_envs.policies.reactive.situation import Situation

DIRECTIONS: Final = 120
"""Number of directions; the nearest obstacle in each is kept."""
SLOW: Final = 0.1
"""Slower than this share of the highest speed, and turning as slowly, a robot is stuck."""


class Dwa:
    """Computes speeds for N robots; remembers for each whether, and to which side, it turns away.

    Args:
        parameters: See there.
        robot: Its disc and limits.
        dt: Time step, seconds.
    """

    def __init__(self, parameters: DwaParameters, robot: Robot, dt: float) -> None:
        self._parameters, self._robot, self._dt = parameters, robot, dt
        self._away = np.empty(0)

    def command(self, now: Situation) -> Floats:
        """Return the commanded speed (m/s) and turn rate (rad/s) of each robot, shape (N, 2)."""
        if len(self._away) != len(now.speed):
            self._away = np.zeros(len(now.speed))
        self._away[now.starts] = 0.0
        x, y = nearest_by_direction(now.x, now.y, DIRECTIONS)
        speed, rate = self._window(now)
        score = self._score(x, y, speed, rate, now)
        best = score.argmax(axis=1)[:, None]
        want = np.stack(
            [np.take_along_axis(part, best, axis=1)[:, 0] for part in (speed, rate)], axis=1
        )
        return self._turn_away(x, y, want, now)

    def _window(self, now: Situation) -> tuple[Floats, Floats]:
        """Return speeds and turn rates of the C candidates, shape (N, C) each; the last stands."""
        parameters, robot = self._parameters, self._robot
        change, turn = robot.acceleration * self._dt, robot.turn_acceleration * self._dt
        low = np.clip(now.speed - change, 0.0, robot.max_speed)
        high = np.clip(now.speed + change, 0.0, robot.max_speed)
        steps = np.linspace(0.0, 1.0, parameters.speeds)
        speed = low[:, None] + (high - low)[:, None] * steps
        rate = now.rate[:, None] + turn * np.linspace(-1.0, 1.0, parameters.rates)
        rate = np.clip(rate, -robot.max_turn_rate, robot.max_turn_rate)
        each = (len(now.speed), parameters.speeds, parameters.rates)
        speeds = np.broadcast_to(speed[:, :, None], each).reshape(len(now.speed), -1)
        rates = np.broadcast_to(rate[:, None, :], each).reshape(len(now.speed), -1)
        stand = np.zeros((len(now.speed), 1))
        return np.concatenate([speeds, stand], axis=1), np.concatenate([rates, stand], axis=1)

    def _score(self, x: Floats, y: Floats, speed: Floats, rate: Floats, now: Situation) -> Floats:
        """Compute the objective of each candidate, shape (N, C); -inf if it cannot stop in time."""
        parameters, robot = self._parameters, self._robot
        moving = speed > 1e-6
        curvature = np.where(moving, rate / np.where(moving, speed, 1.0), 0.0)
        room = room_around(x, y, robot.radius, parameters.margin)
        length = free_lengths(x, y, curvature, room, parameters.reach)
        length = np.where(moving, length, parameters.reach)
        admissible = speed <= stopping_speed(length, robot.acceleration, self._dt) + 1e-9
        # Obstacles beyond the waypoint do not affect the preference.
        reach = np.minimum(parameters.reach, np.maximum(now.distance, 0.1))[:, None]
        clearance = np.minimum(length / reach, 1.0)
        turned = self._turn_on_arc(rate)
        driven = np.minimum(speed * parameters.horizon, length)
        chord = driven * np.sinc(0.5 * turned / math.pi)
        px = (now.distance * np.cos(now.bearing))[:, None] - chord * np.cos(0.5 * turned)
        py = (now.distance * np.sin(now.bearing))[:, None] - chord * np.sin(0.5 * turned)
        off = np.abs(wrap_angles(np.arctan2(py, px) - turned))
        score = (
            parameters.heading * (1.0 - off / math.pi)
            + parameters.clearance * clearance
            + parameters.velocity * speed / robot.max_speed
        )
        return np.where(admissible | ~moving, score, -np.inf)

    def _turn_on_arc(self, rate: Floats) -> Floats:
        """Return the angle turned on the arc within the horizon, radians."""
        return np.asarray(np.clip(rate * self._parameters.horizon, -math.pi, math.pi))

    def _turn_away(self, x: Floats, y: Floats, want: Floats, now: Situation) -> Floats:
        """Return the speeds; stuck robots turn to the freer side until the path ahead is free."""
        parameters, robot = self._parameters, self._robot
        sides = np.linspace(-2.0, 2.0, 5)
        room = room_around(x, y, robot.radius, parameters.margin)
        bends = np.broadcast_to(sides, (len(x), len(sides)))
        lengths = free_lengths(x, y, bends, room, parameters.reach)
        stuck = (want[:, 0] < SLOW * robot.max_speed) & (
            np.abs(want[:, 1]) < SLOW * robot.max_turn_rate
        )
        side = np.where(lengths[:, 3:].sum(axis=1) >= lengths[:, :2].sum(axis=1), 1.0, -1.0)
        free = lengths[:, 2] >= np.minimum(0.5 * parameters.reach, now.distance)
        self._away = np.where(free, 0.0, np.where(stuck & (self._away == 0.0), side, self._away))
        turning = self._away != 0.0
        rate = 0.5 * robot.max_turn_rate * self._away
        return np.where(turning[:, None], np.stack([np.zeros_like(rate), rate], axis=1), want)
