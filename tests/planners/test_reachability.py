"""Whether a path leads there at all: exact for discs, and drawn as it is."""

from __future__ import annotations

import functools
import math
import pickle
from itertools import pairwise

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.geometry.footprint import Footprint
from ambinav.runtime.errors import InputError
from ambinav_planners import NoPathError, NotFoundError, RoutePlanner
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.search.widest_way import Narrowest, widest_way
from tests.planners.conftest import LASER


@functools.cache
def building(door: float, thin: bool = False) -> RoutePlanner:
    """Two rooms of 4 by 4 m, joined by a door in the middle of a wall at x = 4."""
    floor = shapely.box(0, 0, 8, 4)
    low, high = 2.0 - door / 2.0, 2.0 + door / 2.0
    walls = []
    if thin:
        walls = [shapely.LineString([(4, 0), (4, low)]), shapely.LineString([(4, high), (4, 4)])]
    else:
        floor = floor.difference(shapely.box(3.9, 0, 4.1, low))
        floor = floor.difference(shapely.box(3.9, high, 4.1, 4))
    env = an.environment_from_shapes([floor], walls=walls)
    scanner = an.RangeScanner.planar(sensor=LASER, beams=36, aperture=2.0 * math.pi)
    return RoutePlanner(an.build_map(env, scanner, spacing=0.2), footprint=0.45)


