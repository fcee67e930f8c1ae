"""Where the scanner sits on the robot hardly changes the map: on drawn and on all real maps.

What must hold of a mount shifted by 1 mm to 20 cm: the share of each zone changes by less than 5
points, and `level` (mean over headings) at poses 0.3 m from the walls by less than 0.03 at the
median.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing import RangeScanner, RangeSensor
from tests import recorded
from tests.geometry import scenes

TURN = 2 * math.pi
MOST_SHARE, MOST_LEVEL, CLEAR = 0.05, 0.03, 0.3
SENSOR = RangeSensor(max_range=3.5, min_range=0.12, std=0.02, resolution=0.001)
WINDOW = 12.0
"""Metres: of maps that are larger a piece of this side is taken."""


def shifted(scanner: RangeScanner, metres: float, towards: float = 0.0) -> RangeScanner:
    """All sensors of a scanner so many metres further in a direction of the robot (radians)."""
    mounts = scanner.mounts.copy()
    mounts[:, 0] += metres * math.cos(towards)
    mounts[:, 1] += metres * math.sin(towards)
    return RangeScanner.from_mounts(
        scanner.sensors, mounts, scanner.sensor_of_beam, name=scanner.name
    )


def hold(one: AmbiguityMap, other: AmbiguityMap, *, points: float = 0.0) -> None:
    """Check what must hold of two maps that differ in the mount alone.

    `points`: what a few cells more or less are of all, in tiny buildings.
    """
    before, after = one.floor("level").values, other.floor("level").values
    clear = one.dataset["clearance"].values >= CLEAR
    known = clear & np.isfinite(before) & np.isfinite(after)
    assert known.sum() > 0.9 * (clear & np.isfinite(before)).sum()
    shares = [[zone.share for zone in amap.zone_shares()] for amap in (one, other)]
    off = float(np.abs(np.subtract(*shares)).max())
    level = float(np.median(np.abs(before - after)[known])) if known.any() else 0.0
    print(f"share {off:.4f}, level {level:.4f}")
    assert off < MOST_SHARE + points
    assert level < MOST_LEVEL


def all_around(beams: int = 36) -> RangeScanner:
    return RangeScanner.planar(SENSOR, beams, TURN)


FAN = RangeScanner.planar(SENSOR, 24, math.radians(240))
_FACING = np.radians([-90, -50, -30, -10, 10, 30, 50, 90])
SONARS = RangeScanner.from_mounts(
    RangeSensor(
        max_range=5.0, min_range=0.1, std=0.02, resolution=0.01, aperture=math.radians(24),
        max_incidence=math.radians(30),
    ),
    np.column_stack([0.15 * np.cos(_FACING), 0.15 * np.sin(_FACING), _FACING]),
)  # fmt: skip


@pytest.fixture(scope="module")
def house() -> Environment:
    """Rooms with doors along a corridor, a hall at its end."""
    rooms = [shapely.box(4.0 * k, 0.0, 4.0 * k + 3.8, 4.0) for k in range(2)]
    doors = [shapely.box(4.0 * k + 1.0, 3.9, 4.0 * k + 2.0, 4.3) for k in range(2)]
    corridor, hall = shapely.box(0.0, 4.2, 9.0, 6.0), shapely.box(8.8, 0.0, 16.0, 9.0)
    return environment_from_shapes([shapely.union_all([*rooms, *doors, corridor, hall])])


# -- in the centre, by centimetres, by more ------------------------------------------------------


@pytest.mark.parametrize("metres", [1e-3, 0.01, 0.032, 0.1, 0.2])
def test_centimetres_off_the_centre_are_no_reason_for_headings(
    house: Environment, metres: float
) -> None:
    centred = build_map(house, all_around(), 0.2)
    for towards in (0.0, 1.0, math.pi):
        amap = build_map(house, shifted(all_around(), metres, towards), 0.2)
        assert not amap.has_theta
        np.testing.assert_allclose(
            amap.dataset["level"].values, centred.dataset["level"].values, atol=1e-3
        )
        assert "heading" in amap.layers
        hold(centred, amap)


@pytest.mark.slow(kept=("all",))
@pytest.mark.parametrize("scanner", [all_around(), FAN, SONARS], ids=["all", "fan", "sonars"])
def test_mounts_in_a_house(house: Environment, scanner: RangeScanner) -> None:
    """With headings, asked for where the scanner needs none."""
    centred = build_map(house, scanner, 0.15, headings=8)
    for metres, towards in ((1e-3, 0.0), (0.032, 4.0), (0.2, 2.0)):
        hold(centred, build_map(house, shifted(scanner, metres, towards), 0.15, headings=8))


def test_shipped_scanners(house: Environment) -> None:
    """The TurtleBot3's laser sits 3.2 cm off; sonars stand inside walls beside them."""
    scanner = RangeScanner.from_preset("turtlebot3-lds")
    amap = build_map(house, scanner, 0.2)
    assert not amap.has_theta
    mounts = scanner.mounts.copy()
    mounts[:, :2] = 0.0
    hold(build_map(house, RangeScanner.from_mounts(scanner.sensors, mounts), 0.2), amap)


