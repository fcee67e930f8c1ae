"""The search with a limit in a row, against all paths; and where motions are bad."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from ambinav.service.field import Field
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.limited_search import limited_search
from ambinav_planners.search.stretches import Stretches, bad_stretches
from tests.planners.small_graphs import chain, graph_of, graphs, simple_paths


def random_stretches(graph: MotionGraph, rng: np.random.Generator) -> Stretches:
    """Any stretches that can be: some motions good, some bad, some in parts."""
    length = graph.length
    kind = rng.integers(3, size=len(length))
    whole = kind == 0
    cut = np.sort(rng.random((len(length), 2)), axis=1)
    head = np.where(whole, length, np.where(kind == 1, 0.0, length * cut[:, 0]))
    tail = np.where(whole, length, np.where(kind == 1, 0.0, length * (1 - cut[:, 1])))
    inside = np.maximum(head, tail)
    return Stretches(head, tail, inside, whole)


def longest_in_a_row(stretches: Stretches, length: np.ndarray, motions: list[int]) -> float:
    run = most = 0.0
    for e in motions:
        if stretches.all_bad[e]:
            run += length[e]
            most = max(most, run)
        else:
            most = max(most, run + stretches.head[e], stretches.longest[e])
            run = stretches.tail[e]
    return float(most)


def exhaustive(
    graph: MotionGraph, cost: np.ndarray, s: Stretches, limit: float, start: int, goal: int
) -> float:
    """Least cost over (node, run) without any dominance: every reachable pair is its own state."""
    best: dict[tuple[int, float], float] = {(start, 0.0): 0.0}
    heap = [(0.0, start, 0.0)]
    while heap:
        spent, node, run = heapq.heappop(heap)
        if node == goal:
            return spent
        if spent > best[node, run]:
            continue
        for e in range(graph.first[node], graph.first[node + 1]):
            if run + s.head[e] > limit + 1e-9 or s.longest[e] > limit + 1e-9:
                continue
            left = float(run + graph.length[e]) if s.all_bad[e] else float(s.tail[e])
            state, total = (int(graph.target[e]), left), spent + float(cost[e])
            if total < best.get(state, math.inf):
                best[state] = total
                heapq.heappush(heap, (total, *state))
    return math.inf


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(graph=graphs(), seed=st.integers(0, 2**32 - 1), limit=st.floats(0.0, 6.0))
def test_cheapest_way_that_keeps_to_the_limit(graph: MotionGraph, seed: int, limit: float) -> None:
    rng = np.random.default_rng(seed)
    stretches = random_stretches(graph, rng)
    cost = graph.length * rng.uniform(1.0, 6.0, len(graph.length))
    goal = len(graph.poses) - 1
    path = limited_search(graph, cost, stretches, limit, 0, goal)
    least = exhaustive(graph, cost, stretches, limit, 0, goal)
    simple = [
        cost[motions].sum()
        for motions in simple_paths(graph, 0, goal)
        if longest_in_a_row(stretches, graph.length, motions) <= limit + 1e-9
    ]
    if path is None:
        assert least == math.inf
        assert not simple
        return
    assert path.cost == pytest.approx(least, rel=1e-12)
    assert path.cost <= min(simple, default=math.inf) + 1e-12
    assert path.cost == pytest.approx(cost[path.motions].sum(), rel=1e-12)
    assert longest_in_a_row(stretches, graph.length, path.motions.tolist()) <= limit + 1e-9
    assert path.nodes[0] == 0
    assert path.nodes[-1] == goal
    np.testing.assert_array_equal(graph.target[path.motions], path.nodes[1:])


@settings(max_examples=50, deadline=None)
@given(graph=graphs(12))
def test_no_limit_is_the_cheapest_way(graph: MotionGraph) -> None:
    stretches = random_stretches(graph, np.random.default_rng(0))
    goal = len(graph.poses) - 1
    path = limited_search(graph, graph.cost(2.0), stretches, math.inf, 0, goal)
    nodes = graph.cheapest(0, goal, 2.0)
    assert path is not None and nodes is not None
    assert path.cost == pytest.approx(
        np.linalg.norm(np.diff(graph.poses[nodes, :2], axis=0), axis=1).sum()
    )


def test_a_way_back_to_a_good_place_is_taken() -> None:
    # Node 1 is bad, node 3 beside it good: with 1.5 m in a row the robot must look in at 3.
    poses = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0.4, 0]], dtype=float)
    graph = graph_of(poses, [(0, 1), (1, 2), (1, 3)])
    whole = np.ones(len(graph.target), dtype=bool)
    stretches = Stretches(graph.length, graph.length, graph.length, whole)
    to_good = (graph.source == 3) | (graph.target == 3)
    stretches = Stretches(
        np.where(to_good, graph.length - 0.1 * (graph.source == 3), graph.length),
        np.where(to_good & (graph.target == 3), 0.0, graph.length),
        graph.length,
        ~to_good | (graph.source == 3),
    )
    path = limited_search(graph, graph.length, stretches, 1.5, 0, 2)
    assert path is not None
    assert path.nodes.tolist() == [0, 1, 3, 1, 2]
    assert limited_search(graph, graph.length, stretches, 1.3, 0, 2) is None


def test_it_goes_round_the_bad_hall() -> None:
    poses = np.array([[0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 3, 0]], dtype=float)
    graph = graph_of(poses, [(0, 1), (0, 2), (2, 3), (3, 1)])
    bad = ((graph.source + graph.target) == 1).astype(float) * graph.length
    stretches = Stretches(bad, bad, bad, bad > 0)
    for limit, nodes in ((4.0, [0, 1]), (3.9, [0, 2, 3, 1])):
        path = limited_search(graph, graph.length, stretches, limit, 0, 1)
        assert path is not None
        assert path.nodes.tolist() == nodes


def stripe(low: float, high: float) -> Field:
    """1 between low and high, falling to 0 within a cell there; both must lie between cells."""
    x = np.arange(0.0, 10.01, 0.1)
    value = np.clip(np.minimum((x - low) / 0.1 + 0.5, (high - x) / 0.1 + 0.5), 0.0, 1.0)
    values = np.repeat(value[np.newaxis, :, np.newaxis], 31, axis=0).astype(np.float32)
    return Field(np.ascontiguousarray(values), np.ones((31, 101), dtype=bool), (0.0, -1.5), 0.1)


def test_stretches_of_a_stripe() -> None:
    graph = chain(np.array([0.0, 2.0, 4.0, 6.0, 9.0]))
    stretches = bad_stretches(graph, stripe(3.05, 6.55), 0.5)
    forwards = graph.target > graph.source
    for name, ahead, back in (
        ("head", [0, 0, 2, 0.55], [0, 0.95, 2, 0]),
        ("tail", [0, 0.95, 2, 0], [0, 0, 2, 0.55]),
        ("longest", [0, 0.95, 2, 0.55], [0, 0.95, 2, 0.55]),
    ):
        found = getattr(stretches, name)
        np.testing.assert_allclose(found[forwards], ahead, atol=1e-5, err_msg=name)
        np.testing.assert_allclose(found[~forwards], back, atol=1e-5, err_msg=name)
    assert stretches.all_bad.sum() == 2


def test_a_bad_stretch_inside_of_a_motion() -> None:
    graph = chain(np.array([0.0, 9.0]))
    stretches = bad_stretches(graph, stripe(3.0, 6.5), 0.5)
    np.testing.assert_allclose(stretches.longest, 3.5, atol=1e-5)
    assert not stretches.head.any()
    assert not stretches.tail.any()
    assert not stretches.all_bad.any()


@pytest.mark.parametrize("space", ["dubins", "reeds-shepp", "se2"])
def test_stretches_along_curves(space: str) -> None:
    """Against points of `Steering.dense`, each taken whole."""
    steering = Steering(space, 0.0 if space == "se2" else 0.4)
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform(2.0, 8.0, 9), rng.uniform(-0.4, 0.4, 9), np.zeros(9)])
    poses[:, 2] = rng.uniform(-np.pi, np.pi, 9)
    graph = graph_of(poses, [(k, k + 1) for k in range(8)], steering)
    field = stripe(3.0, 6.5)
    stretches = bad_stretches(graph, field, 0.5)
    for e, (a, b) in enumerate(zip(graph.source, graph.target, strict=True)):
        dense, _, along = steering.dense(graph.poses[[a, b]], 0.002)
        bad = field.at(*dense.T.copy()) > 0.5
        total = np.diff(along)[bad[1:] & bad[:-1]].sum()
        ends = stretches.longest[e], stretches.head[e], stretches.tail[e]
        assert max(ends) <= total + 0.02
        assert stretches.head[e] == pytest.approx(
            along[-1] if bad.all() else along[np.argmin(bad)], abs=0.02
        )
        assert stretches.tail[e] == pytest.approx(
            along[-1] if bad.all() else along[-1] - along[::-1][np.argmin(bad[::-1])], abs=0.02
        )


def test_bad_input() -> None:
    graph = chain(np.array([0.0, 1.0]))
    none = Stretches(*np.zeros((3, 2)), np.zeros(2, dtype=bool))
    with pytest.raises(InputError, match="limit is -1"):
        limited_search(graph, graph.length, none, -1.0, 0, 1)
    with pytest.raises(InputError, match="cost holds -1"):
        limited_search(graph, -graph.length, none, 1.0, 0, 1)
    with pytest.raises(InputError, match="goal is node 2"):
        limited_search(graph, graph.length, none, 1.0, 0, 2)
    with pytest.raises(InputError, match="level is nan"):
        bad_stretches(graph, stripe(3.0, 6.0), math.nan)
