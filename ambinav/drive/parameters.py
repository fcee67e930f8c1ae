"""Parameters of the follower, with nav2's names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from ambinav.config import nearest
from ambinav.errors import InputError

SWITCHES = (
    "use_velocity_scaled_lookahead_dist",
    "use_regulated_linear_velocity_scaling",
    "use_rotate_to_heading",
)


class Packed(NamedTuple):
    """`FollowerParameters` for the kernels; the names are the same."""

    desired_linear_vel: float
    lookahead_dist: float
    use_velocity_scaled_lookahead_dist: bool
    min_lookahead_dist: float
    max_lookahead_dist: float
    lookahead_time: float
    use_regulated_linear_velocity_scaling: bool
    regulated_linear_scaling_min_radius: float
    regulated_linear_scaling_min_speed: float
    approach_velocity_scaling_dist: float
    min_approach_linear_velocity: float
    use_rotate_to_heading: bool
    rotate_to_heading_min_angle: float
    rotate_to_heading_angular_vel: float
    max_robot_pose_search_dist: float
    inversion_xy_tolerance: float
    xy_goal_tolerance: float
    yaw_goal_tolerance: float


@dataclass(frozen=True)
class FollowerParameters:
    """Parameters of the follower, as in nav2's RegulatedPurePursuitController.

    Attributes:
        desired_linear_vel: Speed on a free straight way, metres per second.
        lookahead_dist: Distance of the point that is pursued, metres. Half of nav2's: at 0.6 m
            the robot cuts right-angled corners by more than 0.1 m, which the inflated costmap of
            nav2 leaves room for and a route planned with a small margin does not.
        use_velocity_scaled_lookahead_dist: Whether that distance is the present speed times
            `lookahead_time`, within the two limits.
        min_lookahead_dist: Metres.
        max_lookahead_dist: Metres.
        lookahead_time: Seconds.
        use_regulated_linear_velocity_scaling: Whether to slow down in bends.
        regulated_linear_scaling_min_radius: Bends of a smaller radius than this, in metres, are
            taken the slower the smaller they are.
        regulated_linear_scaling_min_speed: But not slower than this, metres per second.
        approach_velocity_scaling_dist: From this far before the goal or a cusp on, in metres, the
            speed falls with the distance.
        min_approach_linear_velocity: But not below this, metres per second.
        use_rotate_to_heading: Whether to turn on the spot where the way goes off sideways, and
            at the goal where that has a heading.
        rotate_to_heading_min_angle: From this angle on, radians.
        rotate_to_heading_angular_vel: How fast, radians per second.
        max_robot_pose_search_dist: How far ahead on the course the robot looks for itself, metres.
        inversion_xy_tolerance: A cusp counts as reached this far before it, metres.
        xy_goal_tolerance: The goal counts as reached within this distance, metres.
        yaw_goal_tolerance: And, where it has a heading, within this angle, radians.

    Raises:
        InputError: a number is not finite or not above 0, or the limits of the lookahead distance
            are the wrong way round.
    """

    desired_linear_vel: float = 0.5
    lookahead_dist: float = 0.3
    use_velocity_scaled_lookahead_dist: bool = False
    min_lookahead_dist: float = 0.3
    max_lookahead_dist: float = 0.9
    lookahead_time: float = 1.5
    use_regulated_linear_velocity_scaling: bool = True
    regulated_linear_scaling_min_radius: float = 0.9
    regulated_linear_scaling_min_speed: float = 0.25
    approach_velocity_scaling_dist: float = 0.6
    min_approach_linear_velocity: float = 0.05
    use_rotate_to_heading: bool = True
    rotate_to_heading_min_angle: float = 0.785
    rotate_to_heading_angular_vel: float = 1.8
    max_robot_pose_search_dist: float = 2.0
    inversion_xy_tolerance: float = 0.1
    xy_goal_tolerance: float = 0.25
    yaw_goal_tolerance: float = 0.25

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in SWITCHES:
                if not isinstance(value, bool):
                    raise InputError(f"follower: {field.name} is {value!r}; give true or false.")
            elif isinstance(value, bool) or not isinstance(value, int | float):
                raise InputError(f"follower: {field.name} is {value!r}; give a number.")
            elif not (math.isfinite(value) and value > 0.0):
                raise InputError(f"follower: {field.name} is {value}; give a number above 0.")
        if self.min_lookahead_dist > self.max_lookahead_dist:
            raise InputError(
                f"follower: min_lookahead_dist is {self.min_lookahead_dist}; give at most "
                f"max_lookahead_dist, {self.max_lookahead_dist}."
            )

    @classmethod
    def of(cls, values: Mapping[str, float | bool]) -> FollowerParameters:
        """The parameters from a mapping; what it leaves out is as by default.

        Raises:
            InputError: a name is unknown, or a value of no use.
        """
        known = [field.name for field in fields(cls)]
        for name in values:
            if name not in known:
                raise InputError(f"follower: {name!r} is unknown; {nearest(str(name), known)}.")
        given: dict[str, Any] = dict(values)
        return cls(**given)

    @property
    def packed(self) -> Packed:
        """The same for the kernels."""
        values: dict[str, Any] = {
            name: value if isinstance(value, bool) else float(value)
            for name, value in vars(self).items()
        }
        return Packed(**values)