widths = st.floats(1.2, 4.0)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    rooms=st.lists(st.tuples(widths, widths), min_size=1, max_size=4),
    corridor=st.floats(1.0, 2.5), door=st.floats(0.7, 1.0), wall=st.floats(0.05, 0.3),
    metres=st.sampled_from([1e-3, 0.01, 0.05, 0.12, 0.2]), towards=st.floats(0.0, TURN),
    fan=st.booleans(),
)  # fmt: skip
def test_mounts_in_drawn_buildings(
    rooms: list[tuple[float, float]], corridor: float, door: float, wall: float, metres: float,
    towards: float, fan: bool,
) -> None:  # fmt: skip
    """Rooms of any size, with doors, along a corridor."""
    shapes, left = [], 0.0
    for wide, deep in rooms:
        shapes.append(shapely.box(left, -deep, left + wide, 0.0))
        shapes.append(shapely.box(left + 0.1, -0.01, left + 0.1 + door, wall + 0.01))
        left += wide + wall
    shapes.append(shapely.box(0.0, wall, max(left, 5.0), wall + corridor))
    env = environment_from_shapes([shapely.union_all(shapes)])
    scanner = FAN if fan else all_around(24)
    centred = build_map(env, scanner, 0.2, headings=8)
    amap = build_map(env, shifted(scanner, metres, towards), 0.2, headings=8)
    hold(centred, amap, points=4.0 / centred.dataset["free"].values.sum())


# -- all real maps -------------------------------------------------------------------------------


def piece(env: Environment) -> Environment:
    """The environment, or of a large one what lies around a point in its middle."""
    if env.free.area <= WINDOW**2:
        return env
    middle = env.free.representative_point()
    box = middle.buffer(WINDOW / 2, cap_style="square")
    parts = shapely.get_parts(env.free.intersection(box))
    return environment_from_shapes([max(parts, key=lambda part: part.area)], name=env.name)


@pytest.mark.slow(kept=("3",))
@pytest.mark.parametrize("part", range(8))
def test_mounts_on_all_maps(data_dir: Path, part: int) -> None:
    for file in recorded.all_maps(data_dir)[part::8]:
        env = piece(recorded.read(file)[0])
        print(file.stem, end=": ")
        centred = build_map(env, all_around(24), 0.2)
        for metres in (0.032, 0.2):
            amap = build_map(env, shifted(all_around(24), metres, 1.0), 0.2)
            assert not amap.has_theta
            hold(centred, amap)
        # What headings would make of it: the zones' borders smeared over as many metres.
        exact = build_map(env, shifted(all_around(24), 0.1, 1.0), 0.2, headings=8)
        hold(centred, exact)


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["nav2_tb3_sandbox", "aws_small_house", "navrep_markclutter"])
def test_fans_and_sonars_on_small_maps(data_dir: Path, name: str) -> None:
    env, _ = recorded.read(data_dir / "maps" / f"{name}.yaml")
    for scanner in (FAN, SONARS):
        centred = build_map(env, scanner, 0.2, headings=8)
        for metres in (1e-3, 0.032, 0.1, 0.2):
            hold(centred, build_map(env, shifted(scanner, metres, 0.5), 0.2, headings=8))


# -- bodies --------------------------------------------------------------------------------------


def test_a_body_keeps_off_the_walls() -> None:
    env = scenes.room(4.0, 3.0)
    amap = build_map(env, all_around(), 0.1, robot_radius=0.25)
    free, clearance = amap.dataset["free"].values, amap.dataset["clearance"].values
    assert clearance[free].min() >= 0.25
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    np.testing.assert_array_equal(free, np.asarray(env.is_free(x, y, 0.25)))
    whole = build_map(env, all_around(), 0.1)
    inside = np.hypot(x - 2.0, y - 1.5) < 0.7
    np.testing.assert_array_equal(
        amap.dataset["level"].values[inside], whole.dataset["level"].values[inside]
    )
