"""Motions of any OMPL space as sequences of poses, and the integral of a field along them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from ompl import base as ob

from ambinav.geometry.frames import wrap_angles
from ambinav.geometry.motion.curves import FACING, STRAIGHT
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.service.motion import motion_integrals
from ambinav.service.service import AmbiguityService

PoseOf = Callable[[Any], Sequence[float]]
"""From a state to x, y, theta in metres and radians, or to x, y alone."""
HeightOf = Callable[[Any], float]
"""From a state to the height z of the robot, metres."""

# No step along a motion turns by more than this, radians.
MOST_TURN = 0.2
# A step is halved, so often at the most, while its two halves are longer than it by this share and
# this share of the lattice's spacing, or differ by as much: where the motion bends or turns back.
HALVINGS, LONGER, LEAST = 8, 1e-3, 1e-6
# A motion has at least so many steps; one that is not straight at even speed, so many.
FEWEST, FEWEST_BENT = 4, 8
# Columns of a position in poses with a height.
PLACE = [0, 1, 3]
# A piece of a motion whose shadow is a smaller share of its length goes straight up or down.
UPRIGHT = 1e-9
# A motion is divided so finely at the most: one of 100 000 steps does not end.
MOST_STEPS = 100_000


class SpaceMotions:
    """Reads poses from the states of a space, and integrates the cost along its motions.

    A motion is followed along `space.interpolate` in steps no longer than the lattice's spacing
    and turning by no more than `MOST_TURN`; between them it is taken as straight, and the
    integral of that is exact. A motion that is straight costs exactly as much as by the kernels.

    Args:
        si: OMPL's space information.
        service: Service for the cost per metre.
        pose: See `PoseOf`. Without a heading the map is read along the travel.
        height: See `HeightOf`. None: the robot stays on the floor, and its cost is that of the
            planar motion.

    Attributes:
        planar: Whether poses come without a heading; known after the first one was read.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        service: AmbiguityService,
        pose: PoseOf,
        height: HeightOf | None = None,
    ) -> None:
        self._space = si.getStateSpace()
        self._between = si.allocState()
        self._pose = pose
        self._height = height
        self._density = service.density
        self._step = service.map.spacing
        values, _, left, low, inverse = service.density.arrays
        self._field = (values, left, low, inverse)
        self.planar = False

    def pose(self, state: Any) -> tuple[float, float, float]:
        """Return the pose of a state; heading 0 where states have none.

        Raises:
            InputError: what the pose function gives is not two or three finite numbers.
        """
        pose = self._pose(state)
        try:
            values = tuple(float(value) for value in pose)
        except (TypeError, ValueError):
            values = ()
        if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
            raise InputError(
                f"pose gives {pose!r} for a state; let it return x and y in metres and, where the "
                "robot has a heading, theta in radians."
            )
        self.planar = len(values) == 2
        return values[0], values[1], 0.0 if self.planar else values[2]

    def position(self, state: Any) -> tuple[float, float, float]:
        """Return x, y and z of a state, metres; z is 0 without `height`.

        Raises:
            InputError: see `pose`; or the height is not a finite number.
        """
        x, y, _, z = self._point(state)
        return x, y, z

    def distance(self, a: Any, b: Any) -> float:
        """Return the straight distance between two states, metres, with `height` in space."""
        return math.dist(self.position(a), self.position(b))

    def poses(self, a: Any, b: Any) -> Floats:
        """Return x, y, theta, z along the motion from a to b, (N, 4), both ends included.

        Raises:
            InputError: the motion jumps: however finely it is divided, a step stays too long.
        """
        first, last = self._point(a), self._point(b)
        count = max(self._steps(np.array([first, last])), FEWEST)
        while count <= MOST_STEPS:
            shares = np.arange(count + 1) / count
            inner = [self._at(a, b, share) for share in shares[1:-1].tolist()]
            poses = np.array([first, *inner, last])
            needed = self._steps(poses)
            if needed > 1:
                count *= needed
            elif self._is_even(shares, poses):
                return poses
            elif count < FEWEST_BENT:
                count = FEWEST_BENT
            else:
                return self._refined(a, b, shares, poses)
        raise InputError(
            f"a motion in the state space {self._space.getName()!r} jumps from pose to pose; its "
            "cost cannot be integrated."
        )

    def cost(self, a: Any, b: Any) -> float:
        """Return the cost of the motion from a to b, metres-equivalent."""
        poses = self.poses(a, b)
        parts = np.empty(len(poses) - 1)
        kind = FACING if self.planar else STRAIGHT
        flown = np.ascontiguousarray(poses[:, :3])
        motion_integrals(kind, None, flown[:-1], flown[1:], *self._field, parts)
        if self._height is None:
            return float(parts.sum())
        # A straight piece costs its mean price, which is that of its shadow, times its length.
        moved = np.diff(poses[:, PLACE], axis=0)
        flat, length = np.hypot(moved[:, 0], moved[:, 1]), np.sqrt((moved**2).sum(axis=1))
        upright = flat <= UPRIGHT * length
        mean = np.divide(parts, flat, out=np.zeros_like(parts), where=~upright)
        for i in np.flatnonzero(upright):
            x, y, theta, _ = poses[i].tolist()
            mean[i] = self._mean_turning(x, y, theta, float(poses[i + 1, 2]))
        return float(mean @ length)

    def _mean_turning(self, x: float, y: float, theta: float, end: float) -> float:
        """Return the mean price in one place while the heading turns, the short way round."""
        turn = math.remainder(end - theta, 2.0 * math.pi)
        if turn == 0.0 or self.planar:
            return self._density.near(x, y, theta)
        # Between the headings of the map it is linear.
        headings = self._density.values.shape[2] / (2.0 * math.pi)
        low, high = sorted((theta * headings, (theta + turn) * headings))
        knots = np.arange(math.ceil(low), math.floor(high) + 1)
        at = np.unique([low, *knots, high])
        prices = [self._density.near(x, y, each / headings) for each in at.tolist()]
        return float(np.trapezoid(prices, at) / (high - low))

    def _is_even(self, shares: Floats, poses: Floats) -> bool:
        """Return whether a motion goes straight on at an even speed, as far as its poses tell."""
        places = poses[:, PLACE]
        straight = places[0] + shares[:, None] * (places[-1] - places[0])
        return bool(np.abs(places - straight).max() <= LEAST * self._step)

    def _refined(self, a: Any, b: Any, shares: Floats, poses: Floats) -> Floats:
        """Return the poses with more of them where the motion bends or reverses, as a car's may."""
        flagged = np.arange(len(poses) - 1)
        for _ in range(HALVINGS):
            middle = 0.5 * (shares[flagged] + shares[flagged + 1])
            between = np.array([self._at(a, b, share) for share in middle.tolist()])
            first, last = poses[flagged][:, PLACE], poses[flagged + 1][:, PLACE]
            middles = between[:, PLACE]
            chord = np.linalg.norm(last - first, axis=1)
            to_first = np.linalg.norm(middles - first, axis=1)
            to_last = np.linalg.norm(last - middles, axis=1)
            via_middle = to_first + to_last
            # Who turns back near an end of a step has its middle on the chord, but not in the
            # middle of it.
            allowed = LONGER * via_middle + LEAST * self._step
            longer = (via_middle - chord > allowed) | (np.abs(to_first - to_last) > allowed)
            shares = np.insert(shares, flagged + 1, middle)
            poses = np.insert(poses, flagged + 1, between, axis=0)
            # Each middle has moved by those inserted before it, and both its sides are in question.
            at = (flagged + np.arange(len(flagged)))[longer]
            flagged = np.sort(np.concatenate([at, at + 1]))
            if not len(flagged):
                break
        return poses

    def _at(self, a: Any, b: Any, share: float) -> tuple[float, float, float, float]:
        self._space.interpolate(a, b, share, self._between)
        return self._point(self._between)

    def _point(self, state: Any) -> tuple[float, float, float, float]:
        if self._height is None:
            return *self.pose(state), 0.0
        height = self._height(state)
        try:
            z = float(height)
        except (TypeError, ValueError):
            z = math.nan
        if not math.isfinite(z):
            raise InputError(
                f"height gives {height!r} for a state; let it return the height in metres."
            )
        return *self.pose(state), z

    def _steps(self, poses: Floats) -> int:
        """Return into how many parts the longest step must be divided; 1 if it is short enough."""
        moved = np.diff(poses, axis=0)
        turn = np.abs(wrap_angles(moved[:, 2]))
        longest = float(np.linalg.norm(moved[:, PLACE], axis=1).max()) / self._step
        return math.ceil(max(longest, float(turn.max()) / MOST_TURN) * (1.0 - 1e-9))
