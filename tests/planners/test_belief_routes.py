"""Belief-aware and limited routes on a made-up map: room, corridor and hall in a row."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import LOCALIZABLE
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners import NotFoundError, RoutePlanner
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.search.limit import longest_bad
from tests.maps import synthetic
from tests.planners.small_graphs import odometry

START, GOAL = (17.0, 5.0), (25.0, 5.0)
UNSURE = BeliefModel(start_std=(0.05, 0.05, 0.05), scan_distance=1.0)
ODOMETRY = odometry(along=0.2, drift=0.03)


@pytest.fixture(scope="module")
def service() -> AmbiguityService:
    """The hall with landmarks along its lower side: the scan tells all below y = 3."""
    data = synthetic.dataset()
    informative = (data["x"] > 16.0) & (data["y"] < 3.0) & data["free"]
    for name, value in (
        ("major", 0.1), ("minor", 0.1), ("major_radius", 0.025), ("minor_radius", 0.025),
        ("level", 0.1), ("zone", LOCALIZABLE),
    ):  # fmt: skip
        data[name] = data[name].where(~informative, value).astype(data[name].dtype)
    return AmbiguityService(AmbiguityMap(data), weight=20.0)


@pytest.mark.sweep
def test_a_limit_on_bad_metres_in_a_row_is_kept(service: AmbiguityService) -> None:
    # The hall's middle, 6 m across, is open; its rim is corridor, its corners are localizable.
    free = RoutePlanner(service).plan(START, GOAL, planner_name="reference", weight=0.0)
    robot = RoutePlanner(service, max_bad_metres=5.0, bad_level=0.7)
    kept = robot.plan(START, GOAL, planner_name="reference", weight=0.0)
    assert free.length == pytest.approx(8.0)
    assert kept.length > 8.3
    assert longest_bad(free.poses, service, free.steering, 0.7) > 5.5
    assert longest_bad(kept.poses, service, kept.steering, 0.7) <= 5.0 + 1e-6
    strict = RoutePlanner(service, max_bad_metres=0.1, bad_level=0.05)
    with pytest.raises(InputError, match=re.escape("at most 0.1 m in a row above level 0.05")):
        strict.plan(START, GOAL, planner_name="reference")


@pytest.mark.slow
def test_belief_search_goes_by_the_landmarks(service: AmbiguityService) -> None:
    robot = RoutePlanner(service, belief=UNSURE, odometry=ODOMETRY)
    straight = robot.plan(START, GOAL, planner_name="belief", weight=0.0)
    route = robot.plan(START, GOAL, planner_name="belief", weight=5.0)
    assert straight.length == pytest.approx(8.0, rel=1e-3)
    assert route.length > 8.5
    assert route.zone_metres["open"] < 0.5 * straight.zone_metres["open"]
    assert route.covariances is not None
    assert route.covariances.shape == (len(route.poses), 3, 3)
    assert route.covariances[0, 0, 0] == pytest.approx(0.05**2)
    np.testing.assert_array_equal(route.covariances[:, 0, 0], route.covariances[:, 1, 1])
    np.testing.assert_array_equal(route.covariances[:, 2], 0.0)
    timid = RoutePlanner(service, belief=replace(UNSURE, max_std=0.06), odometry=ODOMETRY)
    with pytest.raises(NotFoundError, match=r"standard deviation up to 0\.06 m") as caught:
        timid.plan(START, GOAL, planner_name="belief")
    # Its cost is another one than that of the bound.
    assert caught.value.bound == 0.0 and "costs less" not in str(caught.value)


def test_a_start_that_breaks_the_limit_is_refused_without_a_search(
    service: AmbiguityService, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("planners.belief_search", "planners.lattice_of"):
        monkeypatch.setattr(f"ambinav_planners.belief.{name}", None)
    monkeypatch.setattr("ambinav_planners.roadmap.grown_graph", None)
    lost = replace(UNSURE, start_std=(0.02, 0.3, 0.01), max_std=0.2)
    for name in ("belief", "belief-roadmap"):
        with pytest.raises(InputError, match=re.escape("start_std is 0.3 m, more than the 0.2 m")):
            RoutePlanner(service, belief=lost).plan(START, GOAL, planner_name=name, iterations=50)


@pytest.mark.slow
def test_belief_roadmap_ends_well_known(service: AmbiguityService) -> None:
    robot = RoutePlanner(service, belief=UNSURE, odometry=ODOMETRY)
    ends = []
    for weight in (0.0, 8.0):
        route = robot.plan(
            START,
            GOAL,
            planner_name="belief-roadmap",
            weight=weight,
            seconds=math.inf,
            iterations=800,
        )
        assert route.covariances is not None
        assert np.linalg.eigvalsh(route.covariances).min() > 0.0
        np.testing.assert_allclose(
            route.covariances[0], np.diag([0.05, 0.05, 0.05]) ** 2, rtol=1e-9
        )
        ends.append((route.length, math.sqrt(np.trace(route.covariances[-1, :2, :2]))))
    assert ends[0][0] == pytest.approx(8.0, rel=0.02)
    assert ends[1][0] > ends[0][0]
    assert ends[1][1] < 0.9 * ends[0][1]
