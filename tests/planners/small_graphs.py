"""Small graphs of motions, and all ways through them: what the searches are held against."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from ambinav.geometry.steering import Steering
from ambinav_planners.graph import MotionGraph
from ambinav_planners.information import Information


def graph_of(
    poses: NDArray[np.float64], pairs: list[tuple[int, int]], steering: Steering | None = None
) -> MotionGraph:
    """Motions both ways between the pairs of nodes, costing their length."""
    steering = steering or Steering()
    both = sorted({*pairs, *((b, a) for a, b in pairs)})
    source = np.array([a for a, _ in both], dtype=np.int64)
    target = np.array([b for _, b in both], dtype=np.int32)
    first = np.searchsorted(source, np.arange(len(poses) + 1)).astype(np.int64)
    length = steering.lengths(poses[source], poses[target])
    return MotionGraph(poses, first, target, length, length, np.zeros_like(length), steering)


def chain(x: NDArray[np.float64], steering: Steering | None = None) -> MotionGraph:
    """Nodes along the x axis, each joined to the next."""
    poses = np.column_stack([x, np.zeros((len(x), 2))])
    return graph_of(poses, [(k, k + 1) for k in range(len(x) - 1)], steering)


@st.composite
def graphs(draw: st.DrawFn, most: int = 7, steering: Steering | None = None) -> MotionGraph:
    """Connected graphs of up to `most` nodes in a square of 4 m, at least 0.6 m apart."""
    count = draw(st.integers(3, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    row, column = np.divmod(rng.permutation(16)[:count], 4)
    xy = np.column_stack([column, row]) + 0.5 + rng.uniform(-0.2, 0.2, (count, 2))
    poses = np.column_stack([xy, rng.uniform(-np.pi, np.pi, count)])
    pairs = [(int(rng.integers(k)), k) for k in range(1, count)]
    pairs += [(a, b) for a in range(count) for b in range(a) if rng.random() < 0.3]
    return graph_of(poses, pairs, steering)


def simple_ways(graph: MotionGraph, start: int, goal: int) -> Iterator[list[int]]:
    """Motions of every way that passes no node twice."""

    def go(node: int, seen: frozenset[int], motions: list[int]) -> Iterator[list[int]]:
        if node == goal:
            yield motions
            return
        for e in range(graph.first[node], graph.first[node + 1]):
            to = int(graph.target[e])
            if to not in seen:
                yield from go(to, seen | {to}, [*motions, e])

    yield from go(start, frozenset([start]), [])


def random_information(rng: np.random.Generator, most: float = 50.0) -> Information:
    """Positive semidefinite information over a square of 4 m, nothing in places."""
    root = rng.normal(size=(9, 9, 1, 2, 2)) * (rng.random((9, 9, 1, 1, 1)) < 0.6)
    told = root @ root.transpose(0, 1, 2, 4, 3)
    told *= most / max(float(told.max()), 1e-9)
    layers = (told[..., 0, 0], told[..., 0, 1], told[..., 1, 1], rng.uniform(0, most, (9, 9, 1)))
    weak = np.linalg.eigvalsh(told)[..., 0].clip(0.0)
    parts = [np.ascontiguousarray(v, dtype=np.float32) for v in (*layers, weak)]
    return Information(*parts, (0.0, 0.0), 0.5)


def even_information(told: float) -> Information:
    """The same in every direction and place, nothing about the heading."""
    plane = np.full((2, 2, 1), told, dtype=np.float32)
    none = np.zeros_like(plane)
    return Information(plane, none, plane, none, plane, (0.0, 0.0), 1.0)


def ways_up_to(graph: MotionGraph, start: int, goal: int, longest: float) -> Iterator[list[int]]:
    """Motions of every way of at most that many metres, nodes passed any number of times."""
    ahead = dijkstra(graph.matrix(graph.length).T, indices=goal)

    def go(node: int, gone: float, motions: list[int]) -> Iterator[list[int]]:
        if node == goal:
            yield motions
        for e in range(graph.first[node], graph.first[node + 1]):
            to = int(graph.target[e])
            if gone + graph.length[e] + ahead[to] <= longest:
                yield from go(to, gone + float(graph.length[e]), [*motions, e])

    yield from go(start, 0.0, [])
