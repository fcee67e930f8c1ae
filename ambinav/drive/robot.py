"""The robot that drives: its disc, and how fast it moves and changes its speed."""

from __future__ import annotations

from dataclasses import dataclass, fields

from ambinav.config import as_number
from ambinav.errors import InputError
from ambinav.geometry.footprint import Footprint


@dataclass(frozen=True)
class Robot:
    """A robot with differential drive that covers a disc.

    The defaults are those of nav2's example parameters for a TurtleBot (robot_radius; limits of
    the velocity smoother).

    Attributes:
        radius: Of the disc, metres.
        max_speed: Metres per second, forwards as well as backwards.
        max_turn_rate: Radians per second.
        acceleration: Metres per second squared, of gaining speed and of braking.
        turn_acceleration: Radians per second squared.

    Raises:
        InputError: a number is not finite or not above 0 (the radius: below 0).
    """

    radius: float = 0.22
    max_speed: float = 0.5
    max_turn_rate: float = 2.0
    acceleration: float = 2.5
    turn_acceleration: float = 3.2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = as_number(getattr(self, field.name), f"robot: {field.name}")
            least = "at least" if field.name == "radius" else "above"
            if value < 0.0 or (value == 0.0 and least == "above"):
                raise InputError(f"robot: {field.name} is {value:g}; give a number {least} 0.")
            object.__setattr__(self, field.name, value)

    @property
    def footprint(self) -> Footprint:
        """The ground that it covers."""
        return Footprint.disc(self.radius)

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """Largest speed, turn rate, acceleration and turn acceleration, as the kernels take it."""
        return self.max_speed, self.max_turn_rate, self.acceleration, self.turn_acceleration
