"""Routes of the searches on a made-up map: room, corridor and hall in a row."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import LOCALIZABLE
from ambinav.service.service import AmbiguityService
from ambinav_planners.belief import belief_route, limited_route, roadmap_route
from ambinav_planners.belief_roadmap import BeliefRoadmap, OdometryNoise
from ambinav_planners.belief_search import BeliefModel
from ambinav_planners.graph import MotionGraph
from ambinav_planners.information import Information
from tests.maps import synthetic
from tests.planners.small_graphs import graph_of

STEP = 0.5
START = np.diag([0.05, 0.05, 0.02]) ** 2


@pytest.fixture(scope="module")
def service() -> AmbiguityService:
    """The hall with landmarks along its lower side: the scan tells all below y = 3."""
    data = synthetic.dataset()
    told = (data["x"] > 16.0) & (data["y"] < 3.0) & data["free"]
    for name, value in (
        ("major", 0.1), ("minor", 0.1), ("major_radius", 0.025), ("minor_radius", 0.025),
        ("level", 0.1), ("zone", LOCALIZABLE),
    ):  # fmt: skip
        data[name] = data[name].where(~told, value).astype(data[name].dtype)
    return AmbiguityService(AmbiguityMap(data), weight=0.0)


@pytest.fixture(scope="module")
def hall() -> MotionGraph:
    """Nodes every half metre in the hall, joined to their eight neighbours; one node apart."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(16.5, 26, STEP), np.arange(0.5, 10, STEP)))
    poses = np.column_stack([np.append(x, 2.0), np.append(y, 2.0), np.zeros(len(x) + 1)])
    gap = np.abs(poses[:, np.newaxis, :2] - poses[np.newaxis, :, :2]).max(axis=2)
    source, target = np.nonzero((gap > 0.0) & (gap < 1.1 * STEP))
    return graph_of(poses, list(zip(source.tolist(), target.tolist(), strict=True)))


def node(graph: MotionGraph, x: float, y: float) -> int:
    return int(np.hypot(graph.poses[:, 0] - x, graph.poses[:, 1] - y).argmin())


def test_limited_route(service: AmbiguityService, hall: MotionGraph) -> None:
    # The hall's middle, 6 m across, is open; its rim is corridor, its corners are localizable.
    start, goal = node(hall, 17.0, 5.0), node(hall, 25.0, 5.0)
    ends = []
    for limit in (10.0, 5.0):
        route = limited_route(service, hall, start, goal, limit=limit, level=0.7)
        ends.append((route.length, route.zone_metres["open"]))
        assert route.planner == "limited"
        assert route.cost == pytest.approx(service.route_cost(route.poses, route.steering))
    assert ends[0][0] == pytest.approx(8.0)
    assert ends[0][1] > 5.5
    assert ends[1][0] > 8.5
    with pytest.raises(
        InputError, match=re.escape("more than 0.1 m in a row with level above 0.05")
    ):
        limited_route(service, hall, start, goal, limit=0.1, level=0.05)


def test_belief_route(service: AmbiguityService, hall: MotionGraph) -> None:
    start, goal = node(hall, 17.0, 5.0), node(hall, 25.0, 5.0)
    model = BeliefModel(std=0.05, odometry=0.2, weight=5.0)
    straight = belief_route(service, hall, start, goal, BeliefModel(weight=0.0))
    route = belief_route(service, hall, start, goal, model)
    assert straight.length == pytest.approx(8.0)
    assert route.length > 8.5
    assert route.zone_metres["open"] < 0.5 * straight.zone_metres["open"]
    assert route.covariances is not None
    assert route.covariances.shape == (len(route.poses), 3, 3)
    assert route.covariances[0, 0, 0] == pytest.approx(0.05**2)
    np.testing.assert_array_equal(route.covariances[:, 0, 0], route.covariances[:, 1, 1])
    np.testing.assert_array_equal(route.covariances[:, 2], 0.0)
    with pytest.raises(
        InputError, match=re.escape("no way keeps the standard deviation up to 0.06 m")
    ):
        belief_route(service, hall, start, goal, BeliefModel(std=0.05, odometry=0.2, max_std=0.06))


@pytest.mark.parametrize("exact", [True, False])
def test_roadmap_route(service: AmbiguityService, hall: MotionGraph, exact: bool) -> None:
    start, goal = node(hall, 17.0, 5.0), node(hall, 25.0, 5.0)
    information = Information.of(service.map)
    roadmap = BeliefRoadmap.of(hall, information, OdometryNoise(along=0.2, across=0.2))
    ends = []
    for weight in (0.0, 80.0):
        route = roadmap_route(service, roadmap, start, goal, START, weight=weight, exact=exact)
        assert route.covariances is not None
        assert np.linalg.eigvalsh(route.covariances).min() > 0.0
        np.testing.assert_allclose(route.covariances[0], START, rtol=1e-12)
        ends.append((route.length, math.sqrt(np.trace(route.covariances[-1, :2, :2]))))
    assert ends[0][0] == pytest.approx(8.0)
    assert ends[1][0] > ends[0][0]
    assert ends[1][1] < 0.9 * ends[0][1]
    with pytest.raises(
        InputError, match=re.escape("no way keeps the standard deviation up to 0.075 m")
    ):
        roadmap_route(service, roadmap, start, goal, START, max_std=0.075)


def test_no_way(service: AmbiguityService, hall: MotionGraph) -> None:
    start, goal = node(hall, 17.0, 5.0), len(hall.poses) - 1
    roadmap = BeliefRoadmap.of(hall, Information.of(service.map), OdometryNoise())
    for find in (
        lambda: limited_route(service, hall, start, goal, limit=5.0),
        lambda: belief_route(service, hall, start, goal, BeliefModel()),
        lambda: roadmap_route(service, roadmap, start, goal, START),
    ):
        with pytest.raises(InputError, match=r"no way leads from \(17, 5\) to \(2, 2\) m"):
            find()
    with pytest.raises(InputError, match="same place"):
        belief_route(service, hall, start, start, BeliefModel())
