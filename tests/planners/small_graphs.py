"""Small graphs of motions, and all paths through them: what the searches are held against."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.information_field import InformationField
from ambinav.geometry.motion.steering import Steering
from ambinav_planners.search.graph import MotionGraph


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
    count, seed = draw(st.integers(3, most)), draw(st.integers(0, 2**32 - 1))
    return drawn_graph(count, seed, steering)


def drawn_graph(count: int, seed: int, steering: Steering | None = None) -> MotionGraph:
    """The one of so many nodes and this seed."""
    rng = np.random.default_rng(seed)
    row, column = np.divmod(rng.permutation(16)[:count], 4)
    xy = np.column_stack([column, row]) + 0.5 + rng.uniform(-0.2, 0.2, (count, 2))
    poses = np.column_stack([xy, rng.uniform(-np.pi, np.pi, count)])
    pairs = [(int(rng.integers(k)), k) for k in range(1, count)]
    pairs += [(a, b) for a in range(count) for b in range(a) if rng.random() < 0.3]
    return graph_of(poses, pairs, steering)


def simple_paths(graph: MotionGraph, start: int, goal: int) -> Iterator[list[int]]:
    """Motions of every path that passes no node twice."""

    def go(node: int, seen: frozenset[int], motions: list[int]) -> Iterator[list[int]]:
        if node == goal:
            yield motions
            return
        for e in range(graph.first[node], graph.first[node + 1]):
            to = int(graph.target[e])
            if to not in seen:
                yield from go(to, seen | {to}, [*motions, e])

    yield from go(start, frozenset([start]), [])


def odometry(
    along: float = 0.0, drift: float = 0.0, turn: float = 0.0, slip: float = 0.0
) -> OdometryNoise:
    """Odometry by what it adds to the deviations: along the path and of the heading per root of a
    metre, of the heading and of the position (slip) per root of a radian turned."""
    alphas = {
        "alpha1": turn**2, "alpha2": drift**2 / 2.0, "alpha3": along**2, "alpha4": slip**2
    }  # fmt: skip
    return OdometryNoise(**alphas, scale=1.0, distance=1.0, angle=1.0)


def information_of(matrices: NDArray[np.float64], spacing: float) -> InformationField:
    """Information matrices, shape (rows, columns, 3, 3), of a map without headings."""
    position = matrices[..., :2, :2] - _shadow(matrices)
    parts = [matrices[..., i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    parts.append(np.linalg.eigvalsh(position)[..., 0].clip(0.0))
    entries = np.column_stack([values.ravel() for values in parts]).astype(np.float32)
    nearest = np.arange(len(entries), dtype=np.int32).reshape(*matrices.shape[:2], 1)
    return InformationField(nearest, entries, (0.0, 0.0), spacing)


def _shadow(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """What of the information about the position is lost if the heading is unknown."""
    shift, turn = matrices[..., :2, 2], matrices[..., 2, 2][..., np.newaxis, np.newaxis]
    both = shift[..., :, np.newaxis] * shift[..., np.newaxis, :]
    return np.divide(both, turn, out=np.zeros_like(both), where=turn > 0.0)


def random_information(rng: np.random.Generator, most: float = 50.0) -> InformationField:
    """Positive semidefinite information over a square of 4 m, nothing in places."""
    root = rng.normal(size=(9, 9, 3, 3)) * (rng.random((9, 9, 1, 1)) < 0.6)
    matrices = root @ root.transpose(0, 1, 3, 2)
    return information_of(matrices * most / max(float(matrices.max()), 1e-9), 0.5)


def even_information(value: float) -> InformationField:
    """The same in every direction and place, nothing about the heading."""
    return information_of(np.broadcast_to(np.diag([value, value, 0.0]), (2, 2, 3, 3)), 1.0)


def landmarks(value: float) -> InformationField:
    """Over 4 m x 2 m: as much in every direction above y = 0.75, nothing below."""
    out = np.zeros((9, 17, 3, 3))
    out[3:, :, 0, 0] = out[3:, :, 1, 1] = value
    return information_of(out, 0.25)


def paths_up_to(graph: MotionGraph, start: int, goal: int, longest: float) -> Iterator[list[int]]:
    """Motions of every path of at most that many metres, nodes passed any number of times."""
    ahead = dijkstra(graph.matrix(graph.length).T, indices=goal)

    def go(node: int, gone: float, motions: list[int]) -> Iterator[list[int]]:
        if node == goal:
            yield motions
        for e in range(graph.first[node], graph.first[node + 1]):
            to = int(graph.target[e])
            if gone + graph.length[e] + ahead[to] <= longest:
                yield from go(to, gone + float(graph.length[e]), [*motions, e])

    yield from go(start, 0.0, [])
