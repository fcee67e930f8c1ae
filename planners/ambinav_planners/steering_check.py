"""Detection of the kind of motion of an OMPL space from the space itself.

OMPL does not tell the turning radius of a space of curves. Between two poses in one place that
look in different directions the shortest curve is as many radii long, whatever the radius: one
distance tells it. All further ones must then be those of our own curves.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from ompl import base as ob

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav_planners.spaces import kind_of, pose_reader, write_pose

# The turn, radians, at which the radius is read off.
TURN = 2.0
# So many pairs of poses are compared, up to so many radii (or metres) apart, drawn with this seed.
PAIRS, APART, SEED = 64, 4.0, 20
# Lengths and poses of two implementations differ by less, in radii or metres.
TOLERANCE = 1e-6


def steering_of(si: ob.SpaceInformation) -> Steering:
    """Return the kind of motion of a space, with the turning radius derived from its distances.

    Raises:
        InputError: the space is neither R^2 nor one of OMPL's spaces over SE(2), or motions in it
            are not the straight lines, Dubins curves or Reeds-Shepp curves that its type promises
            (a symmetric Dubins space, say).
    """
    space = si.getStateSpace()
    kind = kind_of(space)
    a, b = si.allocState(), si.allocState()
    radius = 0.0
    if kind in ("dubins", "reeds-shepp"):
        write_pose(a, (0.0, 0.0, 0.0), True)
        write_pose(b, (0.0, 0.0, TURN), True)
        still = np.zeros((1, 3)), np.array([[0.0, 0.0, TURN]])
        each = float(Steering(kind, 1.0).lengths(*still)[0])
        radius = float(f"{space.distance(a, b) / each:.12g}")
    steering = Steering(kind, radius)
    if kind != "r2" and not _moves_so(space, steering, a, b):
        raise InputError(_refusal(space, steering))
    return steering


def check_steering(si: ob.SpaceInformation, steering: Steering) -> None:
    """Refuse a steering that differs from the space's.

    Raises:
        InputError: it differs in kind or turning radius, or see `steering_of`.
    """
    space = si.getStateSpace()
    kind = kind_of(space)
    if kind != steering.space:
        raise InputError(
            f"steering {steering.space!r} does not suit the state space "
            f"{space.getName()!r}; give one of the space {kind!r}."
        )
    theirs = steering_of(si)
    if not math.isclose(theirs.radius, steering.radius, rel_tol=TOLERANCE):
        raise InputError(
            f"steering has a turning radius of {steering.radius:g} m and the state space "
            f"{space.getName()!r} one of {theirs.radius:g} m; leave steering out, or give both the "
            "same."
        )


def _moves_so(space: ob.StateSpace, steering: Steering, a: Any, b: Any) -> bool:
    """Return whether random motions in a space over SE(2) agree with a steering."""
    scale = steering.radius or 1.0
    bounds = np.array([APART * scale, APART * scale, math.pi])
    first, second = np.random.default_rng(SEED).uniform(-bounds, bounds, (2, PAIRS, 3))
    if steering.turns:
        expected = steering.lengths(first, second)
    read, middle = pose_reader(True), space.allocState()
    for k in range(PAIRS):
        write_pose(a, tuple(first[k]), True)
        write_pose(b, tuple(second[k]), True)
        if steering.turns:
            off = space.distance(a, b) - expected[k]
        else:
            space.interpolate(a, b, 0.5, middle)
            off = _away_from_middle(np.array(read(middle)), first[k], second[k])
        if not abs(off) <= TOLERANCE * scale:
            return False
    return True


def _away_from_middle(pose: Floats, first: Floats, second: Floats) -> float:
    """Return the distance of a pose from a straight motion's middle, metres plus radians."""
    turn = math.remainder(second[2] - first[2], 2.0 * math.pi)
    place = math.hypot(*(pose[:2] - 0.5 * (first[:2] + second[:2])))
    return place + abs(math.remainder(pose[2] - first[2] - 0.5 * turn, 2.0 * math.pi))


def _refusal(space: ob.StateSpace, steering: Steering) -> str:
    name = space.getName()
    if steering.space == "dubins" and space.hasSymmetricDistance():
        return (
            f"state space {name!r} is a symmetric Dubins space, in which a motion may be driven "
            "from its end to its start; give DubinsStateSpace(radius) or ReedsSheppStateSpace, or "
            "`pose` to integrate along its own motions."
        )
    return (
        f"motions in the state space {name!r} are not those of {steering.space}; give `pose` to "
        "integrate along its own motions."
    )
