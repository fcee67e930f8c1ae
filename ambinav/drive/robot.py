"""Simulated robot: its disc, its speeds and accelerations."""

from __future__ import annotations

from dataclasses import dataclass

from ambinav.config import NonNegative, Positive, check_fields
from ambinav.geometry.footprint import Footprint
from ambinav.routes.clock import TURN_ACCELERATION, SpeedLimits


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
    max_speed: Positive = SpeedLimits.max_speed
    max_turn_rate: Positive = SpeedLimits.max_turn_rate
    acceleration: Positive = SpeedLimits.acceleration
    turn_acceleration: Positive = TURN_ACCELERATION

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

    def speed_limits(self, desired: float) -> SpeedLimits:
        """Return the limits of speed profiles, with a desired speed on a free straight path, m/s.

        Raises:
            InputError: the speed is not a number above 0.
        """
        return SpeedLimits(
            max_speed=min(desired, self.max_speed),
            acceleration=self.acceleration,
            max_turn_rate=self.max_turn_rate,
            turn_acceleration=self.turn_acceleration,
        )
