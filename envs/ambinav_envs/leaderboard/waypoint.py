"""The simplest driver: it drives straight at a waypoint ahead on the path."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambinav.runtime.array_types import Bools
from ambinav_envs.commands import by_filter
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import Policy

NAME = "waypoint follower"
# Metres ahead; farther on it cuts corners.
AHEAD = 0.5
SEES = {"waypoint": True, "waypoint_distance": AHEAD, "ambiguity_seen": True}
WEIGHTS = (0.0, 5.0)
"""Route weights of the followers: the shortest route's, and the aware one's."""
# Above this bearing, radians, it turns on the spot.
SIDEWAYS = 0.785


def follower_name(ambiguity_weight: float) -> str:
    """Return the name of the follower of routes with this weight."""
    return f"{NAME} {ambiguity_weight:g}" if ambiguity_weight else NAME


class WaypointFollower(Policy):
    """Drives at the observation's part `waypoint` and uses nothing else.

    That waypoint comes from the map and the estimated pose, so this is what a robot does that
    trusts both.

    Args:
        parameters: Parameters of the environment; the robot's limits, the lowest speed and the
            weight of the route are taken.
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        weight = parameters.ambiguity_weight
        super().__init__(follower_name(weight), {**SEES, "ambiguity_weight": weight})
        self._parameters, self._robot = parameters, parameters.robot

    def prepare(self, observation_space: Any, action_space: Any) -> None:
        """Do nothing: this policy needs no preparation."""

    def act(self, observations: Observation, starts: Bools) -> Any:
        """Return actions along the arc to the waypoint, as in pure pursuit; slower near it."""
        fastest, turning = self._robot.max_speed, self._robot.max_turn_rate
        distance, cosine, sine = observations["waypoint"].T.astype(np.float64)
        distance = np.maximum(10.0 * distance, 1e-3)
        angle = np.arctan2(sine, cosine)
        spot = np.abs(angle) > SIDEWAYS
        curvature = 2.0 * sine / distance
        speed = np.where(
            spot, 0.0, fastest * np.minimum(1.0, 1.0 / np.maximum(np.abs(curvature), 1.0))
        )
        rate = np.where(spot, np.clip(3.0 * angle, -turning, turning), speed * curvature)
        want = np.stack([speed, np.clip(rate, -turning, turning)], axis=1)
        return by_filter(want, observations, self._parameters)
