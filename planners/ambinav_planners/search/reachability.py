"""Reachability of the goal from the start, and the connected parts of the floor."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import shapely

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Floats, Ints32, Pose
from ambinav.runtime.errors import InputError
from ambinav_planners.problem import Problem
from ambinav_planners.search.lattice_graph import lattice_of
from ambinav_planners.search.widest_way import Narrowest, widest_way

# Sides of the polygons that stand for a quarter of a disc.
QUARTER_SIDES = 32
# Two places this near to a part of the floor, metres, lie in it.
NEAR = 1e-3


class NoPathError(InputError):
    """No path leads from start to goal.

    Attributes:
        labels: Which cells of the map are connected, int32, shape (rows, columns), -1 where the
            robot does not fit.
        start_label: Label of the cells that the start reaches; no cell may have it.
        goal_label: Label of the cells from which the goal is reached; no cell may have it.
        start: x, y (metres) and heading (radians) of the start, which may be a stop of a mission.
        goal: The same of the goal.
        narrowest: Narrowest place of the widest way between them, which is too narrow; None if no
            way was found even for a point, or if excluded floor is what closes it.
    """

    def __init__(
        self,
        message: str,
        labels: Ints32,
        start_label: int,
        goal_label: int,
        start: Pose,
        goal: Pose,
        narrowest: Narrowest | None = None,
    ) -> None:
        super().__init__(message)
        self.labels = labels
        self.start_label = start_label
        self.goal_label = goal_label
        self.start = start
        self.goal = goal
        self.narrowest = narrowest

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments that recreate the error in another process."""
        labels = self.labels, self.start_label, self.goal_label
        return NoPathError, (str(self), *labels, self.start, self.goal, self.narrowest)


_planar: WeakKeyDictionary[CollisionChecker, CollisionChecker] = WeakKeyDictionary()


def planar(checker: CollisionChecker) -> CollisionChecker:
    """Return a checker for straight motions in r2 of the largest disc within the footprint.

    Where that disc does not get through, the footprint does not either, whatever it does.
    """
    if checker.steering.space == "r2" and checker.footprint.is_disc:
        return checker
    checker_of_disc = _planar.get(checker)
    if checker_of_disc is None:
        disc = Footprint.disc(checker.footprint.inner)
        checker_of_disc = checker.for_robot(disc, Steering("r2"))
        _planar[checker] = checker_of_disc
    return checker_of_disc


def check_reachable(problem: Problem) -> None:
    """Raise if no path leads from start to goal for any planner.

    For a disc in r2 the test is exact, except for forbidden cells, which are tested on the lattice
    only. For other robots it tests whether the largest disc within the footprint gets through.

    Raises:
        NoPathError: there is none; the message gives the area of floor that each end reaches.
    """
    checker = planar(problem.checker)
    lattice = lattice_of(problem.service, checker)
    components = lattice.with_ends(problem.ends, checker).components()
    start, goal = (int(label) for label in components[-2:])
    closed = checker.has_forbidden
    if start == goal or (not closed and _in_one_part(checker, problem.ends)):
        return
    labels = lattice.labels(components)
    cell = problem.service.map.spacing**2
    areas = [float((labels == label).sum()) * cell for label in (start, goal)]
    remedy = (
        "exclude less floor (avoid_open, keep_out), or move one of them"
        if closed
        else "move one of them, or make the footprint smaller"
    )
    narrowest, where, needed = None, "", 2.0 * checker.footprint.outer
    if not closed:
        spacing = problem.service.map.spacing
        start_at, goal_at = problem.ends[:, :2]
        narrowest = widest_way(checker.geometry, start_at, goal_at, spacing)
    if narrowest is not None and narrowest.width < needed:
        where = (
            f" The widest way between them is {narrowest.width:.2f} m wide at "
            f"({narrowest.x:.2f}, {narrowest.y:.2f}); the robot needs {needed:.2f} m."
        )
    raise NoPathError(
        f"no path leads from the start {_place(problem.start)} to the goal {_place(problem.goal)} "
        f"for this robot: from the start it reaches {areas[0]:.1f} m^2, and the goal lies in "
        f"another part of {areas[1]:.1f} m^2; {remedy}.{where}",
        labels,
        start,
        goal,
        problem.start,
        problem.goal,
        narrowest if where else None,
    )


def _in_one_part(checker: CollisionChecker, ends: Floats) -> bool:
    """Return whether both ends lie in one part of the floor that a disc's centre can reach.

    The lattice misses channels that are narrower than its spacing; this does not.
    """
    radius = max(checker.footprint.outer - NEAR * 1e-3, NEAR * 1e-3)
    environment = checker.geometry
    floor = environment.free.buffer(-radius, quad_segs=QUARTER_SIDES)
    thin = environment.thin_walls
    if len(thin):
        lines = shapely.linestrings(thin.reshape(-1, 2, 2))
        walls = shapely.union_all(shapely.buffer(lines, radius, quad_segs=QUARTER_SIDES))
        floor = floor.difference(walls)
    parts = shapely.get_parts(floor)
    start, goal = shapely.points(ends[:, :2])
    return bool((shapely.dwithin(parts, start, NEAR) & shapely.dwithin(parts, goal, NEAR)).any())


def _place(pose: tuple[float, float, float]) -> str:
    return f"({pose[0]:.10g}, {pose[1]:.10g})"
