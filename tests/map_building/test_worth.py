"""A map is updated where that is faster, and built where not: the result is the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.occupancy_grid import OCCUPIED, OccupancyGrid
from ambinav.map_building import worth
from ambinav.map_building.map_change import MapChange
from ambinav.map_building.update import _Update
from ambinav.map_building.worth import ExpectedWork, build_seconds
from tests.geometry import scenes
from tests.map_building.test_update import CASES, assert_same, built


@pytest.fixture
def methods(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the methods that updates have called: `patched` or `built`."""
    called: list[str] = []
    for name in ("patched", "built"):
        method: Callable[..., Any] = getattr(_Update, name)

        def counted(*arguments: Any, name: str = name, method: Any = method) -> Any:
            called.append(name)
            return method(*arguments)

        monkeypatch.setattr(_Update, name, counted)
    return called


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """A floor so large that what an update takes in any case does not count."""
    monkeypatch.setattr(worth, "SMALLEST", 0.0)
    monkeypatch.setattr(worth, "OVERHEAD", 0.0)


def two_rooms() -> an.Environment:
    """Two rooms of 6 x 4 m with a door between them."""
    return an.environment_from_shapes(
        [shapely.box(0, 0, 12, 4)], [shapely.box(6, 0, 6.2, 3), shapely.box(6, 3.6, 6.2, 4)]
    )


def test_a_small_map_is_built(methods: list[str]) -> None:
    env = two_rooms()
    edited = env.edited([Obstacle.post(1.0, 1.0, 0.2)])
    assert_same(built(env).update(edited), built(edited), 0.0)
    assert methods == ["built"]


@pytest.mark.usefixtures("large")
def test_a_change_that_most_poses_see_is_built(methods: list[str]) -> None:
    env = two_rooms()
    amap = built(env)
    posts = [Obstacle.post(x, y, 0.2) for x in (1, 3, 5, 7, 9, 11) for y in (1, 3)]
    for obstacles in ([Obstacle.post(1.0, 1.0, 0.2)], posts):
        edited = env.edited(obstacles)
        assert_same(amap.update(edited), built(edited), 0.0)
    assert methods == ["patched", "built"]


@pytest.mark.usefixtures("large")
def test_new_floor_counts(methods: list[str]) -> None:
    env = an.environment_from_shapes([shapely.box(0, 0, 6, 4)])
    edited = env.edited(remove=shapely.box(6, 0, 30, 4))
    assert_same(built(env).update(edited), built(edited), 0.0)
    assert methods == ["built"]


@pytest.mark.parametrize(
    "case", ["around", "headings", *(pytest.param(c, marks=pytest.mark.slow) for c in CASES)]
)
def test_both_make_the_same_map(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    env = scenes.scene(2, size=4.0, blocks=3, thin=2)
    (x, y), *_ = scenes.points_inside(env, 1, 5).tolist()
    edited = env.edited([Obstacle.post(x, y, 0.2)], shapely.box(0.0, 1.0, 1.0, 2.0))
    amap = built(env, case)
    whole = amap.update(edited)
    monkeypatch.setattr(_Update, "pays", True)
    assert_same(amap.update(edited), whole)


def test_what_only_the_map_knows_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot that its floor is judged for, options of layers, cells that are solid."""
    state = np.full((40, 50), OCCUPIED, dtype=np.uint8)
    state[6:34, 6:44] = 0
    first = built(environment_from_grid(OccupancyGrid(state, 0.1)))
    env = first.environment
    amap = first.for_robot(an.find_reach(env, 0.3, (1.0, 1.0)))
    edited = env.edited([Obstacle(shapely.box(2, 2, 2.5, 2.5))])
    whole = amap.update(edited)
    assert (whole.judged.radius, whole.judged.start) == (0.3, (1.0, 1.0))
    monkeypatch.setattr(_Update, "pays", True)
    assert_same(amap.update(edited), whole)


@pytest.mark.usefixtures("large")
def test_the_expected_share_is_that_of_the_poses_computed() -> None:
    env = two_rooms()
    amap = built(env)
    edited = env.edited([Obstacle.post(1.0, 1.0, 0.2)])
    work, again = _Update(MapChange.of(amap, edited)).work, amap.update(edited)
    differ = np.nan_to_num(again.dataset["ambiguity"].values - amap.dataset["ambiguity"].values)
    share = (differ != 0.0).sum() / amap.dataset["free"].values.sum()
    assert work.asks_cells and share - 0.05 < work.share < share + 0.3


def test_a_post_in_a_coarse_map_of_a_floor_is_updated(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on the page: 980 m² every 0.2 m, which two threads build in a tenth of a second."""
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    seconds = build_seconds(24_500, 60, 0.5, 0.2)
    assert not worth.is_small(seconds)
    assert ExpectedWork(True, 0.1).pays(seconds)


def test_seconds_of_a_build() -> None:
    once, twice = (build_seconds(poses, 60, 0.5, 0.1) for poses in (1000, 2000))
    assert twice == pytest.approx(2.0 * once)
    assert build_seconds(1000, 1, 0.5, 0.1) == build_seconds(1000, 16, 0.5, 0.1) < once
    # From three fifths of the floor on that see the change, a build of 0.1 s is as fast.
    assert ExpectedWork(True, 0.5).pays(0.1) and not ExpectedWork(True, 0.7).pays(0.1)
    assert ExpectedWork(True, 0.8).pays(10.0) and not ExpectedWork(True, 0.95).pays(10.0)
