"""Parameters of the follower, with nav2's names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ambinav.config import Positive, Switch, check_fields
from ambinav.runtime.errors import InputError


class Packed(NamedTuple):
    """Kernel form of `FollowerParameters`, with the same names."""

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
        desired_linear_vel: Speed on a free straight path, metres per second.
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
        use_rotate_to_heading: Whether to turn on the spot where the path goes off sideways, and
            at the goal where that has a heading.
        rotate_to_heading_min_angle: From this angle on, radians.
        rotate_to_heading_angular_vel: How fast, radians per second.
        max_robot_pose_search_dist: How far ahead on the course the robot looks for itself, metres.
        inversion_xy_tolerance: A cusp counts as reached this far before it, metres.
        xy_goal_tolerance: The goal counts as reached within this distance, metres.
        yaw_goal_tolerance: And, where it has a heading, within this angle, radians.

    Raises:
        InputError: a number is not finite or not above 0, or the limits of the lookahead distance
            are in the wrong order.
    """

    desired_linear_vel: Positive = 0.5
    lookahead_dist: Positive = 0.3
    use_velocity_scaled_lookahead_dist: Switch = False
    min_lookahead_dist: Positive = 0.3
    max_lookahead_dist: Positive = 0.9
    lookahead_time: Positive = 1.5
    use_regulated_linear_velocity_scaling: Switch = True
    regulated_linear_scaling_min_radius: Positive = 0.9
    regulated_linear_scaling_min_speed: Positive = 0.25
    approach_velocity_scaling_dist: Positive = 0.6
    min_approach_linear_velocity: Positive = 0.05
    use_rotate_to_heading: Switch = True
    rotate_to_heading_min_angle: Positive = 0.785
    rotate_to_heading_angular_vel: Positive = 1.8
    max_robot_pose_search_dist: Positive = 2.0
    inversion_xy_tolerance: Positive = 0.1
    xy_goal_tolerance: Positive = 0.25
    yaw_goal_tolerance: Positive = 0.25

    def __post_init__(self) -> None:
        check_fields(self, "follower")
        if self.min_lookahead_dist > self.max_lookahead_dist:
            raise InputError(
                f"follower: min_lookahead_dist is {self.min_lookahead_dist}; give at most "
                f"max_lookahead_dist, {self.max_lookahead_dist}."
            )

    @property
    def packed(self) -> Packed:
        """Parameters for the kernels."""
        return Packed(**vars(self))
