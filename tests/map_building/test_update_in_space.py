"""The map of a changed building in space is that of a whole build."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.casting.mesh.mesh import Mesh
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity
from tests.geometry import scenes
from tests.geometry.furnished import furnished
from tests.map_building.test_update import assert_same

# Compiles kernels that no other test of updates needs.
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("patching")]

LASER = an.RangeSensor(max_range=2.0, std=0.03, resolution=0.001)
# Turned by a hair: of rays into a corner of the room it is not said which wall they meet.
FLAT = an.RangeScanner.planar(LASER, 36, math.tau, (0.0, 0.0, 0.003)).raised(0.4)
LIDAR = an.RangeScanner.layered(
    LASER, 24, np.radians([-15, 0, 15]).tolist(), mount=(0.0, 0.0, 0.003), z=0.9
)
AHEAD = an.RangeScanner.planar(LASER, 12, 2.0, (0.15, 0.0, 0.003)).raised(0.4)
BRIGHT = FLAT.with_intensity(Intensity(wall=100, reflector=255, std=30))


def built(env: Environment, scanner: an.RangeScanner) -> an.AmbiguityMap:
    options = {"headings": 3, "robot_radius": 0.15} if scanner is AHEAD else {}
    return an.build_map(env, scanner, 0.125, 0.4, store=False, layers=("fisher",), **options)


def changed(env: Environment, seed: int) -> Environment:
    rng = np.random.default_rng(seed)
    (x, y), (u, v) = scenes.points_inside(env, 2, seed).tolist()
    low, high = sorted(rng.uniform(0.0, 2.0, 2).tolist())
    if seed % 3 == 2 and not isinstance(env.space, Mesh):
        return env.edited(remove=shapely.box(x - 0.5, 2.0, x + 1.5, 3.5))
    post = Obstacle.post(x, y, rng.uniform(0.02, 0.3)).between(low, high)
    return env.edited([post, Obstacle.panel(u, v, u + 0.6, v + 0.2).between(low, None)])


@pytest.mark.slow(kept=("prisms-ahead", "mesh-flat", "mesh-lidar"))
@pytest.mark.parametrize("scanner", [FLAT, LIDAR, AHEAD], ids=["flat", "lidar", "ahead"])
@pytest.mark.parametrize("which", [0, 1], ids=["prisms", "mesh"])
def test_an_update_is_a_whole_build(which: int, scanner: an.RangeScanner) -> None:
    env = furnished()[which]
    amap = built(env, scanner)
    for seed in range(5):
        now = changed(env, seed)
        # The axis of nearly round radii is left to rounding.
        assert_same(amap.update(now), built(now, scanner), 1e-5)


def test_only_heights_that_scans_see_are_computed_again() -> None:
    """The same post, lower and then higher than the scanner, changes what it sees."""
    env = scenes.room(6.0, 4.0)
    room = env.in_space(an.extruded(env, 2.5))
    post = Obstacle.post(3.0, 2.0, 0.2)
    low, high = (room.edited([post.between(0.0, top)]) for top in (0.3, 0.5))
    amap = built(low, FLAT)
    grown = amap.update(high)
    assert_same(grown, built(high, FLAT))
    differ = np.nan_to_num(grown.dataset["ambiguity"].values - amap.dataset["ambiguity"].values)
    assert np.abs(differ).max() > 1e-3


def test_a_tag_is_seen_by_a_scanner_at_its_height() -> None:
    plan = scenes.room(4.0, 3.0)
    room = plan.in_space(an.extruded(plan, 2.5))
    tag = Obstacle.wall([(1.5, 0.0), (2.1, 0.0)], reflective=True)
    amap = built(room, BRIGHT)
    seen, above = (room.edited([tag.between(low, low + 0.3)]) for low in (0.3, 1.0))
    assert_same(amap.update(seen), built(seen, BRIGHT))
    levels = [amap.update(env).dataset["ambiguity"].values for env in (above, room, seen)]
    np.testing.assert_array_equal(levels[0], levels[1])
    assert np.nanmean(levels[2]) < np.nanmean(levels[1])


def test_a_plan_is_no_change_of_a_building_in_space(tmp_path: Path) -> None:
    env = furnished()[0]
    amap = built(env, FLAT)
    with pytest.raises(InputError, match="it is a plan, and the building of the map is in space"):
        amap.update(env.plan)
    with pytest.raises(InputError, match="it is in space, and the building of the map is a plan"):
        an.build_map(env.plan, FLAT, 0.25, 0.4, store=False).update(env)


@pytest.mark.parametrize("which", [0, 1], ids=["prisms", "mesh"])
def test_many_posts_at_once(which: int) -> None:
    env = furnished()[which]
    places = scenes.points_inside(env, 12, 4).tolist()
    posts = [Obstacle.post(*place, 0.03).between(0.0, 0.6) for place in places]
    now = env.edited(posts)
    assert_same(built(env, FLAT).update(now), built(now, FLAT), 1e-5)


@pytest.mark.parametrize("which", [0, 1], ids=["prisms", "mesh"])
def test_a_floor_at_another_height_changes_everything(which: int) -> None:
    env = furnished()[which]
    assert env.space is not None
    raised = env.in_space(env.space, 0.5)
    assert_same(built(env, FLAT).update(raised), built(raised, FLAT), 1e-5)


@pytest.mark.parametrize("which", [0, 1], ids=["prisms", "mesh"])
def test_an_opened_map_is_updated_like_the_one_saved(which: int, tmp_path: Path) -> None:
    env = furnished()[which]
    env = env.in_space(env.space, 0.0)
    amap = built(env, FLAT)
    amap.save(tmp_path / "room.zarr")
    opened = an.AmbiguityMap.open(tmp_path / "room.zarr")
    assert opened.environment.space is not None and env.space is not None
    assert opened.environment.space.checksum == env.space.checksum
    now = changed(opened.environment, 0)
    assert_same(opened.update(now), amap.update(changed(env, 0)), 1e-5)
