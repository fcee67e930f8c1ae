"""Maps in tiles of buildings in three dimensions: those in one piece, to the last bit."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

import ambinav as an
from ambinav.casting.prisms.part import part_of
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import REFLECTOR, WALL
from ambinav.map_building.build import MapSettings
from ambinav.tiles.build import run_plan
from ambinav.tiles.plan import TilePlan
from tests.geometry import scenes
from tests.geometry.furnished import furnished
from tests.tiles.tile_cases import AROUND, OFF_CENTRE, assert_identical, assert_tiles

SENSOR = an.RangeSensor(max_range=3.0, std=0.03, resolution=0.001)
LAYERS = an.RangeScanner.layered(SENSOR, 12, np.radians([-15.0, -5.0, 5.0, 30.0]), z=0.5)
SONAR = an.RangeSensor(max_range=2.0, std=0.03, resolution=0.01, aperture=0.4)
SCANNERS = {
    "layers": (LAYERS, {}),
    "a level laser with headings and a body": (
        OFF_CENTRE.raised(0.3),
        {"headings": 3, "robot_radius": 0.2},
    ),
    "a level laser": (AROUND.raised(0.7), {}),
    "cones": (an.RangeScanner.planar(SONAR, 6, 2 * math.pi).raised(0.4), {}),
}


def hall(seed: int, size: float = 10.0) -> Environment:
    """A plan with its walls, tables, shelves and beams between many heights, in its free space."""
    plan = scenes.scene(seed, size=size, blocks=5, thin=3)
    rng = np.random.default_rng(seed)
    solids = []
    for _ in range(25):
        x, y = np.round(rng.uniform(0.0, size, 2) * 5) / 5  # some in line with the lattice
        block = shapely.box(x, y, x + rng.choice([0.1, 0.6, 3.0]), y + rng.uniform(0.05, 1.0))
        turned = affinity.rotate(block, rng.choice([0.0, 0.0, rng.uniform(0.0, 90.0)]))
        low = rng.choice([0.0, 0.7, 0.75, 2.1])
        kind = int(rng.choice([WALL, REFLECTOR]))
        solids.append(Solid(turned, float(low), float(low + rng.choice([0.05, 0.4])), kind))
    xy = plan.segments.xy
    heights = np.column_stack([np.zeros(len(xy)), rng.choice([0.6, 2.5], len(xy))])
    space = Prisms(
        xy, heights, plan.segments.kind, solids=solids, floor=0.0, ceiling=2.5, free=plan.free
    )
    return plan.in_space(space)


@pytest.mark.slow
@settings(max_examples=30)
@given(seed=st.integers(0, 999))
def test_rays_near_a_box_are_those_in_the_building(seed: int) -> None:
    building = hall(seed).space
    assert isinstance(building, Prisms)
    rng = np.random.default_rng(seed)
    low = rng.uniform(-1.0, 8.0, 2)
    high = low + rng.uniform(0.2, 4.0, 2)
    reach = float(rng.uniform(0.5, 4.0))
    part = pickle.loads(
        pickle.dumps(part_of(building, (*(low - reach - 0.1), *(high + reach + 0.1))))
    )
    assert len(part.surface_kind) <= len(building.surface_kind)
    x, y = rng.uniform(low, high, (40, 2)).T
    aligned = np.round(x * 10) / 10, np.round(y * 10) / 10
    rays = SpaceRays.layers(
        np.radians([-90.0, -40.0, -3.0, 0.0, 8.0, 60.0]), np.arange(16) * math.tau / 16, 0.7
    )
    for px, py, theta in ((x, y, rng.uniform(-3, 3, 40)), (*aligned, np.zeros(40))):
        inside = (px >= low[0]) & (px <= high[0]) & (py >= low[1]) & (py <= high[1])
        poses = px[inside], py[inside], theta[inside]
        one, other = (scene.cast_scans(*poses, rays, reach) for scene in (part, building))
        assert one[0].tobytes() == other[0].tobytes()
        assert one[2].tobytes() == other[2].tobytes()
        hit = one[1] >= 0
        assert (hit == (other[1] >= 0)).all()
        for read in ("surface_kind", "surface_normal"):
            mine, theirs = (
                getattr(scene, read)[found[1][hit]]
                for scene, found in ((part, one), (building, other))
            )
            assert mine.tobytes() == theirs.tobytes()


def settings_of(env: Environment, case: str, spacing: float) -> MapSettings:
    scanner, options = SCANNERS[case]
    return MapSettings.of(env, scanner, spacing, 0.6, **options)


def in_one_piece(env: Environment, case: str, spacing: float) -> an.AmbiguityMap:
    scanner, options = SCANNERS[case]
    return an.build_map(env, scanner, spacing, 0.6, store=False, **options)


@pytest.mark.slow
@settings(max_examples=3)
@given(seed=st.integers(0, 999), tile=st.floats(1.5, 8.0), case=st.sampled_from(sorted(SCANNERS)))
def test_tiles_of_any_hall_are_its_map(seed: int, tile: float, case: str) -> None:
    env = hall(seed, 8.0)
    amap = in_one_piece(env, case, 0.4)
    made = TilePlan.of(env, settings_of(env, case, 0.4), tile)
    assert_tiles(amap, made, np.random.default_rng(seed))


@pytest.mark.sweep
@settings(max_examples=10)
@given(seed=st.integers(0, 9999), tile=st.floats(1.0, 12.0), case=st.sampled_from(sorted(SCANNERS)))
def test_tiles_of_many_halls_are_their_maps(seed: int, tile: float, case: str) -> None:
    env = hall(seed)
    amap = in_one_piece(env, case, 0.4)
    made = TilePlan.of(env, settings_of(env, case, 0.4), tile)
    assert_tiles(amap, made, np.random.default_rng(seed))


@pytest.mark.parametrize("case", ["layers", "a level laser with headings and a body"])
def test_tiles_of_a_mesh_are_its_map(case: str) -> None:
    _, env = furnished()
    made = TilePlan.of(env, settings_of(env, case, 0.4), 2.3)
    assert_tiles(in_one_piece(env, case, 0.4), made, np.random.default_rng(3))


@pytest.mark.slow(kept=("0-prisms",))
@pytest.mark.parametrize("which", [0, 1], ids=["prisms", "mesh"])
@pytest.mark.parametrize("workers", [0, 2])
def test_a_finished_store_is_the_map(which: int, workers: int, tmp_path: Path) -> None:
    env = furnished()[which]
    made = TilePlan.of(env, settings_of(env, "layers", 0.2), 1.5)
    done = run_plan(made, str(tmp_path / "a.zarr"), workers=workers)
    assert done.made == done.tiles > 4
    found = an.AmbiguityMap.open(tmp_path / "a.zarr")
    assert_identical(found, in_one_piece(env, "layers", 0.2))
    assert found.dataset.attrs["environment_space"] == env.space.checksum


@pytest.mark.sweep
@pytest.mark.parametrize(("case", "tile"), [("layers", 6.0), ("cones", 9.1), ("layers", 13.0)])
def test_tiles_of_a_real_office_are_its_map(case: str, tile: float, data_dir: Path) -> None:
    env = an.load_environment(data_dir / "plans" / "institute.ifc", level=1, in_space=True)
    made = TilePlan.of(env, settings_of(env, case, 0.4), tile)
    assert_tiles(in_one_piece(env, case, 0.4), made, np.random.default_rng(0))
