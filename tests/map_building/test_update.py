"""The map of a changed building is that of a whole build, computed where the change is seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav as an
from ambinav.ambiguity.neighbourhoods import Neighbourhoods
from ambinav.geometry.obstacle import Obstacle
from ambinav.sensing import Intensity
from tests.geometry import scenes

# The maps are so small that all of them would be built anew.
pytestmark = pytest.mark.usefixtures("patching")

LASER = an.RangeSensor(max_range=2.0, std=0.03, resolution=0.001)
SPACING, RADIUS = 0.125, 0.4
AROUND = an.RangeScanner.planar(LASER, 16, 2 * math.pi)
HALF = an.RangeScanner.planar(LASER, 12, math.pi)
# Name: scanner and further arguments of `build_map`.
CASES: Mapping[str, tuple[an.RangeScanner, Mapping[str, Any]]] = {
    "around": (AROUND, {}),
    "headings": (HALF, {"headings": 3}),
    "off the centre": (
        an.RangeScanner.planar(LASER, 12, math.pi, mount=(0.2, 0.1, 0.3)),
        {"headings": 3, "robot_radius": 0.15},
    ),
    "turned all around": (
        an.RangeScanner.planar(LASER, 16, 2 * math.pi, mount=(0.25, 0.0, 0.3)),
        {"headings": 2},
    ),
    "intensity": (AROUND.with_intensity(Intensity(wall=100, reflector=255, std=30)), {}),
    "sonar": (an.RangeScanner.from_preset("polaroid-6500-ring"), {}),
    "sonar and laser": (an.RangeScanner.from_preset("pioneer-sonar-laser"), {"headings": 2}),
}


def test_a_part_of_a_map_is_not_updated(tmp_path: Path) -> None:
    env = scenes.room(6.0, 4.0)
    built(env).save(tmp_path / "map.zarr")
    part = an.AmbiguityMap.open(tmp_path / "map.zarr", bounds=(1.0, 1.0, 4.0, 3.0))
    changed = env.edited(add=[Obstacle(shapely.box(2.0, 2.0, 2.5, 2.5))])
    with pytest.raises(an.InputError, match=r"is a part of its building.*open it without bounds"):
        part.update(changed)


def built(
    env: an.Environment, case: str = "around", layers: tuple[str, ...] = ()
) -> an.AmbiguityMap:
    scanner, options = CASES[case]
    return an.build_map(env, scanner, SPACING, RADIUS, store=False, layers=layers, **options)


def assert_same(one: an.AmbiguityMap, other: an.AmbiguityMap, atol: float = 1e-6) -> None:
    """All variables and attributes, but when they were made."""
    assert set(one.dataset.variables) == set(other.dataset.variables)
    for name, values in other.dataset.variables.items():
        found = one.dataset[name]
        assert (found.dims, found.dtype, found.attrs) == (values.dims, values.dtype, values.attrs)
        np.testing.assert_allclose(found.values, values.values, rtol=0, atol=atol, err_msg=name)
    attrs, expected = dict(one.dataset.attrs), dict(other.dataset.attrs)
    assert attrs.pop("created") and expected.pop("created")
    assert attrs == expected


def random_edit(env: an.Environment, seed: int) -> an.Environment:
    """One or two obstacles, perhaps one thinner than the gaps between beams; or a part removed."""
    rng = np.random.default_rng(seed)
    free = scenes.points_inside(env, 3, seed)
    # On the lattice's own lines, where rays run along edges and through corners.
    free = free if rng.random() < 0.5 else free.round(1)
    add: list[Obstacle] = []
    for x, y in free[: rng.integers(0, 3)].tolist():
        if rng.random() < 0.5:
            add.append(Obstacle.post(x, y, rng.uniform(0.005, 0.3)))
        else:
            angle, length = rng.choice([0.0, math.pi / 2, rng.uniform(0, 7)]), rng.uniform(0.3, 2)
            to = (x + length * math.cos(angle), y + length * math.sin(angle))
            add.append(Obstacle.panel(x, y, *to, float(rng.choice([0.0, 0.15])), reflective=x > y))
    x, y = rng.uniform(env.bounds[:2], env.bounds[2:]).tolist()
    remove = shapely.box(x - 0.5, y - 0.4, x + 0.6, y + 0.5)
    try:
        return env.edited(add, remove if rng.random() < 0.5 or not add else None)
    except an.InputError:
        return env


@pytest.fixture(scope="module")
def hall() -> an.Environment:
    """12 x 4 m with two blocks, a thin wall, and an opening to what is not known."""
    return an.environment_from_shapes(
        [shapely.box(0, 0, 12, 4)],
        [shapely.box(3, 1, 3.5, 1.5), shapely.box(8, 2, 9, 3)],
        [[(6, 0), (6, 2)]],
        [[(12, 1.5), (12, 3)]],
    )


@pytest.fixture(scope="module")
def hall_map(hall: an.Environment) -> an.AmbiguityMap:
    return built(hall)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["around", "off the centre"])
@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_random_edits(case: str, seed: int) -> None:
    env = scenes.scene(seed % 7, size=4.0, blocks=3, thin=2)
    amap, edited = built(env, case), random_edit(env, seed)
    updated = amap.update(edited)
    assert_same(updated, built(edited, case))
    assert_same(updated.update(env), amap)


@pytest.mark.slow(kept=("headings", "intensity"))
@pytest.mark.parametrize("case", CASES)
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_many_random_edits(case: str, seed: int) -> None:
    env = scenes.scene(seed % 7, size=6.0, blocks=4, thin=2)
    edited = random_edit(env, seed)
    again = random_edit(edited, seed + 1)
    assert_same(built(env, case).update(edited).update(again), built(again, case))


@pytest.mark.slow(
    kept=("around-maps/nav2_depot", "off the centre-maps/aws_small_house", "sonar-maps/nav2_depot")
)
@pytest.mark.parametrize("name", ["maps_from_logs/aces", "maps/nav2_depot", "maps/aws_small_house"])
@pytest.mark.parametrize("case", ["around", "off the centre", "sonar"])
def test_recorded_maps(name: str, case: str, data_dir: Path) -> None:
    env = an.load_environment(data_dir / f"{name}.yaml")
    scanner, options = CASES[case]
    coarse: dict[str, Any] = {"store": False, **options}
    amap = an.build_map(env, scanner, 0.4, 0.8, **coarse)
    for seed in range(3):
        edited = random_edit(env, seed)
        updated = amap.update(edited)
        assert_same(updated, an.build_map(edited, scanner, 0.4, 0.8, **coarse))
        assert_same(updated.update(env), amap)


def test_no_change_is_an_equal_map(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    updated = hall_map.update(hall)
    assert updated is not hall_map
    assert_same(updated, hall_map, atol=0.0)


def test_an_edit_undone_is_the_first_map(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    edited = hall.edited([Obstacle.post(1.0, 2.0, 0.3)])
    back = edited.edited(remove=shapely.Point(1.0, 2.0).buffer(0.4))
    found = hall_map.update(edited).update(back).dataset
    for name in hall_map.layers:
        np.testing.assert_array_equal(found[name].values, hall_map.dataset[name].values)


def test_two_edits_are_one(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    one, other = [Obstacle.post(1.0, 2.0, 0.3)], [Obstacle.panel(10.0, 1.0, 10.0, 3.0)]
    first = hall.edited(one)
    both = hall_map.update(first).update(first.edited(other)).dataset
    together = hall_map.update(hall.edited([*one, *other])).dataset
    for name in hall_map.layers:
        np.testing.assert_allclose(both[name], together[name], rtol=0, atol=1e-6)


def test_a_moved_obstacle(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    moved = hall.edited([Obstacle(shapely.box(10, 1, 10.5, 1.5))], shapely.box(3, 1, 3.5, 1.5))
    assert_same(hall_map.update(moved), built(moved))


@pytest.mark.parametrize(
    ("add", "remove"),
    [
        ([], shapely.box(11.0, 1.0, 14.0, 2.0)),
        ([], shapely.box(-1.3, -0.7, 1.0, 1.0)),
        ([Obstacle(shapely.box(10.0, -1.0, 13.0, 5.0))], None),
        ([Obstacle(shapely.box(-1.0, -1.0, 13.0, 0.6)), Obstacle.post(11.9, 2.0, 0.3)], None),
        ([Obstacle(shapely.box(-1.0, -1.0, 4.0, 5.0))], shapely.box(11.0, 3.0, 12.5, 5.0)),
    ],
)
def test_the_rim(hall, hall_map, add, remove) -> None:  # type: ignore[no-untyped-def]
    """The lattice grows, shrinks, or both."""
    edited = hall.edited(add, remove)
    updated = hall_map.update(edited)
    assert updated.bounds != hall_map.bounds
    assert_same(updated, built(edited))
    assert_same(updated.update(hall), hall_map)


@pytest.mark.parametrize("case", ["around", "off the centre"])
def test_another_building(case: str, hall: an.Environment) -> None:
    other = scenes.scene(3, size=4.0, blocks=3, thin=2)
    assert_same(built(hall, case).update(other), built(other, case))


def test_a_room_that_is_cut_off_stays_part_of_the_map(
    hall: an.Environment, hall_map: an.AmbiguityMap
) -> None:
    edited = hall.edited([Obstacle.panel(6.0, -1.0, 6.0, 5.0, 0.2)])
    assert_same(hall_map.update(edited), built(edited))


@pytest.mark.slow
def test_a_map_from_disk(hall: an.Environment, hall_map: an.AmbiguityMap, tmp_path: Path) -> None:
    hall_map.save(tmp_path / "hall.zarr")
    opened = an.AmbiguityMap.open(tmp_path / "hall.zarr")
    edited = opened.environment.edited([Obstacle.post(1.0, 2.0, 0.3)])
    updated = opened.update(edited)
    assert_same(updated, built(edited))
    updated.save(tmp_path / "hall.zarr")
    assert_same(an.AmbiguityMap.open(tmp_path / "hall.zarr"), updated, atol=0.0)


def test_only_poses_that_see_the_change_are_computed(
    hall: an.Environment, hall_map: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = []
    whole = Neighbourhoods.sums

    def sums(self: Neighbourhoods, *arguments: Any) -> Any:
        x, _ = self.lattice.points
        poses.append(x[self.poses])
        return whole(self, *arguments)

    monkeypatch.setattr(Neighbourhoods, "sums", sums)
    # The thin wall from y = 0 to 2 hides most of it from the other half.
    hall_map.update(hall.edited([Obstacle.post(5.0, 0.5, 0.1)]))
    x = np.concatenate(poses)
    assert 0.02 < len(x) / hall_map.dataset["free"].sum() < 0.5
    # Rays end a metre beyond the range, and neighbourhoods reach on.
    assert abs(x - 5.0).max() < 0.1 + 2.0 + 1.0 + RADIUS + SPACING
    poses.clear()
    hall_map.update(hall.edited([Obstacle.post(5.0, 0.5, 0.001)]))
    thin = np.concatenate(poses)
    assert 0 < len(thin) < len(x), "between the beams it is not seen"


NAMES = ("position", "fisher", "coastal_entropy", "gfm", "clearance", "wall_normals")


@pytest.mark.parametrize("case", ["around", pytest.param("headings", marks=pytest.mark.slow)])
def test_layers_that_were_added(case: str) -> None:
    env = scenes.scene(2, size=9.0, blocks=6, thin=3)
    scanner, options = CASES[case]
    coarse: dict[str, Any] = {"store": False, "layers": NAMES, **options}
    amap = an.build_map(env, scanner, 0.3, 0.6, **coarse)
    x, y = scenes.points_inside(env, 1, 0, 0.5)[0].tolist()
    edited = env.edited([Obstacle.post(x, y, 0.2)], shapely.box(0, 0, 1, 1))
    assert_same(amap.update(edited), an.build_map(edited, scanner, 0.3, 0.6, **coarse))


@pytest.mark.slow(1)
def test_layers_that_are_computed_in_full() -> None:
    env = scenes.scene(2, size=4.0, blocks=3, thin=1)
    names = ("localizability", "perturbation", "aliasing")
    amap = an.build_map(env, AROUND, 0.2, 0.4, store=False, layers=names)
    edited = random_edit(env, 1)
    whole = an.build_map(edited, AROUND, 0.2, 0.4, store=False, layers=names)
    assert_same(amap.update(edited), whole)


@pytest.mark.slow
def test_options_of_layers_are_kept(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    from ambinav.layers.build import with_layers

    options = {"fisher": {"odometry_std": 0.1}, "gfm": {"step": 0.2}}
    amap = with_layers(hall_map, list(options), environment=hall, **options)  # type: ignore[arg-type]
    edited = hall.edited([Obstacle.post(1.0, 2.0, 0.3)])
    expected = with_layers(built(edited), list(options), environment=edited, **options)  # type: ignore[arg-type]
    assert_same(amap.update(edited), expected)


def test_solid_cells_stay_where_the_grid_is_not_known(tmp_path: Path) -> None:
    from ambinav.buildings.boundary import environment_from_grid
    from ambinav.geometry.occupancy_grid import OCCUPIED, UNKNOWN, OccupancyGrid

    state = np.full((50, 70), UNKNOWN, dtype=np.uint8)
    state[5:45, 5:65] = OCCUPIED
    state[8:42, 8:62] = 0
    env = environment_from_grid(OccupancyGrid(state, 0.1))
    amap = built(env)
    known = amap.environment
    assert known.occupancy is None
    updated = amap.update(known.edited([Obstacle(shapely.box(3, 2, 3.5, 2.5))]))
    fresh = updated.solid & ~amap.solid
    expected = amap.dataset["free"].values & ~updated.dataset["free"].values
    np.testing.assert_array_equal(fresh, expected)
    assert expected.any() and not (amap.solid & ~updated.solid).any()


def test_progress_ends_with_all(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    shares: list[float] = []
    hall_map.update(hall.edited([Obstacle.post(1.0, 2.0, 0.3)]), progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_bad_input(hall: an.Environment, hall_map: an.AmbiguityMap) -> None:
    far = an.environment_from_shapes([shapely.box(0.01, 0.01, 0.05, 0.11)])
    with pytest.raises(an.InputError, match=r"spacing is 0\.125"):
        hall_map.update(far)
    wide = an.build_map(hall, AROUND, SPACING, RADIUS, robot_radius=0.4, store=False)
    narrow = an.environment_from_shapes([shapely.box(0, 0, 6, 0.5)])
    with pytest.raises(an.InputError, match="fits"):
        wide.update(narrow)
    attrs = {k: v for k, v in hall_map.dataset.attrs.items() if k != "scanner_yaml"}
    bare = an.AmbiguityMap(hall_map.dataset.copy().drop_attrs(deep=False).assign_attrs(attrs))
    with pytest.raises(an.InputError, match="lack the scanner"):
        bare.update(hall)
    other = an.AmbiguityMap(hall_map.dataset.drop_vars("unknown"))
    with pytest.raises(an.InputError, match=r"^env is None; give what `Environment\.edited`"):
        hall_map.update(None)  # type: ignore[arg-type]
    with pytest.raises(an.InputError, match=r"^an obstacle is <POLYGON"):
        hall.edited([shapely.box(1.0, 1.0, 1.2, 1.2)])  # type: ignore[list-item]
    with pytest.raises(an.InputError, match=r"another version of ambinav.* unknown"):
        other.update(hall.edited([Obstacle.post(1.0, 2.0, 0.3)]))
