"""Course of a route for the follower: dense points, split where the robot reverses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambinav.geometry.frames import wrap_angles
from ambinav.geometry.motion.steering import REEDS_SHEPP, Steering, checked_poses
from ambinav.routes.clock import SPACING
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.errors import InputError

Arrays = tuple[Floats, Floats, Floats, Ints]


@dataclass(frozen=True, eq=False)
class Course:
    """Polyline of M points that a robot follows, in stretches driven forwards or backwards.

    Attributes:
        points: float64, shape (M, 2), metres, map frame; no two in a row are equal.
        along: Shape (M,): metres travelled up to each point.
        directions: Shape (M - 1,): 1 where the piece from a point to the next is driven forwards,
            -1 where backwards.
        end: int64, shape (M - 1,): of each piece the point where its stretch ends: the next cusp,
            or the last point.
        goal: x, y and heading at the end.
        turn: Sum of all turns, on the spot or on the path, radians.
        turns: Whether the robot is to look along the goal's heading when it gets there: the
            spaces other than r2 ask for it.
    """

    points: Floats
    along: Floats
    directions: Floats
    end: Ints
    goal: tuple[float, float, float]
    turn: float
    turns: bool

    @classmethod
    def of(cls, poses: Floats, steering: Steering, step: float = SPACING) -> Course:
        """Make the course of a route through poses, shape (N, 3).

        In the space se2 the robot, which cannot move sideways, looks along the travel on the path
        and along the goal's heading at its end.

        Raises:
            InputError: fewer than two poses, poses that are not usable, or no path between them.
        """
        route = checked_poses(poses, "poses")
        if len(route) < 2:
            raise InputError(f"poses has {len(route)} of them; a route needs a start and a goal.")
        dense, _, along = steering.dense(route, step)
        turn = float(np.abs(wrap_angles(np.diff(dense[:, 2]))).sum())
        # A vertex stands there for both motions that meet in it.
        keep = np.concatenate([[True], np.diff(dense[:, :2], axis=0).any(axis=1)])
        dense, along = dense[keep], along[keep]
        if len(dense) < 2:
            raise InputError("poses all lie at one point; a route needs some length.")
        steps = np.diff(dense[:, :2], axis=0)
        directions = np.ones(len(steps))
        if steering.kind == REEDS_SHEPP:
            ahead = 0.5 * np.diff(np.unwrap(dense[:, 2])) + dense[:-1, 2]
            directions[np.cos(ahead) * steps[:, 0] + np.sin(ahead) * steps[:, 1] < 0.0] = -1.0
        last = np.append(np.flatnonzero(np.diff(directions)) + 1, len(steps))
        end = last[np.searchsorted(last, np.arange(len(steps)), side="right")]
        x, y, theta = steering.oriented(route)[-1].tolist()
        return cls(
            np.ascontiguousarray(dense[:, :2]),
            along,
            directions,
            end.astype(np.int64),
            (x, y, theta),
            turn,
            steering.space != "r2",
        )

    @property
    def length(self) -> float:
        """Metres from start to goal."""
        return float(self.along[-1])

    @property
    def arrays(self) -> Arrays:
        """Arguments of the follower's kernels: points, along, directions, end."""
        return self.points, self.along, self.directions, self.end
