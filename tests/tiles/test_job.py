"""A tile holds what a map in one piece holds there, to the last bit."""

from __future__ import annotations

import itertools
import math
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.occupancy_grid import OccupancyGrid
from ambinav.map_building.build import MapSettings
from ambinav.runtime.errors import InputError
from ambinav.tiles.plan import TilePlan
from tests.geometry import scenes
from tests.tiles.tile_cases import AROUND, CASES, assert_tiles, demo, plan, whole


@pytest.mark.slow
def test_tiles_of_the_demo_are_its_map_with_headings() -> None:
    case = "headings and a body"
    assert_tiles(whole(demo(), case, 0.6), plan(demo(), 7.7, case, 0.6), np.random.default_rng(1))


@pytest.mark.slow
@settings(max_examples=4)
@given(tile=st.floats(2.0, 12.0), case=st.sampled_from(sorted(CASES)), seed=st.integers(0, 999))
def test_tiles_of_any_building_are_its_map(tile: float, case: str, seed: int) -> None:
    env = scenes.scene(seed, size=12.0, blocks=8, thin=5)
    amap = whole(env, case, 0.4)
    assert_tiles(amap, plan(env, tile, case, 0.4), np.random.default_rng(seed))


@pytest.mark.sweep
@settings(max_examples=6)
@given(tile=st.floats(1.0, 20.0), case=st.sampled_from(sorted(CASES)), seed=st.integers(0, 99))
def test_tiles_of_a_recorded_building_are_its_map(
    data_dir: Path, tile: float, case: str, seed: int
) -> None:
    grid = load_map_server(data_dir / "maps" / "willow_full_005.yaml")
    crop = OccupancyGrid(grid.state[300:600, 400:800], grid.resolution, (3.0, -2.0, 0.1))
    env = environment_from_grid(crop)
    amap = whole(env, case, 0.3)
    assert_tiles(amap, plan(env, max(tile, 2.5), case, 0.3), np.random.default_rng(seed))


@pytest.mark.slow
def test_a_wall_farther_than_the_range_still_gives_the_clearance() -> None:
    env = scenes.room(40.0, 40.0)
    assert_tiles(whole(env), plan(env, 5.0), np.random.default_rng(0))


@pytest.mark.slow
def test_what_cannot_be_cut_is_refused() -> None:
    env = scenes.room(6.0, 4.0)
    with pytest.raises(InputError, match="at least one spacing"):
        plan(env, 0.1)
    with pytest.raises(InputError, match="no process holds"):
        plan(env, 1e4)
    with pytest.raises(InputError, match="fisher cannot be made tile by tile"):
        TilePlan.of(env, MapSettings.of(env, AROUND, 0.5, 0.6, layers="fisher"), 2.0)
    far = an.RangeScanner.planar(AROUND.sensors[0], 8, math.pi, mount=(30.0, 0.0, 0.0))
    with pytest.raises(InputError, match="at no point of scene a robot"):
        _ = TilePlan.of(env, MapSettings.of(env, far, 0.5, 0.6), 2.0).sample


def test_an_estimate_says_how_many_poses_and_tiles_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = itertools.count()  # what is timed takes a second
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(clock)))
    made = plan(demo(), 5.0)
    needs = made.estimate(2)
    free = int(whole(demo()).dataset["free"].sum())
    assert needs.poses == pytest.approx(free, rel=0.03)
    assert needs.tiles == len(list(made.tiles())) == math.prod(made.shape)
    assert 0.0 < needs.seconds == pytest.approx(2 * made.estimate(4).seconds)
    assert needs.stored > 30 * free
    assert needs.sent > needs.tiles * 10
