"""The search over place and belief, against all paths of small graphs and on the demo's floor."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.filter_kernel import FilterSettings, between, filter_room, filter_step
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.routes.route import Route
from ambinav_planners.belief.lost_search import search_within
from ambinav_planners.belief.lost_shortcuts import shortened
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.reference import reference_graph
from ambinav_planners.search.graph import MotionGraph
from tests.planners.small_graphs import graphs, paths_up_to, random_information

ENDS = (9.0, 21.0), (28.0, 17.0)
"""Of a route whose shortest way leads through the middle of the hall."""
RAW = LocalizerClass(name="raw", title="as computed", gain=0.2)
SETTINGS = FilterSettings(0.2, 1.0, 0.25, 0.2, 0.5, math.inf, math.radians(30.0))


def lost_on(graph: MotionGraph, forecaster: SimpleNamespace, motions: list[int]) -> float:
    """Share lost on a path, step by step."""
    cov, whole, outside, tracked = forecaster.start.copy(), forecaster.start.copy(), 0.0, 1.0
    room, predicted = filter_room(), np.empty((3, 3))
    for e in motions:
        a, b = graph.poses[[graph.source[e], graph.target[e]]].copy()
        a[2] = b[2] = math.atan2(b[1] - a[1], b[0] - a[0])
        outside, tracked = filter_step(
            a, b, cov, whole, outside, tracked, forecaster.field.fields, forecaster.field.lattice,
            forecaster.odometry.packed, forecaster.settings, predicted, room,
        )  # fmt: skip
    return float(between(outside, 1.0 - tracked))


@settings(max_examples=60, deadline=None)
@given(
    graph=graphs(6), seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.01, 0.05, 0.2, 0.6])
)
def test_between_the_shortest_paths_of_nearby_shares(
    graph: MotionGraph, seed: int, share: float
) -> None:
    """No path that keeps to the share is shorter, and one that keeps to far less is no longer."""
    forecaster = SimpleNamespace(
        field=random_information(np.random.default_rng(seed)), start=np.diag([0.01, 0.01, 0.003]),
        odometry=OdometryNoise(scale=1.0), settings=SETTINGS, localizer=RAW,
    )  # fmt: skip
    goal, longest = len(graph.poses) - 1, 6.0
    least, surely = math.inf, math.inf
    for motions in paths_up_to(graph, 0, goal, longest):
        length, lost = float(graph.length[motions].sum()), lost_on(graph, forecaster, motions)
        if lost <= share:
            least = min(least, length)
        if lost <= share / 3.0:
            surely = min(surely, length)
    found = search_within(graph, forecaster, 0, goal, share)  # type: ignore[arg-type]
    if found is None:
        assert surely == math.inf
        return
    assert lost_on(graph, forecaster, found.motions.tolist()) <= share * (1.0 + 1e-9)
    assert found.cost == pytest.approx(graph.length[found.motions].sum())
    if found.cost <= longest:
        assert found.cost >= least - 1e-9
    assert found.cost <= surely + 1e-9


@pytest.mark.slow
def test_a_smaller_share_is_a_longer_route(robot: RoutePlanner) -> None:
    forecaster = Forecaster(robot.service.map, "poor")
    problem = robot.problem(*ENDS, 0.0)
    graph = reference_graph(problem)
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    nodes = graph.cheapest(start, goal, 0.0)
    assert nodes is not None
    shortest = float(np.linalg.norm(np.diff(graph.poses[nodes, :2], axis=0), axis=1).sum())
    lengths = []
    for share in (0.999, 0.1, 0.02):
        path = search_within(graph, forecaster, start, goal, share)
        assert path is not None
        points = shortened(graph.poses[path.nodes, :2], problem.checker, forecaster, share)
        route = Route.through(points)
        assert problem.checker.motions_free(route.poses[:-1], route.poses[1:]).all()
        assert forecaster(route).lost_probability <= 1.1 * share
        assert len(points) < len(path.nodes)
        lengths.append(path.cost)
    assert lengths[0] == pytest.approx(shortest)
    assert lengths == sorted(lengths)
    assert search_within(graph, forecaster, start, goal, 0.02, longest=lengths[1]) is None
    assert search_within(graph, forecaster, start, goal, 0.02, most_labels=100) is None
