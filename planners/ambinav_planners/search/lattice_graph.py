"""The lattice of a map as a graph of free straight motions, in 32 directions.

Where the robot fits but no lattice point does, points of their own are added: along the middle of
channels that are hardly wider than the robot, and beside forbidden cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.runtime.array_types import Bools, Floats, Ints, Ints32
from ambinav.service.service import AmbiguityService
from ambinav_planners.floor import free_cells
from ambinav_planners.search.channels import channel_poses, edge_poses
from ambinav_planners.search.graph import MotionGraph, joined
from ambinav_planners.search.labels import reversed_graph
from ambinav_planners.search.lattice_motions import lattice_motions

# Added points are joined to what they see within so many spacings.
CHANNEL_REACH = 2.5
# The ends of a route are joined to what they see within this distance, metres; if there is nothing,
# within the next.
REACH = (0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, eq=False)
class LatticeGraph:
    """The free cells of a map and the motions between them.

    Attributes:
        graph: Its first nodes are the free cells, its last ones the points added to them.
        cell: int32, shape (rows, columns): node of a cell, -1 where the robot does not fit.
        service: Service for the cost per metre.
        parts: Into how many cells the edge of a cell of the map is divided.
        both_ways: Whether the way back of each motion is free too and costs the same.
    """

    graph: MotionGraph
    cell: Ints32
    service: AmbiguityService
    parts: int
    both_ways: bool

    @classmethod
    def build(
        cls, service: AmbiguityService, checker: CollisionChecker, parts: int = 1
    ) -> LatticeGraph:
        """Connect the cells of the service's map where the robot fits.

        Args:
            service: Its map gives the lattice.
            checker: For straight motions (r2). Channels are found for the disc around the
                footprint.
            parts: Into how many cells the edge of a cell of the map is divided.
        """
        xs, ys, free, spacing = _cells(service, parts)
        x, y = np.meshgrid(xs, ys)
        rows, columns = np.nonzero(free)
        poses = np.stack([x[rows, columns], y[rows, columns], np.zeros(len(rows))], axis=-1)
        fits = checker.poses_free(poses)
        rows, columns, poses = rows[fits], columns[fits], poses[fits]
        cell = np.full(x.shape, -1, dtype=np.int32)
        cell[rows, columns] = np.arange(len(rows), dtype=np.int32)
        graph = lattice_motions(poses, rows, columns, cell, spacing, service, checker)
        added = channel_poses(xs, ys, free, spacing, checker)
        if checker.has_forbidden:
            added = np.concatenate([added, edge_poses(xs, ys, free, spacing, checker)])
        if len(added):
            pairs = _pairs_near(poses, added, CHANNEL_REACH * spacing)
            poses = np.concatenate([poses, added])
            graph = joined(graph, MotionGraph.of_motions(poses, pairs, service, checker))
        both_ways = not (service.has_headings or checker.is_directed)
        return cls(graph, cell, service, parts, both_ways)

    @cached_property
    def into(self) -> tuple[Ints, Ints32, Ints]:
        """The motions by the nodes that they lead to, as `labels.reversed_graph` has them.

        Without numbers where each motion costs as much as its way back, which stands in its place.
        """
        if self.both_ways:
            return self.graph.first, self.graph.target, np.empty(0, dtype=np.int64)
        begin, source, motion = reversed_graph(self.graph.first, self.graph.target)
        return begin, source, motion

    def with_ends(self, ends: Floats, checker: CollisionChecker) -> MotionGraph:
        """Return the graph with more poses, (K, 3), as its last nodes; see `end_motions`."""
        return joined(self.graph, self.end_motions(ends, checker))

    def end_motions(self, ends: Floats, checker: CollisionChecker) -> MotionGraph:
        """Return the motions between more poses, (K, 3), and the cells in free line of sight.

        The poses are the last K nodes, after those of the lattice. They are joined to each other
        as well, if they see each other. The checker must be the one that the lattice was built
        with: it is not kept, so that a lattice can be kept for just as long as its checker lives.
        """
        cells = len(self.graph.poses)
        poses = np.concatenate([self.graph.poses, ends])
        pairs = [
            np.array([[i, j]], dtype=np.int32)
            for i in range(cells, len(poses))
            for j in range(i + 1, len(poses))
        ]
        for k, end in enumerate(ends):
            distance = np.hypot(*(self.graph.poses[:, :2] - end[:2]).T)
            for reach in REACH:
                near = np.flatnonzero(distance <= reach)
                end_poses, lattice_poses = np.tile(end, (len(near), 1)), self.graph.poses[near]
                free = checker.motions_free(end_poses, lattice_poses)
                if checker.is_directed:
                    free |= checker.motions_free(lattice_poses, end_poses)
                seen = near[free]
                if len(seen):
                    break
            pairs.append(np.stack([np.full(len(seen), cells + k), seen], axis=-1).astype(np.int32))
        return MotionGraph.of_motions(poses, np.concatenate(pairs), self.service, checker)

    def labels(self, components: Ints32) -> Ints32:
        """Return the component of every cell, int32, (rows, columns); -1 where nothing fits."""
        return np.where(self.cell >= 0, components[self.cell], np.int32(-1))


def _cells(service: AmbiguityService, parts: int) -> tuple[Floats, Floats, Bools, float]:
    """Return columns and rows of the subdivided lattice, which cells are free, and the spacing."""
    dataset = service.map.dataset
    spacing = service.map.spacing / parts
    offsets = (np.arange(parts) - 0.5 * (parts - 1)) * spacing
    x, y = (
        (dataset[axis].values.astype(np.float64)[:, np.newaxis] + offsets).ravel() for axis in "xy"
    )
    return x, y, free_cells(service.map, x, y), spacing


def _pairs_near(poses: Floats, added: Floats, reach: float) -> Ints32:
    """Return pairs of added points with each other and earlier poses, no pair twice."""
    tree, count = cKDTree(added[:, :2]), len(poses)
    among = tree.query_pairs(reach, output_type="ndarray") + count
    near = cKDTree(poses[:, :2]).query_ball_point(added[:, :2], reach, return_sorted=False)
    counts = np.array([len(each) for each in near], dtype=np.intp)
    source = np.repeat(np.arange(len(added)) + count, counts)
    target = np.array([node for each in near for node in each], dtype=np.intp)
    return np.concatenate([among, np.stack([source, target], axis=-1)]).astype(np.int32)


# A lattice serves every start, goal and weight; it lives as long as its checker.
_lattices: WeakKeyDictionary[CollisionChecker, list[LatticeGraph]] = WeakKeyDictionary()


def lattice_of(
    service: AmbiguityService, checker: CollisionChecker, parts: int = 1
) -> LatticeGraph:
    """Return the lattice graph of a service and checker, built once for all weights."""
    lattices = _lattices.setdefault(checker, [])
    for lattice in lattices:
        if lattice.parts == parts and _same_but_weight(lattice.service, service):
            return lattice
    lattices.append(LatticeGraph.build(service, checker, parts))
    return lattices[-1]


def _same_but_weight(a: AmbiguityService, b: AmbiguityService) -> bool:
    names = "layer", "power", "clearance_weight", "comfort", "outside_weight"
    same = all(getattr(a, name) == getattr(b, name) for name in names)
    return same and a.map is b.map and a.preferred is b.preferred
