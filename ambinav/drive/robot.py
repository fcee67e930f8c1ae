"""Simulated robot: its disc, its speeds and accelerations."""

from __future__ import annotations

from dataclasses import dataclass

from ambinav.config import NonNegative, Positive, check_fields
from ambinav.geometry.footprint import Footprint


@dataclass(frozen=True)
class Robot:
    """Robot with differential drive and a disc as footprint.

    The defaults are those of nav2's example parameters for a TurtleBot (robot_radius; limits of
    the velocity smoother).

    Attributes:
        radius: Radius of the disc, metres.
        max_speed: Maximum speed, metres per second, forwards and backwards.
        max_turn_rate: Maximum turn rate, radians per second.
        acceleration: Maximum acceleration and deceleration, metres per second squared.
        turn_acceleration: Maximum angular acceleration, radians per second squared.

    Raises:
        InputError: a number is not finite or not above 0 (the radius: below 0).
    """

    radius: NonNegative = 0.22
    max_speed: Positive = 0.5
    max_turn_rate: Positive = 2.0
    acceleration: Positive = 2.5
    turn_acceleration: Positive = 3.2

    def __post_init__(self) -> None:
        check_fields(self, "robot")

    @property
    def footprint(self) -> Footprint:
        """Footprint of the robot."""
        return Footprint.disc(self.radius)

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """Maximum speed, turn rate, acceleration and turn acceleration, for the kernels."""
        return self.max_speed, self.max_turn_rate, self.acceleration, self.turn_acceleration
