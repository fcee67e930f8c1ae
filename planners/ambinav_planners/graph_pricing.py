"""A route graph on a map: which edges a robot can drive, what they cost, and routes over them.

A route leaves its start straight to the nearest point of the graph that it sees, or to one hardly
farther away, follows edges in their direction, and leaves the graph for its goal likewise.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.routes.evaluate import PER_CELL, zone_codes
from ambinav.runtime.array_types import Bools, Floats, Indices, Ints32, Pose
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Planner, PlannerResult
from ambinav_planners.route_graph import RouteGraph
from ambinav_planners.search.alternatives import LEAST
from ambinav_planners.search.cheapest import cheapest_within
from ambinav_planners.search.graph import MotionGraph

# Metres between the points of an edge at which a route may join or leave it, at most.
JOIN_SPACING = 0.5
# A route may join the graph at points that are farther away than the nearest by this, metres.
JOIN_SLACK = 0.5
# Where an edge is missing, each node is tried with so many of the nearest beyond the gap.
NEIGHBOURS = 16


@dataclass(frozen=True, eq=False)
class PricedGraph:
    """A route graph on a map, for a robot.

    Attributes:
        graph: The graph as it was given.
        free: Edges that the robot can drive without a collision, bool, shape (E,).
        motions: The free edges, in pieces of at most `JOIN_SPACING`; the first nodes are the
            graph's.
        joints: Indices of the nodes of `motions` at which a route may join or leave, shape (J,).
    """

    graph: RouteGraph
    free: Bools
    motions: MotionGraph
    joints: Ints32
    _service: AmbiguityService
    _checker: CollisionChecker

    @classmethod
    def of(
        cls, graph: RouteGraph, service: AmbiguityService, checker: CollisionChecker
    ) -> PricedGraph:
        """Check and price the edges of a graph.

        Raises:
            InputError: the robot's space is not r2, or no edge is free.
        """
        if checker.steering.space != "r2":
            raise InputError(
                f"{graph.source}: a route graph is driven in the space r2, and the robot's is "
                f"{checker.steering.space}; give r2."
            )
        nodes = np.column_stack([graph.xy, np.zeros(len(graph.xy))])
        free: Bools = np.all(checker.poses_free(nodes)[graph.pairs], axis=1)
        free[free] = checker.motions_free(*nodes[graph.pairs[free].T])
        if not free.any():
            raise InputError(
                f"{graph.source}: the robot can drive none of its {len(free)} edges; give a graph "
                "in the map's frame, metres, off its walls, or a smaller robot."
            )
        poses, pairs = _in_pieces(nodes, np.unique(graph.pairs[free], axis=0))
        motions = MotionGraph.of_free(poses, pairs, service, checker.steering)
        # A polygon may pass where it cannot turn, and there it neither joins nor leaves.
        joints = np.unique(pairs)
        joints = joints[checker.poses_free(poses[joints])]
        return cls(graph, free, motions, joints, service, checker)

    def path(self, problem: Problem) -> Floats | None:
        """Return the waypoints of the cheapest route, shape (N, 3), or None if there is none.

        It keeps the problem's limit, if there is one.
        """
        graph = self._with_ends([problem.start], [problem.goal])
        count = len(graph.poses)
        nodes = (
            graph.cheapest(count - 2, count - 1, problem.service.weight)
            if problem.limit is None
            else cheapest_within(graph, problem, problem.limit)
        )
        if nodes is None:
            return None
        # Points at which an edge was only divided are left out.
        keeps = (nodes < len(self.graph.xy)) | (nodes >= len(self.motions.poses))
        keeps[[1, -2]] = True
        poses = graph.poses[nodes[keeps]]
        moved = np.r_[True, np.diff(poses[:, :2], axis=0).any(axis=1)]
        return graph.steering.oriented(poses[moved])

    @property
    def planner(self) -> Planner:
        """The planner that follows this graph; its routes are not improved off the graph."""

        def solve(problem: Problem, budget: Budget) -> PlannerResult:
            started = time.perf_counter()
            path = self.path(problem)
            return PlannerResult(path, finished=True, seconds=time.perf_counter() - started)

        text = "Dijkstra over the edges of a route graph"
        return Planner(
            "route-graph", solve, text, spaces=("r2",), uses_ompl=False, keeps_limit=True,
            uses_budget=False,
        )  # fmt: skip

    def costs_between(self, places: list[Pose], weight: float) -> Floats:
        """Return the costs of the cheapest routes between places, shape (K, K)."""
        graph, count = self._with_ends(places, places), len(places)
        nodes = np.arange(len(graph.poses) - 2 * count, len(graph.poses))
        matrix = graph.matrix(np.maximum(graph.cost(weight), LEAST))
        costs = dijkstra(matrix, indices=nodes[:count])
        between = np.asarray(costs[:, nodes[count:]], dtype=np.float64)
        np.fill_diagonal(between, 0.0)
        return between

    def why_not(self, problem: Problem) -> str:
        """Return the error of a problem without a route."""
        graph = self._with_ends([problem.start], [problem.goal])
        count, matrix = len(graph.poses), graph.matrix(np.ones_like(graph.length))
        ahead = np.isfinite(dijkstra(matrix, indices=count - 2, unweighted=True))
        behind = np.isfinite(dijkstra(matrix.T, indices=count - 1, unweighted=True))
        start, goal = (f"({x:.10g}, {y:.10g})" for x, y, _ in (problem.start, problem.goal))
        source, blocked = self.graph.source, int((~self.free).sum())
        blocked_text = f"{blocked} of {len(self.free)} edges are blocked for this robot"
        for name, reached, place in (("start", ahead, start), ("goal", behind, goal)):
            if reached.sum() == 1:
                return (
                    f"{source}: the {name} {place} sees no point of an edge that the robot can "
                    f"drive ({blocked_text}); add an edge near by, or move it."
                )
        if problem.limit is not None and ahead[count - 1]:
            return (
                f"{source}: no route over its edges keeps to at most {problem.limit.metres:g} m in "
                f"a row above {problem.limit.level:g}; allow more, or a higher level."
            )
        either = dijkstra(matrix, directed=False, indices=count - 2, unweighted=True)
        if np.isfinite(either[count - 1]):
            return (
                f"{source}: only against the direction of some edges do they lead from the start "
                f"{start} to the goal {goal}; add edges the other way, or turn those."
            )
        parts = [np.flatnonzero(reached[: len(self.graph.xy)]) for reached in (ahead, behind)]
        return (
            f"{source}: its edges do not lead from the start {start} to the goal {goal}: the start "
            f"leads to {len(parts[0])} of {len(self.graph.xy)} nodes, and {len(parts[1])} others "
            f"lead to the goal ({blocked_text}); {self._missing_edge(*parts)}."
        )

    def _missing_edge(self, ahead: Indices, behind: Indices) -> str:
        """Return advice on an edge from a node of the first to one of the second."""
        xy = self.graph.xy
        few = min(NEIGHBOURS, len(behind))
        gaps, nearest = (each.reshape(-1) for each in cKDTree(xy[behind]).query(xy[ahead], k=few))
        order = np.argsort(gaps, kind="stable")
        ends = np.column_stack([np.repeat(ahead, few), behind[nearest]])[order]
        poses = np.column_stack([xy, np.zeros(len(xy))])
        free = self._checker.motions_free(*poses[ends.T])
        if not free.any():
            (ax, ay), (bx, by) = xy[ends[0]]
            return (
                f"from ({ax:.10g}, {ay:.10g}) to ({bx:.10g}, {by:.10g}), {gaps[order[0]]:.1f} m, "
                "and between other nodes near each other the way is blocked; add nodes that lead "
                "around, or plan for a smaller robot"
            )
        k = int(free.argmax())
        (a, ax, ay), (b, bx, by) = ((self.graph.nodes[n]["id"], *xy[n]) for n in ends[k])
        return (
            f"add edges, such as from node {a} at ({ax:.10g}, {ay:.10g}) to node {b} at "
            f"({bx:.10g}, {by:.10g}), {gaps[order[k]]:.1f} m"
        )

    def priced(self, weight: float) -> RouteGraph:
        """Return the edges that are free, with costs at a weight for Nav2's Route Server.

        Their metadata has `length`, `exposure`, and `corridor` and `open`, metres in these zones,
        and as `penalty` the cost less the length.
        """
        service, steering = self._service.with_weight(weight), self._checker.steering
        poses = np.column_stack([self.graph.xy, np.zeros(len(self.graph.xy))])
        a, b = poses[self.graph.pairs.T]
        length, cost = steering.lengths(a, b), service.motion_costs(a, b, steering)
        figures = {
            "length": length,
            "exposure": service.motion_exposures(a, b, steering),
            "penalty": cost - length,
        }
        step = service.map.spacing / PER_CELL
        counts = np.where(self.free, np.ceil(length / step), 0.0).astype(np.intp)
        edge, place = _spread(counts)
        middle = a[edge] + ((place + 0.5) / counts[edge])[:, np.newaxis] * (b - a)[edge]
        middle[:, 2] = np.arctan2(*(b - a)[edge, 1::-1].T)
        codes = zone_codes(service.map, middle)
        each = length / np.maximum(counts, 1)
        for name, code in (("corridor", CORRIDOR), ("open", OPEN)):
            figures[name] = each * np.bincount(edge[codes == code], minlength=len(length))
        return self.graph.with_figures(self.free, cost, figures)

    def save(self, path: str | Path, weight: float | None = None) -> None:
        """Write `priced` at a weight; None: that of the service.

        Raises:
            InputError: the place is not writable, or the weight is no weight.
        """
        weight = self._service.weight if weight is None else weight
        self.priced(weight).save(path, weight)

    def _with_ends(self, starts: list[Pose], goals: list[Pose]) -> MotionGraph:
        """Return the motions with starts and then goals as the last nodes, joined straight."""
        count = len(self.motions.poses)
        poses = np.concatenate([self.motions.poses, starts, goals])
        pairs = [np.column_stack([self.motions.source, self.motions.target])]
        joints = self.motions.poses[self.joints]
        for k, end in enumerate(poses[count:], start=count):
            ends = np.broadcast_to(end, joints.shape).copy()
            leaves = k < count + len(starts)
            seen = self.joints[
                self._checker.motions_free(*((ends, joints) if leaves else (joints, ends)))
            ]
            away = np.hypot(*(self.motions.poses[seen] - end).T[:2])
            seen = seen[away <= away.min(initial=np.inf) + JOIN_SLACK]
            node = np.full(len(seen), k)
            pairs.append(np.stack([node, seen] if leaves else [seen, node], axis=-1))
        return MotionGraph.of_free(
            poses, np.concatenate(pairs).astype(np.int32), self._service, self.motions.steering
        )


def _in_pieces(nodes: Floats, pairs: Ints32) -> tuple[Floats, Ints32]:
    """Return the nodes with points that divide the edges, (M, 3), and the pieces, (P, 2)."""
    a, b = nodes[pairs.T]
    pieces = np.maximum(np.ceil(np.hypot(*(b - a).T[:2]) / JOIN_SPACING).astype(np.intp), 1)
    edge, place = _spread(pieces)
    last = place == pieces[edge] - 1
    share = ((place + 1) / pieces[edge])[~last, np.newaxis]
    inner = a[edge[~last]] + share * (b - a)[edge[~last]]
    target = pairs[edge, 1]
    target[~last] = np.arange(len(nodes), len(nodes) + len(inner))
    source = np.where(place == 0, pairs[edge, 0], np.roll(target, 1))
    return np.concatenate([nodes, inner]), np.column_stack([source, target]).astype(np.int32)


def _spread(counts: Indices) -> tuple[Indices, Indices]:
    """Return the group of each member and its index within the group, given the group sizes."""
    group = np.repeat(np.arange(len(counts)), counts)
    return group, np.arange(len(group)) - (np.cumsum(counts) - counts)[group]
