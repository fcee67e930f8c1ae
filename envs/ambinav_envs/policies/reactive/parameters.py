"""Parameters of the reactive baselines, with their sources."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from ambinav.config import NonNegative, Positive, check_fields
from ambinav.runtime.errors import InputError

_WIDE: Final = math.radians(60.0)


@dataclass(frozen=True, kw_only=True)
class VfhParameters:
    """Parameters of VFH+; metres, seconds, radians.

    "UB98" is Ulrich, Borenstein, "VFH+: reliable obstacle avoidance for fast mobile robots", ICRA
    1998. Ours is what has no counterpart there, or another scale.

    Attributes:
        sectors: Number of sectors of the polar histogram; 72 are the 5 degrees of UB98.
        window: Radius of the active region: an obstacle there has magnitude 0, and one at the
            robot 1, falling with the squared distance (UB98, the magnitude of a cell).
        low: A blocked sector is free again below this magnitude (the lower threshold of UB98).
        high: A free sector is blocked above this magnitude (the upper one). With 3 m
            these are 1.9 and 1.8 m.
        clearance: d_s of UB98: added to the robot's radius to enlarge obstacles. With 0.1 m a
            quarter of the episodes in freiburg-079 ended before a door.
        wide: s_max of UB98: openings this wide have candidates half of it inside
            each edge, narrower ones in the middle.
        target: mu_1, cost of leaving the direction of the target (UB98: 5, 2, 2).
        heading: mu_2, cost of leaving the present heading.
        previous: mu_3, cost of leaving the direction that was chosen last.
        margin: Ours: free space that is kept around the disc when the speed is set.
        ahead: Ours: the robot drives on the arc to a point this far in the chosen direction.
        spot: Ours: a direction farther off than this it turns to on the spot.
        gain: Ours: turn rate on the spot by the angle that is left, 1/s.
        memory: How long obstacles out of view are remembered, instead of the grid of UB98.

    Raises:
        InputError: a value is of no use.
    """

    sectors: int = 72
    window: Positive = 3.0
    low: Positive = 0.6
    high: Positive = 0.64
    clearance: NonNegative = 0.03
    wide: Positive = _WIDE
    target: NonNegative = 5.0
    heading: NonNegative = 2.0
    previous: NonNegative = 2.0
    margin: NonNegative = 0.06
    ahead: Positive = 0.6
    spot: Positive = _WIDE
    gain: Positive = 3.0
    memory: NonNegative = 3.0

    def __post_init__(self) -> None:
        """Check every field."""
        check_fields(self, "vfh")
        if self.sectors < 8:
            raise InputError(f"vfh: sectors is {self.sectors}; give 8 or more.")
        if not self.low <= self.high < 1.0:
            raise InputError(f"vfh: high is {self.high:g}; give at least low and below 1.")


@dataclass(frozen=True, kw_only=True)
class DwaParameters:
    """Parameters of the dynamic window approach; metres, seconds, radians.

    "FBT97" is Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", IEEE
    Robotics and Automation Magazine 4(1), 1997. Ours is what has no counterpart there.

    Attributes:
        speeds: Samples of the speed across the dynamic window.
        rates: Samples of the turn rate across it; odd, so that the present one is among them.
        heading: alpha, weight of which way the robot then looks (FBT97, the objective function).
        clearance: beta, weight of the free length of the arc. With less, a robot drives up to
            boxes and is stuck there: of 64 episodes in disturbed intel 69 % arrived with 0.2, 75 %
            with 1.
        velocity: gamma, weight of the speed.
        reach: Arcs are looked at so far ahead; free ones that long have the full clearance.
        margin: Ours: free space that is kept around the disc.
        horizon: Ours: the heading is judged where the robot is after this time on the arc.
        memory: Ours: how long obstacles out of view are remembered.

    Raises:
        InputError: a value is of no use.
    """

    speeds: int = 4
    rates: int = 11
    heading: NonNegative = 2.0
    clearance: NonNegative = 1.0
    velocity: NonNegative = 0.2
    reach: Positive = 2.0
    margin: NonNegative = 0.06
    horizon: Positive = 0.4
    memory: NonNegative = 3.0

    def __post_init__(self) -> None:
        """Check every field."""
        check_fields(self, "dwa")
        if self.speeds < 2:
            raise InputError(f"dwa: speeds is {self.speeds}; give 2 or more.")
        if self.rates < 3 or self.rates % 2 == 0:
            raise InputError(f"dwa: rates is {self.rates}; give an odd number from 3 on.")
