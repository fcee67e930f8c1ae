"""Shortest routes between random points, where no routes are planned.

Enough to ask of a building or of a scanner what a robot meets on its routes; planners that weigh
ambiguity, or know other robots than discs, are those of `ambinav_planners`.

The shortest path is found on a square lattice of places that the robot reaches (Dijkstra 1959),
and then tightened: from each of its points the robot drives straight to the farthest one that it
can, and the points that are left move to where the route is shorter. Floor where half of all
directions or more end in unknown space is no part of it: there the map ends, not the building.
Nothing of this knows a scanner, so that all are asked on the same routes.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from ambinav.casting.plane.fan import scan_plan
from ambinav.config import as_count
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.lattice import STEPS, Lattice
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.zones import UNEXPLORED
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats, Indices, Ints, Ints32
from ambinav.runtime.errors import InputError, InputWarning

PLANNER: Final = "shortest, sampled"
"""Who found these routes, as they say."""
STEP: Final = 0.1
"""Metres between places of the lattice, at least."""
MOST_PLACES: Final = 60_000
"""In a large building they lie so far apart that there are no more, about."""
LEAST_STEP: Final = 0.02
LEAST_GAIN: Final = 1e-4
"""Metres by which points of a route are moved at least, and by which that makes it shorter."""
NEAR: Final = 3.0
"""Steps from a position to the points of the graph that are tried as its neighbours."""
AROUND: Final = STEPS / np.hypot(*STEPS.T)[:, np.newaxis]
"""Moves of a route's point, in steps."""
DIRECTIONS: Final = 60
"""In which it is looked whether the map ends."""
_NOTABLE: Final = 0.95
"""Share of the places in the sampled piece of floor below which a note is given."""


@dataclass(frozen=True, eq=False)
class PlaceGraph:
    """Points that a disc reaches, and the straight motions between neighbours.

    Attributes:
        points: x, y, shape (N, 2), metres; all can be reached from each other.
        lengths: Metres from a place to each that it can go to straight on, (N, N), sparse.
        step: Metres between neighbours side by side.
        checker: Whether a motion is free.
    """

    points: Floats
    lengths: csr_matrix
    step: float
    checker: CollisionChecker

    @classmethod
    def of(cls, environment: Environment, reach: Reach, step: float | None = None) -> PlaceGraph:
        """Place points over the floor that a disc reaches.

        Args:
            environment: The building.
            reach: What the disc reaches.
            step: Metres between places; None: `STEP`, or more in a large building.

        Raises:
            InputError: there are no two places that can be reached from each other.

        Warns:
            InputWarning: some places cannot be reached from the others on this lattice.
        """
        if step is None:
            step = graph_step(reach)
        lattice = Lattice.over(environment, step)
        checker = CollisionChecker(environment, Footprint.disc(reach.radius), Steering("r2"))
        x, y = lattice.points
        usable = reach.reaches(x, y)
        usable[usable] = checker.poses_free(_poses(np.column_stack([x[usable], y[usable]])))
        usable[usable] = explored(environment, x[usable], y[usable])
        if usable.sum() < 2:
            raise _no_places(environment, reach, step)
        lattice = lattice.among(usable)
        points = np.column_stack(lattice.points)
        pairs = neighbour_pairs(lattice.index)
        pairs = pairs[checker.motions_free(*(_poses(points[pairs[:, end]]) for end in (0, 1)))]
        metres = np.hypot(*(points[pairs[:, 1]] - points[pairs[:, 0]]).T)
        count = len(points)
        one_way = csr_matrix((metres, pairs.T), shape=(count, count))
        both = one_way + one_way.T
        _, label = connected_components(both, directed=False)
        largest = label == np.bincount(label).argmax()
        if largest.sum() < 2:
            raise _no_places(environment, reach, step)
        if largest.mean() < _NOTABLE:
            warnings.warn(
                f"{environment.name}: routes are sampled on {100 * largest.mean():.0f} % of the "
                f"explored floor that the robot reaches; on places {step:.2g} m apart the rest is "
                "cut off; give routes of your own where it matters.",
                InputWarning,
                stacklevel=3,
            )
        return cls(points[largest], both[largest][:, largest].tocsr(), step, checker)

    def shortest(self, start: int, goal: int) -> Floats:
        """Return points, (M, 2), of the tightened shortest path between two points."""
        return self._shortened(self._path(start, goal))

    def between(self, start: tuple[float, float], goal: tuple[float, float]) -> Floats | None:
        """Return points, (M, 2), of the tightened shortest path between two positions.

        Args:
            start: x and y, metres.
            goal: Likewise.

        Returns:
            The path; None if one of them is not beside a point of the graph.
        """
        first, last = self._beside(start), self._beside(goal)
        if first is None or last is None:
            return None
        return self._shortened(np.concatenate([[start], self._path(first, last), [goal]]))

    def _path(self, start: int, goal: int) -> Floats:
        _, before = dijkstra(self.lengths, indices=start, return_predecessors=True)
        chain = [goal]
        while chain[-1] != start:
            chain.append(int(before[chain[-1]]))
        return self.points[chain[::-1]]

    def _beside(self, position: tuple[float, float]) -> int | None:
        """Return the nearest point to which a straight motion is free; None if none is near."""
        away = np.hypot(*(self.points - position).T)
        near = np.flatnonzero(away <= NEAR * self.step)
        near = near[np.argsort(away[near], kind="stable")]
        starts = _poses(np.tile(position, (len(near), 1)))
        free = self.checker.motions_free(starts, _poses(self.points[near]))
        return int(near[free.argmax()]) if free.any() else None

    def _shortened(self, points: Floats) -> Floats:
        return self._straightened(self._tightened(self._straightened(points)))

    def _straightened(self, points: Floats) -> Floats:
        poses = _poses(points)
        at, indices = 0, [0]
        while at < len(points) - 1:
            ahead = poses[at + 1 :]
            free = self.checker.motions_free(np.repeat(poses[at : at + 1], len(ahead), 0), ahead)
            free[0] = True
            at += 1 + int(np.flatnonzero(free)[-1])
            indices.append(at)
        return points[indices]

    def _tightened(self, points: Floats) -> Floats:
        """Move each inner point, one step at a time, while that shortens the route."""
        points, step = points.copy(), self.step
        while step > LEAST_STEP:
            moved = False
            for at in range(1, len(points) - 1):
                before, after = points[at - 1], points[at + 1]
                near = points[at] + step * AROUND
                length = np.hypot(*(near - before).T) + np.hypot(*(near - after).T)
                now = math.dist(points[at], before) + math.dist(points[at], after)
                good = np.flatnonzero(length < now - LEAST_GAIN)
                ends = [_poses(np.tile(end, (len(good), 1))) for end in (before, after)]
                free = self.checker.motions_free(ends[0], _poses(near[good]))
                free &= self.checker.motions_free(ends[1], _poses(near[good]))
                good = good[free]
                if good.size:
                    points[at], moved = near[good[length[good].argmin()]], True
            step = step if moved else 0.5 * step
        return points


