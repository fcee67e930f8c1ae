"""People who walk around: they block beams and avoid the robot.

In the plane a person is a disc, in a building in space a cylinder on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from ambinav.config import NonNegative, Positive, check_fields, integer
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.disc_sweep import clear_along
from ambinav.geometry.collision.sweep import pose_free
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import ROUNDING, Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.random import uniform
from ambinav.runtime.array_types import Floats, UInts
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel

PERSON_HEIGHT: Final = 1.7
"""Height of a person in a building in space, metres: the mean of adults. Rays pass over it."""
# Number of attempts to place a person.
TRIES = 10_000
# From this far on, from rim to rim in metres, people walk away from the robot.
KEEP = 0.3
# Turns from straight away that a person tries whom a wall keeps from it, radians.
ASIDE = (0.0, 0.25 * math.pi, -0.25 * math.pi, 0.5 * math.pi, -0.5 * math.pi)


@dataclass(frozen=True)
class People:
    """People in a building, each on a different path in every run.

    They walk straight until a wall stops them and then turn. They do not collide with the robot:
    when it comes near they walk away from it, sideways if a wall is in the way, and stop if they
    cannot.

    Attributes:
        count: Number of people.
        radius: Radius of the disc or cylinder that blocks beams, metres; see `PERSON_HEIGHT`.
        speed: Metres per second; 0: they stand.

    Raises:
        InputError: the count or the speed is negative, the radius not above 0, or one of them no
            number.
    """

    count: Annotated[int, integer(least=0)]
    radius: Positive = 0.25
    speed: NonNegative = 1.0

    def __post_init__(self) -> None:
        check_fields(self, "people")


class Crowd:
    """People of all runs at the present time.

    Args:
        environment: Where they walk.
        people: How many, and how.
        robots: Radius of the robot, metres.
        poses: Poses of the robots, shape (R, 3): nobody starts in their way.
        states: States of the random numbers, shape (R, 4); advanced.

    Attributes:
        places: x, y and heading of each, shape (R, P, 3), metres and radians, map frame.

    Raises:
        InputError: there is no room for them.
    """

    def __init__(
        self, environment: Environment, people: People, robots: float, poses: Floats, states: UInts
    ) -> None:
        self.people = people
        self._apart = robots + people.radius + KEEP
        self._states = states
        checker = CollisionChecker(
            environment, Footprint.disc(people.radius), Steering(), simulated=True
        )
        self._arrays = checker.arrays
        self.places = np.empty((len(poses), people.count, 3))
        if not _place_people(
            np.array(environment.bounds), poses, self._apart, *self._arrays, states, self.places
        ):
            raise InputError(
                f"people: there is no room for {people.count} with a radius of {people.radius:g} m "
                f"in {environment.name!r}; give fewer or smaller ones."
            )

    def walk(self, poses: Floats, dt: float) -> None:
        """Walk on for `dt` seconds; the robots are at poses, shape (R, 3)."""
        _walk(
            self.places, poses, self._apart, float(self.people.speed) * dt,
            float(self.people.radius), *self._arrays[:2], self._states,
        )  # fmt: skip


@kernel
def _place_people(bounds, poses, apart, table, bound, forbidden, states, places):
    """Sample a free position and a heading for everyone; return False if somebody has none."""
    for r in range(places.shape[0]):
        for k in range(places.shape[1]):
            placed = False
            for _ in range(TRIES):
                x = bounds[0] + uniform(states[r]) * (bounds[2] - bounds[0])
                y = bounds[1] + uniform(states[r]) * (bounds[3] - bounds[1])
                away = math.hypot(x - poses[r, 0], y - poses[r, 1])
                if away > apart and pose_free(x, y, 0.0, table, bound, forbidden):
                    placed = True
                    break
            if not placed:
                return False
            places[r, k, 0], places[r, k, 1] = x, y
            places[r, k, 2] = 2.0 * math.pi * uniform(states[r])
    return True


@kernel
def _walk(places, poses, apart, length, radius, table, bound, states):
    for r in range(places.shape[0]):
        for k in range(places.shape[1]):
            x, y, t = places[r, k]
            # Always drawn, so that the random numbers do not depend on the robot.
            other = 2.0 * math.pi * uniform(states[r])
            places[r, k] = strolled(
                x, y, t, poses[r, 0], poses[r, 1], apart, length, radius, other, table, bound
            )


@kernel
def strolled(x, y, t, robot_x, robot_y, apart, length, radius, other, table, bound):
    """Return where a person is after `length` metres, and its heading.

    Args:
        x: The person, metres, map frame.
        y: The same.
        t: Its heading, radians.
        robot_x: The robot, metres, map frame.
        robot_y: The same.
        apart: Nearer than this to it, the person walks away from it, metres.
        length: How far it walks, metres.
        radius: Radius of the person, metres.
        other: Heading to turn to if a wall is in the way, radians.
        table: The first of `CollisionChecker.arrays`.
        bound: The second.
    """
    dx, dy = x - robot_x, y - robot_y
    near = dx * dx + dy * dy < apart * apart
    if near:
        t = math.atan2(dy, dx)
    for turn in ASIDE:
        ux, uy = math.cos(t + turn), math.sin(t + turn)
        clear, _ = clear_along(x, y, ux, uy, 0.0, length, radius - ROUNDING, table, bound)
        if clear:
            return x + length * ux, y + length * uy, t + turn
        if not near:
            break
    return x, y, other
