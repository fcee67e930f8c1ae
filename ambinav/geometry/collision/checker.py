"""Collision checks of a robot's footprint at poses and along motions, with the reason in words."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from ambinav.config import check_kind
from ambinav.geometry.collision.forbidden import is_forbidden
from ambinav.geometry.collision.obstacles import Arrays, pack
from ambinav.geometry.collision.sweep import motion_free as motion_free
from ambinav.geometry.collision.sweep import motions_free as _motions_free
from ambinav.geometry.collision.sweep import pose_free as pose_free
from ambinav.geometry.collision.sweep import poses_free as _poses_free
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import FACING, Steering, checked_poses
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.threads import run_rows

# Spacing of the points that `nearest_free` tries, first everywhere, then near the best of
# those, metres.
COARSE, FINE = 0.1, 0.01
# A point outside of the free space this near to its border is said to be in the wall itself.
WALL_DEPTH = 0.3
# A point this near to a fitted segment, metres, lies on it.
SAME_LINE = 1e-6
BLOCK = 20_000


class CollisionChecker:
    """Checker of free poses and motions of a footprint in an environment.

    A pose is free if the reference point lies in the free space, in no forbidden cell, and no
    segment (a wall, a wall without thickness, or the frontier to unknown space) touches the
    footprint. A motion is free if that holds all along it.

    Segments and free space are those of `Environment.collision`: in an occupancy map no footprint
    covers any part of an occupied cell. Only a simulated world, whose walls are those of rays, is
    checked against the fitted segments.

    - A disc of radius r is free at a clearance of r, to 1e-9 m (as `Environment.is_free`). All its
      motions are checked exactly, to the same.
    - A polygon that keeps its heading is checked exactly. One that turns as it moves may be called
      blocked within 1 mm of a wall (`polygon_sweep.SKIN`), never free where it is not.
    - In the space r2 the robot turns on the spot between two motions. A pose of a polygon is free
      there only if the polygon can turn full circle; between poses only its outline counts.

    Args:
        environment: The environment.
        footprint: The footprint.
        steering: Kind of motion between two poses.
        forbidden: Cells that the reference point may not enter, bool, shape (rows, columns),
            row 0 at the smallest y; beyond them nothing is forbidden. Along arcs they are checked
            to a hundredth of a cell.
        origin: x and y of the centre of forbidden[0, 0], metres.
        spacing: Edge of a forbidden cell, metres.
        simulated: Check collisions with the walls of rays, for simulated robots; not for planning.

    Attributes:
        geometry: Collision geometry: `environment.collision`, or `environment`.
        has_forbidden: True if any cell is forbidden.
        is_directed: True if a motion may be free and its way back not: of a car that only drives
            forwards, and in r2, where the robot faces its travel, of a polygon that half a turn
            changes.
        arrays: Last arguments of the kernels `motion_free` and `pose_free`.

    Raises:
        InputError: the forbidden cells are not a grid in a place, or the environment does not
            know its occupied cells (`AmbiguityMap.environment`).
    """

    def __init__(
        self,
        environment: Environment,
        footprint: Footprint,
        steering: Steering,
        *,
        forbidden: Bools | None = None,
        origin: tuple[float, float] = (0.0, 0.0),
        spacing: float = 1.0,
        simulated: bool = False,
    ) -> None:
        check_kind(environment, Environment, "environment")
        check_kind(footprint, Footprint, "footprint", "give a Footprint, such as Footprint.disc")
        check_kind(steering, Steering, "steering")
        forbidden = None if forbidden is None else np.asarray(forbidden, dtype=np.bool_)
        self.environment = environment
        self.geometry = environment if simulated else environment.collision
        self.has_forbidden = forbidden is not None and bool(forbidden.any())
        self.footprint = footprint
        self.steering = steering
        self.must_turn = steering.kind == FACING and not footprint.is_disc
        self.is_directed = steering.space == "dubins" or (
            self.must_turn and not footprint.is_symmetric
        )
        self._place: dict[str, Any] = {
            "forbidden": forbidden, "origin": origin, "spacing": spacing, "simulated": simulated,
        }  # fmt: skip
        self.arrays: Arrays = pack(
            self.geometry, footprint, self.must_turn, forbidden, origin, spacing
        )

    def for_robot(self, footprint: Footprint, steering: Steering) -> CollisionChecker:
        """Return a checker of another robot among the same walls and forbidden cells."""
        return CollisionChecker(self.environment, footprint, steering, **self._place)

    def __repr__(self) -> str:
        """Return the environment, the footprint and the steering as text."""
        return f"CollisionChecker({self.environment!r}, {self.footprint!r}, {self.steering!r})"

    def poses_free(self, poses: ArrayLike) -> Bools:
        """Return whether each pose, shape (N, 3), metres and radians, is free; bool, shape (N,).

        Raises:
            InputError: the poses are not of that shape or not finite.
        """
        rows = checked_poses(poses, "poses")
        out = np.empty(len(rows), dtype=np.bool_)
        run_rows(_poses_free, len(rows), rows, *self.arrays, out, least=256)
        return out

    def motions_free(self, a: ArrayLike, b: ArrayLike) -> Bools:
        """Return whether each motion from a free pose of a to a pose of b is free; shape (N,).

        Args:
            a: Starts, shape (N, 3), metres and radians; they are assumed to be free.
            b: Ends, shape (N, 3).

        Raises:
            InputError: the poses are not of that shape, not finite, or not equally many.
        """
        starts, ends = checked_poses(a, "a"), checked_poses(b, "b")
        if len(starts) != len(ends):
            raise InputError(f"a has {len(starts)} poses and b {len(ends)}; give as many of each.")
        out = np.empty(len(starts), dtype=np.bool_)
        run_rows(
            _motions_free, len(starts), self.steering.kind, self.steering.kernel_radius, starts,
            ends, *self.arrays, out, least=64,
        )  # fmt: skip
        return out

    def clearance(self, poses: ArrayLike) -> Floats:
        """Compute the distance of the footprint at each pose, (N, 3), to a segment, metres, (N,).

        0 where it touches one; poses outside of the free space count like the others. A polygon
        is taken at its pose's heading.
        """
        rows = checked_poses(poses, "poses")
        if self.footprint.is_disc:
            away = np.asarray(self.geometry.clearance(rows[:, 0], rows[:, 1]))
            return np.asarray(np.maximum(away - self.footprint.radius, 0.0))
        _, distance = self._walls.query_nearest(
            self.footprint.placed(rows), all_matches=False, return_distance=True
        )
        return np.asarray(distance, dtype=np.float64)

    def nearest_free(
        self, x: float, y: float, theta: float = 0.0
    ) -> tuple[float, float, float, float] | None:
        """Find the nearest position at this heading where the footprint fits.

        Found among points 0.1 m apart and then 0.01 m apart around the nearest of those: a
        pocket smaller than 0.1 m may be missed, and the distance is right to about 0.02 m.

        Returns:
            x, y, theta and the distance to it, metres and radians; None if it fits nowhere. A
            free place is its own nearest one.
        """
        here = checked_poses([[x, y, theta]], "pose")
        if self.poses_free(here)[0]:
            return float(x), float(y), float(theta), 0.0
        xmin, ymin, xmax, ymax = self.geometry.bounds
        coarse = self._nearest_on(here[0], xmin, ymin, xmax, ymax, COARSE)
        if coarse is None:
            return None
        fine = self._nearest_on(
            here[0], coarse[0] - COARSE, coarse[1] - COARSE, coarse[0] + COARSE, coarse[1] + COARSE,
            FINE,
        )  # fmt: skip
        best = min((p for p in (coarse, fine) if p is not None), key=lambda place: place[3])
        return best

    def why_not(self, x: float, y: float, theta: float = 0.0) -> str | None:
        """Return why a pose is not free, to follow "is": "in unknown space", say, or None."""
        pose = checked_poses([[x, y, theta]], "pose")
        if self.poses_free(pose)[0]:
            return None
        xmin, ymin, xmax, ymax = self.environment.bounds
        if not (xmin <= x <= xmax and ymin <= y <= ymax):
            return (
                f"outside of the map, which reaches from ({xmin:.2f}, {ymin:.2f}) "
                f"to ({xmax:.2f}, {ymax:.2f})"
            )
        point = shapely.Point(x, y)
        nearest = int(self._walls.nearest(point))
        gap = float(self._walls.geometries[nearest].distance(point))
        unknown = self._is_unknown(shapely.shortest_line(point, self._walls.geometries[nearest]))
        blocker = "unknown space" if unknown else "a wall"
        if not self.geometry.is_free(x, y):
            if self.environment.is_free(x, y):
                return "among cells that the map calls occupied"
            if unknown:
                return "in unknown space"
            if gap <= WALL_DEPTH:
                return f"in a wall, {gap:.2g} m deep"
            return f"behind a wall, {gap:.2f} m from the free space"
        table, _, forbidden = self.arrays
        if is_forbidden(x, y, table, forbidden):
            return "in a forbidden zone"
        need = self.footprint.outer
        if self.footprint.is_disc:
            return f"{_metres(gap, need)} from {blocker}, the footprint needs {need:g} m"
        if self.must_turn:
            away = f"{_metres(gap, need)} from {blocker}"
            return f"{away}, the footprint needs {need:.3f} m to turn on the spot"
        return f"{_metres(gap, need)} from {blocker}, which the footprint touches at this heading"

    def _is_unknown(self, line: shapely.LineString) -> bool:
        """Return whether a line to the nearest obstacle ends at the frontier to unknown space."""
        segments = self.environment.segments
        lines = shapely.linestrings(segments.xy.reshape(-1, 2, 2))
        away = shapely.distance(lines, shapely.get_point(line, -1))
        k = int(away.argmin())
        return bool(away[k] <= SAME_LINE and segments.kind[k] == FRONTIER)

    @cached_property
    def _walls(self) -> shapely.STRtree:
        return shapely.STRtree(shapely.linestrings(self.geometry.segments.xy.reshape(-1, 2, 2)))

    def _nearest_on(
        self, pose: Floats, xmin: float, ymin: float, xmax: float, ymax: float, step: float
    ) -> tuple[float, float, float, float] | None:
        """Find the nearest free pose on a lattice over a box."""
        gx, gy = np.meshgrid(np.arange(xmin, xmax + step, step), np.arange(ymin, ymax + step, step))
        xy = np.column_stack([gx.ravel(), gy.ravel()])
        distance = np.hypot(xy[:, 0] - pose[0], xy[:, 1] - pose[1])
        order = np.argsort(distance)
        for low in range(0, len(order), BLOCK):
            candidates = order[low : low + BLOCK]
            poses = np.column_stack([xy[candidates], np.full(len(candidates), pose[2])])
            free = np.flatnonzero(self.poses_free(poses))
            if len(free):
                k = candidates[free[0]]
                return float(xy[k, 0]), float(xy[k, 1]), float(pose[2]), float(distance[k])
        return None


def _metres(gap: float, need: float) -> str:
    """Format a distance below `need` with enough digits to read as neither 0 nor `need`."""
    for digits in range(2, 7):
        shown = round(gap, digits)
        if 0.0 < shown < round(need, digits):
            return f"{shown:.{digits}f} m"
    return f"{gap:.3g} m"
