"""Arguments of plug-in functions: the arrays of n robots."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from ambinav.runtime.array_types import Bools, Floats


class EpisodeEnd(IntEnum):
    """End of an episode, by its number in arrays; the same as `layout.OUTCOMES`."""

    RUNNING, ARRIVED, MISSED, COLLIDED, LOST, TIMEOUT = range(6)


class Seen(NamedTuple):
    """The state that n robots know of themselves; poses are x, y, theta in the map frame.

    Attributes:
        estimate: Estimated pose, shape (n, 3), metres and radians.
        covariance: Covariance of the estimated pose, shape (n, 3, 3).
        speeds: Speed (m/s) and turn rate (rad/s), shape (n, 2).
        goal: x and y, metres, shape (n, 2).
        readings: Readings of the scanner, shape (n, beams), metres: inf no echo, -inf too near.
    """

    estimate: Floats
    covariance: Floats
    speeds: Floats
    goal: Floats
    readings: Floats


class Stepped(NamedTuple):
    """The state of n robots after a step, with the true poses; poses as in `Seen`.

    Attributes:
        seen: The robots' own state.
        before: True poses before the step, shape (n, 3).
        truth: True poses after it, shape (n, 3).
        driven: Metres of the step, shape (n,).
        distance: What the path to the goal costs from here, metres where `ambiguity_weight` is 0,
            shape (n,).
        collided: Whether they touched a wall or a box, shape (n,).
        lost: Whether they are lost, shape (n,).
        dt: Seconds of the step.
    """

    seen: Seen
    before: Floats
    truth: Floats
    driven: Floats
    distance: Floats
    collided: Bools
    lost: Bools
    dt: float