def graph_step(reach: Reach, least: float = STEP) -> float:
    """Return metres between places of a graph over some floor: a least step, or more if large."""
    return max(least, math.sqrt(float(reach.floor.area) / MOST_PLACES))


def sample_routes(
    environment: Environment,
    reach: Reach,
    count: int,
    rng: np.random.Generator,
    *,
    step: float | None = None,
) -> tuple[Route, ...]:
    """Sample shortest routes between pairs of random points.

    Args:
        environment: The building.
        reach: What the robot, a disc, reaches in it.
        count: How many routes.
        rng: Draws the places, each as likely as any other of explored floor that is reached.
        step: As in `PlaceGraph.of`.

    Returns:
        Routes in "r2" whose figures nobody has measured (`ambinav.routes.evaluate`).

    Raises:
        InputError: fewer than one, or see `PlaceGraph.of`.
    """
    count = as_count(count, "routes")
    graph = PlaceGraph.of(environment, reach, step)
    routes = []
    for _ in range(count):
        start, goal = rng.choice(len(graph.points), 2, replace=False).tolist()
        routes.append(Route.through(graph.shortest(start, goal), planner=PLANNER))
    return tuple(routes)


def path_length(route: Route) -> float:
    """Return the length of a sampled route, of straight segments, metres."""
    return float(np.hypot(*np.diff(route.poses[:, :2], axis=0).T).sum())


def explored(environment: Environment, x: Floats, y: Floats) -> Bools:
    """Return whether fewer than half of all directions end in unknown space, at N points, (N,)."""
    xmin, ymin, xmax, ymax = environment.bounds
    angle = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    _, segment, _ = scan_plan(
        environment, x, y, np.zeros_like(x), np.zeros((DIRECTIONS, 2)), angle,
        math.hypot(xmax - xmin, ymax - ymin), incidence=False,
    )  # fmt: skip
    ends = ~environment.segments.walls
    return np.asarray((ends[segment] & (segment >= 0)).mean(axis=1) < UNEXPLORED)


def neighbour_pairs(index: Ints | Ints32) -> Indices:
    """Return pairs of adjacent points of a lattice, diagonals included, each once, shape (P, 2).

    Args:
        index: Number of each point, -1 where there is none, shape (rows, columns).
    """
    rows, columns = index.shape
    pairs = []
    for up, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        first = index[: rows - up, max(-right, 0) : columns - max(right, 0)]
        second = index[up:, max(right, 0) : columns + min(right, 0)]
        both = (first >= 0) & (second >= 0)
        pairs.append(np.column_stack([first[both], second[both]]))
    return np.concatenate(pairs).astype(np.intp)


def _poses(points: Floats) -> Floats:
    return np.column_stack([points, np.zeros(len(points))])


def _no_places(environment: Environment, reach: Reach, step: float) -> InputError:
    return InputError(
        f"{environment.name}: no two places {step:.2g} m apart that a robot of radius "
        f"{reach.radius:g} m reaches are explored and connected, so no route can be sampled; give "
        "routes of your own."
    )
