"""The search over nodes and deviations, against all paths and against closed forms."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.information_field import InformationField
from ambinav.runtime.errors import InputError
from ambinav_planners.belief.lattice_search import Growth, belief_search, std_along
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.search.graph import MotionGraph
from tests.planners.small_graphs import (
    chain,
    even_information,
    graph_of,
    graphs,
    landmarks,
    odometry,
    paths_up_to,
    random_information,
)

UNSURE = BeliefModel(start_std=(0.2, 0.2, 0.0), scan_distance=0.5, weight=2.0, reference=0.5)
DRIFT = odometry(along=0.2)


def priced(
    graph: MotionGraph, growth: Growth, model: BeliefModel, motions: list[int]
) -> tuple[float, float, float]:
    """Cost, largest and last deviation of a path, in plain Python."""
    p, cost, most = model.std**2, 0.0, model.std
    for e in motions:
        pieces = range(growth.first[e], growth.first[e + 1])
        for j in pieces:
            ends = [math.sqrt(p)]
            for _ in range(2):
                p = (p + growth.add[j]) / (1.0 + p * growth.shrink[j])
                ends.append(math.sqrt(p))
            mean = (ends[0] + 4.0 * ends[1] + ends[2]) / 6.0
            cost += graph.length[e] / len(pieces) * (1.0 + model.weight * mean / model.reference)
            most = max(most, ends[2])
    return cost, most, math.sqrt(p)


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    graph=graphs(6),
    seed=st.integers(0, 2**32 - 1),
    max_std=st.sampled_from([math.inf, 0.45, 0.35]),
    max_goal_std=st.sampled_from([math.inf, 0.3]),
)
def test_least_cost_of_all_ways(
    graph: MotionGraph, seed: int, max_std: float, max_goal_std: float
) -> None:
    information = random_information(np.random.default_rng(seed))
    model = replace(UNSURE, max_std=max_std, max_goal_std=max_goal_std)
    growth = Growth.of(graph, information, model, DRIFT)
    goal = len(graph.poses) - 1
    longest = 6.0
    least = math.inf
    for motions in paths_up_to(graph, 0, goal, longest):
        cost, most, last = priced(graph, growth, model, motions)
        if most <= max_std and last <= max_goal_std:
            least = min(least, cost)
    found = belief_search(graph, growth, model, 0, goal)
    if found is None:
        assert least == math.inf
        return
    cost, most, last = priced(graph, growth, model, found.path.motions.tolist())
    assert found.path.cost == pytest.approx(cost, rel=1e-12)
    assert found.std[-1] == pytest.approx(last, rel=1e-12)
    assert most <= max_std + 1e-12
    assert last <= max_goal_std + 1e-12
    if min(found.path.cost, least) <= longest:  # else the least path may be one of those left out
        assert found.path.cost == pytest.approx(least, rel=1e-12)
    else:
        assert found.path.cost <= least + 1e-9


@settings(max_examples=50, deadline=None)
@given(graph=graphs(14), seed=st.integers(0, 2**32 - 1), std=st.sampled_from([0.0, 0.3]))
def test_without_growth_and_scans_it_is_the_shortest_way(
    graph: MotionGraph, seed: int, std: float
) -> None:
    model = replace(UNSURE, start_std=(std, std, 0.0))
    information = even_information(0.0) if std else random_information(np.random.default_rng(seed))
    growth = Growth.of(graph, information, model, odometry())
    goal = len(graph.poses) - 1
    found = belief_search(graph, growth, model, 0, goal)
    nodes = graph.cheapest(0, goal, 0.0)
    assert found is not None and nodes is not None
    length = np.linalg.norm(np.diff(graph.poses[nodes, :2], axis=0), axis=1).sum()
    assert found.path.cost == pytest.approx(length * (1 + 2.0 * std / 0.5), rel=1e-9)
    np.testing.assert_allclose(found.std, std)


def test_growth_without_scans_is_a_root() -> None:
    x = np.array([0.0, 0.1, 1.0, 4.0])
    graph = chain(x)
    growth = Growth.of(graph, even_information(0.0), UNSURE, DRIFT)
    found = belief_search(graph, growth, UNSURE, 0, 3)
    assert found is not None
    np.testing.assert_allclose(found.std, np.sqrt(0.04 + 0.04 * x), rtol=1e-9)


@pytest.mark.parametrize("along", [0.0, 0.2])
def test_scans_against_the_differential_equation(along: float) -> None:
    """Deviation and cost against a solver, over 3 m with 8 per square metre and scan."""
    graph = chain(np.array([0.0, 3.0]))
    growth = Growth.of(graph, even_information(8.0), UNSURE, odometry(along=along))
    found = belief_search(graph, growth, UNSURE, 0, 1)

    def slope(_: float, state: np.ndarray) -> list[float]:
        p = state[0]
        return [along**2 - 8.0 / 0.5 * p * p, 1.0 + 2.0 * math.sqrt(p) / 0.5]

    solved = solve_ivp(slope, (0.0, 3.0), [0.04, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert found is not None
    assert found.std[-1] == pytest.approx(math.sqrt(solved[0]), rel=1e-7)
    assert found.path.cost == pytest.approx(solved[1], rel=1e-5)


def test_the_cut_into_motions_does_not_matter() -> None:
    ends = []
    for count in (2, 5, 40):
        graph = chain(np.linspace(0.0, 3.0, count))
        growth = Growth.of(graph, even_information(5.0), UNSURE, DRIFT, step=0.7)
        forwards = np.flatnonzero(graph.target > graph.source)
        ends.append(std_along(growth, forwards, 0.5)[-1])
    np.testing.assert_allclose(ends, ends[0], rtol=1e-12)


def test_rate_is_the_limit_of_scans_one_by_one() -> None:
    """A Kalman filter that grows and updates every scan_distance, for scans that tell little."""
    model = replace(UNSURE, scan_distance=0.05)
    graph = chain(np.array([0.0, 4.0]))
    growth = Growth.of(graph, even_information(0.5), model, DRIFT)
    p = model.std**2
    for _ in range(80):
        p += 0.2**2 * 0.05
        p = 1.0 / (1.0 / p + 0.5)
    assert std_along(growth, np.array([0]), model.std)[-1] == pytest.approx(math.sqrt(p), rel=0.02)


def two_paths() -> tuple[MotionGraph, InformationField]:
    """4 m straight on where nothing tells, or 6 m along landmarks above y = 0.75."""
    poses = np.array([[0, 0, 0], [4, 0, 0], [0, 1, 0], [4, 1, 0]], dtype=float)
    graph = graph_of(poses, [(0, 1), (0, 2), (2, 3), (3, 1)])
    return graph, landmarks(100.0)


def test_the_way_by_the_landmarks() -> None:
    graph, information = two_paths()
    for weight, nodes in ((0.0, [0, 1]), (5.0, [0, 2, 3, 1])):
        model = BeliefModel(
            start_std=(0.2, 0.2, 0.0), scan_distance=1.0, weight=weight, reference=0.3
        )
        growth = Growth.of(graph, information, model, odometry(along=0.3))
        found = belief_search(graph, growth, model, 0, 1)
        assert found is not None
        assert found.path.nodes.tolist() == nodes
    assert found.std.max() < 0.4


@pytest.mark.parametrize("limit", ["max_std", "max_goal_std"])
def test_limits_force_the_way_by_the_landmarks(limit: str) -> None:
    graph, information = two_paths()
    model = BeliefModel(start_std=(0.2, 0.2, 0.0), scan_distance=1.0, weight=0.0)
    growth = Growth.of(graph, information, model, odometry(along=0.3))
    found = belief_search(graph, growth, replace(model, **{limit: 0.4}), 0, 1)
    assert found is not None
    assert found.path.nodes.tolist()[-2:] == [3, 1]
    assert found.std[-1] <= 0.4
    # For the goal's sake alone it may as well go straight on first and look up the landmarks then.
    assert found.path.cost == pytest.approx(6.0)
    assert limit == "max_goal_std" or found.path.nodes.tolist() == [0, 2, 3, 1]
    assert belief_search(graph, growth, replace(model, **{limit: 0.1}), 0, 1) is None


@pytest.mark.slow
def test_growth_is_what_dead_reckoning_adds_from_scan_to_scan() -> None:
    """The covariance of driving straight on in many small steps, divided by the distance."""
    for noise in (OdometryNoise(), OdometryNoise(alpha2=2.0, scale=0.5)):
        poses = np.zeros((2001, 3))
        poses[:, 0] = np.linspace(0.0, 2.0, len(poses))
        covariance = np.zeros((1, 3, 3))
        for before, after in itertools.pairwise(poses):
            covariance = noise.spread(before[None], covariance, before[None], after[None])
        worse = float(np.linalg.eigvalsh(covariance[0, :2, :2])[1])
        assert noise.growth(2.0) == pytest.approx(worse / 2.0, rel=1e-3)


def test_another_odometry_is_another_prediction() -> None:
    graph = chain(np.array([0.0, 4.0]))
    ends = []
    for noise in (OdometryNoise(scale=0.1), OdometryNoise(scale=0.5)):
        growth = Growth.of(graph, even_information(8.0), UNSURE, noise)
        ends.append(std_along(growth, np.array([0]), 0.2)[-1])
    assert ends[1] > 1.5 * ends[0]


@settings(max_examples=30, deadline=None)
@given(graph=graphs(14), seed=st.integers(0, 2**32 - 1))
def test_tolerance_costs_little(graph: MotionGraph, seed: int) -> None:
    growth = Growth.of(graph, random_information(np.random.default_rng(seed)), UNSURE, DRIFT)
    goal = len(graph.poses) - 1
    exact = belief_search(graph, growth, UNSURE, 0, goal)
    quick = belief_search(graph, growth, UNSURE, 0, goal, tolerance=0.02)
    assert exact is not None and quick is not None
    assert exact.path.cost - 1e-12 <= quick.path.cost <= 1.01 * exact.path.cost
    assert quick.path.labels <= exact.path.labels


@pytest.mark.parametrize(
    ("name", "value"),
    [("start_std", (0.1, -1.0, 0.1)), ("start_std", (0.1, 0.1)),
     ("start_std", (0.1, 0.1, math.nan)), ("weight", -0.1), ("scan_distance", 0.0),
     ("reference", 0.0), ("max_std", 0.0), ("max_goal_std", -1.0)],
)  # fmt: skip
def test_bad_model(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=f"{name} is"):
        BeliefModel(**{name: value})


def test_bad_input() -> None:
    graph = chain(np.array([0.0, 1.0]))
    growth = Growth.of(graph, even_information(1.0), UNSURE, DRIFT)
    with pytest.raises(InputError, match="tolerance is -1"):
        belief_search(graph, growth, UNSURE, 0, 1, tolerance=-1.0)
    with pytest.raises(InputError, match="start is node -1"):
        belief_search(graph, growth, UNSURE, -1, 1)
    with pytest.raises(InputError, match="step is 0"):
        Growth.of(graph, even_information(1.0), UNSURE, DRIFT, step=0.0)
