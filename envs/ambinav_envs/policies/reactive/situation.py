"""Input of a reactive baseline in a step, in metres, radians and the robot's frame."""

from __future__ import annotations

from dataclasses import dataclass

from ambinav.runtime.array_types import Bools, Floats


@dataclass(frozen=True, eq=False)
class Situation:
    """State of N robots, with P obstacle points each.

    Attributes:
        x: X of obstacles, shape (N, P), metres ahead; inf: none.
        y: The same to the left.
        distance: Distance of the waypoint, shape (N,), metres.
        bearing: Bearing of the waypoint, shape (N,), radians.
        speed: Shape (N,), metres per second.
        rate: Shape (N,), radians per second.
        turned: Radians since the last step, shape (N,).
        starts: Robots whose episode has just begun, bool, shape (N,).
        limit: Share of the highest speed and turn rate that it may have, shape (N,); None: all of
            them. VFH+ alone looks at it.
    """

    x: Floats
    y: Floats
    distance: Floats
    bearing: Floats
    speed: Floats
    rate: Floats
    turned: Floats
    starts: Bools
    limit: Floats | None = None
