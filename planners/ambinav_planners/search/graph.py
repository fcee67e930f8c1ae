"""A graph of free motions: lattice or roadmap, searched for any weight."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Bools, Floats, Floats32, Indices, Ints, Ints32
from ambinav.runtime.kernels import kernel

if TYPE_CHECKING:
    from ambinav.geometry.collision.checker import CollisionChecker
    from ambinav.service.service import AmbiguityService


class GraphArrays(NamedTuple):
    """The arrays of a `MotionGraph` for the kernels; see there."""

    first: Ints
    target: Ints32
    length: Floats32


@dataclass(frozen=True, eq=False)
class MotionGraph:
    """Poses, and the free motions between them with their costs.

    What the motions cost does not depend on the weight, so that one graph serves every weight:
    the cost of motion k at weight w is `fixed[k] + w * exposure[k]`.

    Attributes:
        poses: float64, shape (N, 3): x, y, theta.
        first: int64, shape (N + 1,): the motions from node n are first[n]:first[n + 1].
        target: int32, shape (E,): the node that a motion leads to.
        length: float32, shape (E,), metres.
        fixed: float32, shape (E,): the part of the cost without weight, at least the length; the
            same array where it is the length.
        exposure: float32, shape (E,): the integral of what the weight multiplies, metres.
        steering: The kind of motion.
    """

    poses: Floats
    first: Ints
    target: Ints32
    length: Floats32
    fixed: Floats32
    exposure: Floats32
    steering: Steering

    @classmethod
    def of_motions(
        cls, poses: Floats, pairs: Ints32, service: AmbiguityService, checker: CollisionChecker
    ) -> MotionGraph:
        """Keep the free motions, and measure them with the service's integral.

        Args:
            poses: Shape (N, 3); each must be free.
            pairs: Nodes to join, shape (P, 2), no pair twice in any order. They are joined both
                directions where the path back is the same; where it is not (robots whose way
                back is another, maps with headings in r2) each is checked and measured apart.
            service: Service for the cost per metre.
            checker: Collision checker of the robot, with its kind of motion.
        """
        steering = checker.steering
        one_way = checker.is_directed or (steering.space == "r2" and service.has_headings)
        if one_way:
            pairs = np.concatenate([pairs, pairs[:, ::-1]])
        pairs = pairs[checker.motions_free(poses[pairs[:, 0]], poses[pairs[:, 1]])]
        return cls.of_free(poses, pairs, service, steering, both_ways=not one_way)

    @classmethod
    def of_free(
        cls,
        poses: Floats,
        pairs: Ints32,
        service: AmbiguityService,
        steering: Steering,
        *,
        both_ways: bool = False,
    ) -> MotionGraph:
        """Measure motions that are known to be free.

        Args:
            poses: Shape (N, 3).
            pairs: Start and end node of each motion, shape (P, 2), no pair twice.
            service: Service for the cost per metre.
            steering: The kind of motion.
            both_ways: True: each motion is passable in the other direction too, at the same cost,
                and no pair is there twice in any order.
        """
        a, b = poses[pairs[:, 0]], poses[pairs[:, 1]]
        length = steering.lengths(a, b)
        exposure = service.motion_exposures(a, b, steering)
        is_length = service.plain is None
        fixed = length if is_length else service.with_weight(0.0).motion_costs(a, b, steering)
        source, target = pairs.T
        if both_ways:
            source, target = np.concatenate([source, target]), np.concatenate([target, source])
            length, exposure, fixed = (np.tile(part, 2) for part in (length, exposure, fixed))
        # Sorted by source with the cheap counting sort of a sparse matrix.
        count = len(poses)
        place = csr_matrix((np.arange(1, len(source) + 1), (source, target)), shape=(count, count))
        order = place.data - 1
        length = length[order].astype(np.float32)
        return cls(
            poses=poses,
            first=place.indptr.astype(np.int64),
            target=place.indices.astype(np.int32),
            length=length,
            fixed=length if is_length else fixed[order].astype(np.float32),
            exposure=exposure[order].astype(np.float32),
            steering=steering,
        )

    @property
    def arrays(self) -> GraphArrays:
        """The motions for the kernels."""
        return GraphArrays(self.first, self.target, self.length)

    @property
    def source(self) -> Ints32:
        """Start node of each motion, int32, shape (E,)."""
        return np.repeat(
            np.arange(len(self.poses), dtype=np.int32), np.diff(self.first).astype(np.intp)
        )

    def cost(self, weight: float) -> Floats:
        """Return the cost of every motion at a weight, shape (E,), metres-equivalent."""
        return np.float64(weight) * self.exposure + self.fixed

    def part(self, is_kept: Bools) -> MotionGraph:
        """Return the subgraph of some nodes, bool, shape (N,), in their order."""
        nodes = np.flatnonzero(is_kept)
        number = np.full(len(is_kept), -1, dtype=np.int32)
        number[nodes] = np.arange(len(nodes))
        first, motions = _motions_among(nodes, number, self.first, self.target)
        return replace(
            self._with_motions(first, motions, number[self.target[motions]]),
            poses=self.poses[nodes],
        )

    def without(self, dropped: Bools) -> MotionGraph:
        """Return the graph without some motions, bool, shape (E,)."""
        count = np.bincount(self.source[~dropped], minlength=len(self.poses))
        first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
        return self._with_motions(first, ~dropped, self.target[~dropped])

    def _with_motions(self, first: Ints, motions: NDArray[Any], target: Ints32) -> MotionGraph:
        """Return the graph with some of its motions, given by number or as a mask."""
        length = self.length[motions]
        return replace(
            self,
            first=first,
            target=target,
            length=length,
            fixed=length if self.fixed is self.length else self.fixed[motions],
            exposure=self.exposure[motions],
        )

    def matrix(self, values: Floats) -> csr_matrix:
        """Return values of the motions, shape (E,), as a sparse matrix from node to node."""
        count = len(self.poses)
        return csr_matrix((values, self.target, self.first), shape=(count, count))

    def components(self) -> Ints32:
        """Return the component number of each node, int32, shape (N,)."""
        _, labels = connected_components(self.matrix(np.ones_like(self.length)), directed=False)
        return np.asarray(labels, dtype=np.int32)

    def cheapest(self, start: int, goal: int, weight: float) -> Indices | None:
        """Return nodes of the cheapest path from `start` to `goal`, or None if there is none."""
        return self.cheapest_at(self.cost(weight), start, goal)

    def cheapest_at(self, cost: Floats, start: int, goal: int) -> Indices | None:
        """Return the result of `cheapest` for motion costs `cost`, shape (E,), at least 0."""
        costs = np.maximum(cost, 1e-12)  # scipy takes an explicit zero for no edge
        distance, before = dijkstra(self.matrix(costs), indices=start, return_predecessors=True)
        if not np.isfinite(distance[goal]):
            return None
        return walk_back(before, start, goal)


def walk_back(before: Ints32, start: int, goal: int) -> Indices:
    """Return nodes from `start` to `goal`, given the predecessors `before`, both included."""
    nodes = [goal]
    while nodes[-1] != start:
        nodes.append(int(before[nodes[-1]]))
    return np.array(nodes[::-1], dtype=np.intp)


def joined(graph: MotionGraph, added: MotionGraph) -> MotionGraph:
    """Join two graphs over the nodes of `added`, whose first nodes are those of `graph`."""
    begin = np.pad(graph.first, (0, len(added.poses) - len(graph.poses)), mode="edge")

    def merged(name: str) -> NDArray[Any]:
        a, b = getattr(graph, name), getattr(added, name)
        out = np.empty(len(a) + len(b), dtype=a.dtype)
        _merge(begin, a, added.first, b, out)
        return out

    length = merged("length")
    is_length = graph.fixed is graph.length and added.fixed is added.length
    return replace(
        added,
        first=begin + added.first,
        target=merged("target"),
        length=length,
        fixed=length if is_length else merged("fixed"),
        exposure=merged("exposure"),
    )


@kernel
def _merge(begin, a, more_begin, b, out):
    """Write the values of each node's motions of two graphs, one after the other."""
    e = 0
    for n in range(begin.size - 1):
        for k in range(begin[n], begin[n + 1]):
            out[e] = a[k]
            e += 1
        for k in range(more_begin[n], more_begin[n + 1]):
            out[e] = b[k]
            e += 1


@kernel
def _motions_among(nodes, number, first, target):
    """Return where each node's motions to others of them begin, and the numbers of these."""
    begin = np.zeros(nodes.size + 1, dtype=np.int64)
    for i in range(nodes.size):
        count = 0
        for e in range(first[nodes[i]], first[nodes[i] + 1]):
            if number[target[e]] >= 0:
                count += 1
        begin[i + 1] = begin[i] + count
    motions = np.empty(begin[nodes.size], dtype=np.int64)
    k = 0
    for i in range(nodes.size):
        for e in range(first[nodes[i]], first[nodes[i] + 1]):
            if number[target[e]] >= 0:
                motions[k] = e
                k += 1
    return begin, motions
