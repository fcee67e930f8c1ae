"""OMPL state spaces for the kinds of motion, and conversion between states and poses."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from ompl import base as ob

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Bounds, Floats, Pose
from ambinav.runtime.errors import InputError


def make_space(steering: Steering, bounds: Bounds) -> ob.StateSpace:
    """Create OMPL's state space for a kind of motion.

    Args:
        steering: r2, se2, dubins or reeds-shepp.
        bounds: (xmin, ymin, xmax, ymax) of the reference point, metres.

    Returns:
        RealVectorStateSpace, SE2StateSpace, DubinsStateSpace or ReedsSheppStateSpace. Distances
        in SE2 are metres plus 0.5 per radian of yaw, OMPL's own weight.
    """
    limits = ob.RealVectorBounds(2)
    for axis in (0, 1):
        limits.setLow(axis, bounds[axis])
        limits.setHigh(axis, bounds[axis + 2])
    if steering.space == "r2":
        space = ob.RealVectorStateSpace(2)
    elif steering.space == "se2":
        space = ob.SE2StateSpace()
    elif steering.space == "dubins":
        space = ob.DubinsStateSpace(steering.radius)
    else:
        space = ob.ReedsSheppStateSpace(steering.radius)
    space.setBounds(limits)
    return space


def kind_of(space: ob.StateSpace) -> str:
    """Return the kind of motion of a space: r2, se2, dubins or reeds-shepp.

    Raises:
        InputError: the space is neither R^2 nor one of OMPL's spaces over SE(2).
    """
    if isinstance(space, ob.RealVectorStateSpace) and space.getDimension() == 2:
        return "r2"
    # The spaces of curves derive from SE(2) in OMPL, so they are asked for first.
    for name, kind in (
        ("dubins", ob.DubinsStateSpace),
        ("reeds-shepp", ob.ReedsSheppStateSpace),
        ("se2", ob.SE2StateSpace),
    ):
        if isinstance(space, kind):
            return name
    raise InputError(
        f"state space {space.getName()!r} does not tell where the robot is; give `pose`, a "
        "function from a state to x, y or x, y, theta, or one of RealVectorStateSpace(2), "
        "SE2StateSpace, DubinsStateSpace and ReedsSheppStateSpace."
    )


def has_heading(space: ob.StateSpace) -> bool:
    """Return whether the states of a space have a heading.

    Raises:
        InputError: the space is neither R^2 nor one of OMPL's spaces over SE(2).
    """
    return kind_of(space) != "r2"


def pose_reader(with_heading: bool) -> Callable[[Any], Pose]:
    """Return a function from a state to x, y, theta; theta is 0 where states have none."""

    def planar(state: Any) -> Pose:
        return state[0], state[1], 0.0

    def posed(state: Any) -> Pose:
        return state.getX(), state.getY(), state.getYaw()

    return posed if with_heading else planar


def new_state(si: ob.SpaceInformation, pose: Pose, with_heading: bool) -> Any:
    """Create a state at a pose, allocated by `si` (the space's own allocator leaks)."""
    state = si.allocState()
    write_pose(state, pose, with_heading)
    return state


def write_pose(state: Any, pose: Pose, with_heading: bool) -> None:
    """Write a pose into a state of R^2 or of a space over SE(2)."""
    if with_heading:
        state.setX(pose[0])
        state.setY(pose[1])
        # OMPL's headings are from -pi to below pi; a state with any other one is out of bounds.
        yaw = pose[2]
        if not -math.pi <= yaw < math.pi:
            yaw = (yaw + math.pi) % (2.0 * math.pi) - math.pi
        state.setYaw(yaw if yaw < math.pi else -math.pi)
    else:
        state[0], state[1] = pose[0], pose[1]


def check_axes(si: ob.SpaceInformation, distance: Callable[[Any, Any], float]) -> None:
    """Check that a step of 1 along the axes of a space is at least a metre.

    OMPL's informed planners look no further than the space's own distance; its samplers serve
    vectors and poses alone, and refuse compound spaces.

    Args:
        si: Space information; RealVectorStateSpaces, SE3StateSpaces and those over SE(2) are
            checked.
        distance: Metres between two states, which the cost is at least.

    Raises:
        InputError: a step of 1 along an axis, or between two axes, is shorter in metres.
    """
    space = si.getStateSpace()
    if isinstance(space, ob.SE3StateSpace):
        count = 3
    elif isinstance(space, ob.SE2StateSpace):
        count = 2
    elif isinstance(space, ob.RealVectorStateSpace):
        count = space.getDimension()
    else:
        return
    a, b = si.allocState(), si.allocState()
    middle, scale = _middle_of(space, count)
    _set_place(space, a, middle)
    for step in _unit_steps(count):
        _set_place(space, b, middle + scale * step)
        metres = distance(a, b) / scale
        if not metres >= 1.0 - 1e-9:
            along = " and ".join(map(str, np.flatnonzero(step)))
            raise InputError(
                f"a step of 1 along axis {along} of the state space {space.getName()!r} is "
                f"{metres:g} m by `pose` and `height`, so that informed planners would leave out "
                "cheap paths; let states be in metres, give `height`, a function from a state to "
                "its height in metres, or put an axis that is not in metres into a subspace of a "
                "CompoundStateSpace."
            )


def _middle_of(space: ob.StateSpace, count: int) -> tuple[Floats, float]:
    """Return the middle of a space's bounds, and a step, at most 1, with which one stays inside."""
    bounds = space.getBounds()
    low, high = (np.array(ends, dtype=np.float64)[:count] for ends in (bounds.low, bounds.high))
    if not (low < high).all():  # they are not set
        return np.zeros(count), 1.0
    return 0.5 * (low + high), min(1.0, 0.4 * float((high - low).min()))


def _unit_steps(count: int) -> Iterator[Floats]:
    """Yield steps of length 1 along each axis, and on both diagonals of each two."""
    axes = np.eye(count)
    yield from axes
    for first, second in itertools.combinations(axes, 2):
        yield (first + second) / math.sqrt(2.0)
        yield (first - second) / math.sqrt(2.0)


def _set_place(space: ob.StateSpace, state: Any, place: Floats) -> None:
    """Set the numbers of a state that are a place; the heading or rotation is that of 0."""
    if isinstance(space, ob.SE3StateSpace):
        state.setXYZ(*place.tolist())
        state.rotation().setIdentity()
    elif isinstance(space, ob.SE2StateSpace):
        write_pose(state, (place[0], place[1], 0.0), True)
    else:
        for i, value in enumerate(place.tolist()):
            state[i] = value
