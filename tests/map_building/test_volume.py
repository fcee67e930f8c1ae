"""Ambiguity over heights in a room with a table and a hollow cupboard."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Solid
from ambinav.casting.solids import with_solids
from ambinav.casting.triangles import triangles_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.map_building.build import build_map
from ambinav.map_building.volume import build_volume
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.ambiguity_volume import AmbiguityVolume
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

ROOM = shapely.box(0.0, 0.0, 8.0, 5.0)
TABLE = Solid(shapely.box(2.0, 2.0, 3.2, 3.2), 0.6, 0.7)
CUPBOARD = Solid(shapely.box(5.03, 1.02, 7.01, 2.96), 0.0, 1.0)
HEIGHTS = (0.4, 0.9, 1.4)
SCANNER = RangeScanner.planar(
    sensor=RangeSensor(max_range=2.93, std=0.03, resolution=0.001), beams=24, aperture=2 * math.pi
)


def room() -> Environment:
    plan = environment_from_shapes(rooms=[ROOM], name="room")
    floor = environment_from_shapes(rooms=[ROOM - CUPBOARD.outline], name="room")
    return floor.in_space(with_solids(extruded(plan, 2.4), [TABLE, CUPBOARD]))


def as_mesh(env: Environment) -> Environment:
    """The same surfaces as triangles, floor and ceiling included."""
    assert env.space is not None
    lids = [[[x, y, z] for x, y in ((0, 0), (8, 0), (8, 5))] for z in (0.0, 2.4)]
    lids += [[[x, y, z] for x, y in ((0, 0), (8, 5), (0, 5))] for z in (0.0, 2.4)]
    triangles = np.concatenate([triangles_of(env.space), np.array(lids, dtype=float)])
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return env.in_space(Mesh(triangles.reshape(-1, 3), faces))


@pytest.fixture(scope="module")
def volume() -> AmbiguityVolume:
    return build_volume(room(), SCANNER, HEIGHTS, spacing=0.25, robot_radius=0.15, store=False)


def at(volume: AmbiguityVolume, x: float, y: float) -> list[bool]:
    """Where it is free over a place, from the lowest height on."""
    return [bool(k) for k in volume.dataset["free"].sel(x=x, y=y, method="nearest").values]


def test_free_space_over_and_under_furniture(volume: AmbiguityVolume) -> None:
    assert at(volume, 1.0, 1.0) == [True, True, True]
    # From 0.25 to 0.55 m under a table top at 0.6 m; at 0.9 m it is 0.2 m above it.
    assert at(volume, 2.6, 2.6) == [True, True, True]
    # A cupboard 1 m high: not in it, though nothing stands in its middle, and not at 0.9 m.
    assert at(volume, 6.0, 2.0) == [False, False, True]
    # Within the sphere's radius of a wall.
    assert at(volume, 0.13, 2.6) == [False, False, False]


def test_high_over_the_furniture_it_is_the_empty_room(volume: AmbiguityVolume) -> None:
    plan = environment_from_shapes(rooms=[ROOM], name="room")
    empty = build_map(plan, SCANNER, 0.25, map_std=plan.map_std, store=False)
    x, y = slice(1.0, 7.0), slice(1.0, 4.0)
    top = volume.dataset["level"].sel(z=1.4).sel(x=x, y=y).values
    np.testing.assert_allclose(top, empty.dataset["level"].sel(x=x, y=y).values, atol=2e-3)
    low = volume.dataset["level"].sel(z=0.9).sel(x=x, y=y).values
    assert np.nanmean(low) < np.nanmean(top) - 0.02, "the cupboard is a feature at 0.9 m"


def test_a_mesh_of_the_same_surfaces_gives_the_same(volume: AmbiguityVolume) -> None:
    pytest.importorskip("embreex")
    mesh = build_volume(
        as_mesh(room()), SCANNER, HEIGHTS, spacing=0.25, robot_radius=0.15, store=False
    )
    np.testing.assert_array_equal(mesh.free, volume.free)
    off = np.abs(mesh.dataset["level"].values - volume.dataset["level"].values)[volume.free]
    # A ray that ends at an edge, or at the end of the range, may be rounded either way.
    assert np.quantile(off, 0.98) < 1e-3


def test_kept_and_read(volume: AmbiguityVolume, tmp_path: Path) -> None:
    volume.save(tmp_path / "room.zarr")
    again = AmbiguityVolume.open(tmp_path / "room.zarr")
    assert again.dataset.identical(volume.dataset)
    with pytest.raises(InputError, match=r"room\.zarr: this is an ambiguity volume, over several"):
        AmbiguityMap.open(tmp_path / "room.zarr")


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        ((0.4,), r"heights is \(0\.4,\); give two or more that rise in equal steps"),
        ((0.4, 0.9, 1.0), "rise in equal steps"),
        ((0.1, 0.6), r"z = 0\.1 m leaves no room for a robot of radius 0\.15 m: the floor is at"),
        ((1.4, 2.4), r"z = 2\.4 m leaves no room .* and the ceiling at 2\.4 m; give other heights"),
        (0.5, r"heights is 0\.5; give two or more heights in metres"),
    ],
)
def test_heights_of_no_use(heights: tuple[float, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_volume(room(), SCANNER, heights, robot_radius=0.15, store=False)


def test_a_plan_has_no_heights() -> None:
    with pytest.raises(InputError, match="it is a plan, without heights; give a building in space"):
        build_volume(room().plan, SCANNER, HEIGHTS, store=False)


@pytest.mark.slow
def test_without_map_std_it_is_that_of_the_building() -> None:
    """The command gives None where nothing is given; a floor at a height has another default."""
    env = room()
    given = {"heights": HEIGHTS, "spacing": 0.5, "robot_radius": 0.15, "store": False}
    volumes = [build_volume(env, SCANNER, **given, **more) for more in ({}, {"map_std": None})]
    np.testing.assert_array_equal(*(volume.dataset["level"].values for volume in volumes))
    named = build_volume(env, SCANNER, **given, map_std=env.map_std)
    np.testing.assert_array_equal(volumes[0].dataset["level"].values, named.dataset["level"].values)