@pytest.mark.parametrize("thin", [False, True])
def test_a_door_that_the_lattice_misses_is_no_wall(thin: bool) -> None:
    # No row of the lattice lies within 1.5 cm of the door's middle.
    robot = building(0.93, thin)
    for name in ("prmstar", "reference"):
        budget = {"iterations": 1000, "seconds": math.inf}
        found = robot.plan((1, 2), (7, 2), planner_name=name, **budget)
        assert found.length == pytest.approx(6.0, rel=1e-3)
    aside = robot.plan((1, 2), (7, 1), planner_name="reference")
    assert aside.length == pytest.approx(math.hypot(3.0, 0.0) + math.hypot(3.0, 1.0), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("thin", [False, True])
def test_a_door_too_narrow_is_reported_by_every_planner(thin: bool) -> None:
    robot = building(0.87, thin)
    for name in ("reference", "prmstar", "rrtstar"):
        with pytest.raises(NoPathError, match="no path leads") as caught:
            robot.plan((1, 2), (7, 2), planner_name=name, seconds=0.2)
    error = caught.value
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    np.testing.assert_array_equal(again.labels, error.labels)
    x = robot.service.map.dataset["x"].values
    assert x[np.nonzero(error.labels == error.start_label)[1]].max() < 4.0
    assert x[np.nonzero(error.labels == error.goal_label)[1]].min() > 4.0
    assert again.narrowest == error.narrowest
    assert error.narrowest == pytest.approx((4.0, 2.0, 0.87), abs=0.1)
    assert error.narrowest.width == pytest.approx(0.87, abs=0.03)
    assert "is 0.8" in str(error)
    assert "needs 0.90 m" in str(error)


@pytest.mark.parametrize("length", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("low", [1.0, 2.065])
@pytest.mark.parametrize("width", [0.475, 0.83])
def test_the_narrowest_place_is_that_of_the_passage(
    length: float, low: float, width: float
) -> None:
    """Wherever the points lie from which it is sought, and however long the passage is."""
    end = 4.0 + length
    passage = shapely.box(4, low, end, low + width)
    floor = shapely.union_all([shapely.box(0, 0, 4, 4), passage, shapely.box(end, 0, end + 4, 4)])
    rooms = an.environment_from_shapes([floor])
    found = widest_way(rooms, np.array([1.5, 2.0]), np.array([end + 2.5, 2.0]), 0.2)
    assert found is not None and found.width == pytest.approx(width, abs=0.0201)
    assert 3.9 <= found.x <= end + 0.1 and low < found.y < low + width


@pytest.mark.slow
@pytest.mark.parametrize("spacing", [0.1, 0.2])
@pytest.mark.parametrize("offset", [0.0, 0.03, 0.08])
def test_of_several_doors_the_one_that_decides_is_named(spacing: float, offset: float) -> None:
    """Wherever they stand on the lattice, which sees a door narrower than it is."""

    def narrowest(*walls: list[tuple[float, float]]) -> Narrowest:
        closed = [
            shapely.box(3.0 * n, low, 3.0 * n + 0.1, high)
            for n, doors in enumerate(walls, start=1)
            for low, high in pairwise([0.0, *(y for door in doors for y in door), 5.0])
            if (low, high) not in doors
        ]
        rooms = an.environment_from_shapes([shapely.box(0, 0, 9, 5) - shapely.union_all(closed)])
        found = widest_way(rooms, np.array([1.0, 2.5]), np.array([8.0, 2.5]), spacing)
        assert found is not None
        return found

    beside = narrowest([(1.0, 1.8), (3.0 + offset, 3.85 + offset)])
    assert (beside.x, beside.y) == pytest.approx((3.05, 3.425 + offset), abs=0.1)
    assert beside.width == pytest.approx(0.85, abs=0.2 * spacing)
    behind = narrowest([(2.0 + offset, 2.8 + offset)], [(2.0, 2.9)])
    assert (behind.x, behind.y) == pytest.approx((3.05, 2.4 + offset), abs=0.1)
    assert behind.width == pytest.approx(0.8, abs=0.2 * spacing)


def test_the_place_that_is_offered_is_free() -> None:
    robot = building(1.0)
    with pytest.raises(InputError, match="nearest free point") as caught:
        robot.plan((0.1231, 1.0), (7, 2))
    x, y = (
        float(part) for part in str(caught.value).split("point is (")[1].split(")")[0].split(",")
    )
    assert robot.checker.poses_free([[x, y, 0.0]])[0]


@pytest.mark.parametrize(
    "name", ["prmstar", "rrtstar", "informed-rrtstar", "bitstar", "fmt", "reference", "belief"]
)
def test_the_goal_may_be_the_start(name: str) -> None:
    route = building(1.0).plan((1, 2), (1, 2), planner_name=name)
    assert route.length == route.cost == 0.0
    assert len(route.poses) == 2


@pytest.mark.slow
def test_a_footprint_beyond_a_wall_is_no_start() -> None:
    beside = Footprint.polygon([(0.5, -0.2), (0.9, -0.2), (0.9, 0.2), (0.5, 0.2)])
    robot = RoutePlanner(building(1.0).service, footprint=beside, space="se2")
    with pytest.raises(InputError, match="a wall stands between"):
        robot.plan((7.8, 2, 0), (1, 2, 0))
    assert robot.plan((7.0, 2, math.pi), (6.0, 2, math.pi)).length == pytest.approx(1.0, rel=0.02)


@pytest.mark.slow
def test_limits_of_the_deviation_hold_for_both_belief_planners() -> None:
    service = building(1.0).service
    for name in ("belief", "belief-roadmap"):
        sure = BeliefModel(start_std=(0.1, 0.1, 0.05), max_std=0.13)
        route = RoutePlanner(service, belief=sure).plan((1, 2), (3, 2), planner_name=name)
        assert route.covariances is not None
        assert np.sqrt(np.linalg.eigvalsh(route.covariances[:, :2, :2])[:, -1]).max() <= 0.13
        strict = RoutePlanner(service, belief=BeliefModel(max_goal_std=1e-4))
        with pytest.raises(NotFoundError, match=r"0\.0001 m at the goal"):
            strict.plan((1, 2), (7, 2), planner_name=name)


def test_a_turning_radius_beyond_the_building_is_refused() -> None:
    with pytest.raises(InputError, match="turning_radius is 1e"):
        RoutePlanner(building(1.0).service, space="dubins", turning_radius=1e6)


def test_the_graph_does_not_depend_on_the_weight_asked_first() -> None:
    service = building(1.0).service
    heavy = RoutePlanner(service)
    heavy.plan((1, 2), (7, 3), planner_name="reference", weight=1e8)
    again = heavy.plan((1, 2), (7, 3), planner_name="reference", weight=0.0)
    fresh = RoutePlanner(service).plan((1, 2), (7, 3), planner_name="reference", weight=0.0)
    assert again.cost == fresh.cost
