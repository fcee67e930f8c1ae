"""A plan with heights returns what the plan does: to a level scanner at any height."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import affinity

from ambinav.buildings.load import load_environment
from ambinav.casting.plane.fan import scan_plan
from ambinav.casting.space import SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.geometry import scenes

EXACT = 1e-4
REACH = 12.0


def compare(env: Environment, count: int, seed: int, mount: tuple[float, float, float]) -> None:
    """A planar laser in the plan and in space, from poses all over the plan and beside it."""
    rng = np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = env.bounds
    x, y = rng.uniform((xmin - 0.5, ymin - 0.5), (xmax + 0.5, ymax + 0.5), (count, 2)).T
    theta = rng.uniform(-math.pi, math.pi, count)
    sensor = RangeSensor(max_range=REACH, std=0.01, resolution=0.01)
    table = RangeScanner.planar(sensor, 90, 2 * math.pi, mount).rays()
    flat = scan_plan(env, x, y, theta, table.origin, table.angle, REACH)
    height = rng.uniform(0.05, 2.4)
    origin = np.column_stack([table.origin, np.full(len(table), height)])
    rays = SpaceRays(origin, table.angle, np.zeros(len(table)))
    solid = extruded(env, 2.5).cast_scans(x, y, theta, rays, REACH)
    assert np.array_equal(np.isnan(flat[0]), np.isnan(solid[0]))
    assert np.array_equal(np.isinf(flat[0]), np.isinf(solid[0]))
    met = np.isfinite(flat[0])
    assert np.abs(flat[0][met] - solid[0][met]).max(initial=0.0) < EXACT
    # Two segments share a corner: there either may be named.
    assert (flat[1] == solid[1])[met].mean() > 0.995
    same = met & (flat[1] == solid[1])
    assert np.abs(flat[2][same] - solid[2][same]).max(initial=0.0) < 1e-4


def test_the_demo_building() -> None:
    env = load_environment(Path(str(files("ambinav.demo") / "demo.geojson")))
    compare(env, 400, 1, (0.2, -0.05, 0.4))
    prisms = extruded(env, 3.0, floor=-1.0)
    assert np.array_equal(prisms.surface_kind[: len(env.segments)], env.segments.kind)
    every = np.arange(len(env.segments))
    assert np.array_equal(prisms.surface_normal[every, :2], env.normals(every))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nav2_depot", "willow_full_005"])
def test_recorded_maps(data_dir: Path, name: str) -> None:
    compare(load_environment(data_dir / "maps" / f"{name}.yaml"), 400, 7, (0.1, 0.0, -0.3))


def test_turned_blocks_and_thin_walls() -> None:
    compare(scenes.scene(3, size=30.0), 300, 2, (0.0, 0.0, 0.0))


@settings(max_examples=20)
@given(
    blocks=st.lists(
        st.tuples(
            st.integers(0, 800), st.integers(0, 600), st.integers(5, 300), st.integers(5, 300),
            st.integers(0, 90),
        ),
        max_size=6,
    ),
    turn=st.integers(0, 90),
    seed=st.integers(0, 10_000),
)  # fmt: skip
def test_rooms(blocks: list[tuple[int, int, int, int, int]], turn: int, seed: int) -> None:
    free = shapely.box(0, 0, 8, 6)
    for x, y, wide, deep, angle in blocks:  # centimetres and degrees
        block = affinity.rotate(shapely.box(x, y, x + wide, y + deep), angle)
        free -= affinity.scale(block, 0.01, 0.01, origin=(0, 0))
    # As the readers of maps do: what is thinner than a hair is no geometry.
    free = shapely.set_precision(free, 1e-6)
    free = max(shapely.get_parts(free), key=lambda part: part.area)
    assume(free.area > 1.0)
    compare(scenes.environment(affinity.rotate(free, turn, origin=(0, 0))), 60, seed, (0, 0, 0))


def test_a_beam_that_looks_up_or_down_ends_at_ceiling_or_floor() -> None:
    env = scenes.room(10.0, 10.0)
    rays = SpaceRays.layers(np.radians([-30.0, 30.0]), np.zeros(1), 0.5)
    at = np.array([1.0]), np.array([5.0]), np.array([0.0])
    distance, surface, _ = extruded(env, 2.5).cast_scans(*at, rays, REACH)
    assert distance[0] == pytest.approx([1.0, 4.0], abs=1e-6)
    assert surface[0].tolist() == [len(env.segments), len(env.segments) + 1]


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan, math.inf])
def test_refused(height: float) -> None:
    with pytest.raises(InputError):
        extruded(scenes.room(4.0, 4.0), height)
