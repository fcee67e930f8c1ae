"""Places whose ambiguity is known beforehand, and figure 1 of the paper in words."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, NOT_FREE, OPEN, TRANSITION
from ambinav.sensing import RangeScanner
from tests.geometry import scenes

LAYERS = ("ambiguity", "major", "minor", "level", "heading")


def moved(xy: list[tuple[float, float]], angle: float) -> NDArray[np.float64]:
    """Points turned about the origin, shape (2, N)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]]) @ np.array(xy).T


def apart(direction: NDArray[np.float64] | float, angle: float) -> float:
    """Largest angle between axes, degrees."""
    turned = np.asarray(direction) - angle
    return float(np.degrees(np.abs(np.arctan(np.tan(turned)))).max())


def box_cells(
    amap: AmbiguityMap, xmin: float, ymin: float, xmax: float, ymax: float
) -> scenes.Array:
    """Zones of the free cells in a box."""
    zone = amap.dataset["zone"].sel(x=slice(xmin, xmax), y=slice(ymin, ymax)).values
    return zone[zone != NOT_FREE]


@pytest.fixture(scope="module")
def hall(laser: RangeScanner) -> AmbiguityMap:
    """A square hall of 20 m: from its middle nothing is in range."""
    return build_map(scenes.room(20.0, 20.0), laser)


@pytest.fixture(scope="module")
def disc(laser: RangeScanner) -> AmbiguityMap:
    """A round room of radius 3 m whose centre is a point of the lattice."""
    room = shapely.Point(0.05, 0.05).buffer(3.0, quad_segs=256)
    return build_map(scenes.environment(room), laser)


# -- single places -----------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_closed_room_is_localizable(laser: RangeScanner, angle: float) -> None:
    amap = build_map(scenes.room(5.0, 4.0).transformed(angle), laser)
    free = amap.dataset["free"].values
    assert (amap.dataset["zone"].values[free] == LOCALIZABLE).all()
    assert amap.dataset["major"].values[free].max() < 0.2
    # In the middle, too, where half a turn looks alike.
    assert amap.dataset["heading"].values[free].max() < 0.125  # in the corners


@pytest.mark.parametrize("degrees", [0, 5, 17, 33, 45, 71, 90, 146])
@pytest.mark.parametrize("width", [1.5, 3.0])
def test_long_corridor_is_weak_along_itself(
    laser: RangeScanner, degrees: float, width: float
) -> None:
    angle = math.radians(degrees)
    amap = build_map(scenes.room(16.0, width).transformed(angle), laser)
    inner = [(x, y) for x in (7.3, 8.0, 8.61) for y in np.linspace(0.15, width - 0.15, 7)]
    x, y = moved(inner, angle)
    assert np.asarray(amap.sample("major", x, y)).min() > 0.9
    assert np.asarray(amap.sample("minor", x, y)).max() < 0.1
    assert apart(amap.sample("direction", x, y), angle) < 2.0
    assert (amap.sample("zone", x, y) == CORRIDOR).all()
    # At its ends the robot sees how far along it is.
    ends = moved([(0.5, width / 2), (15.5, width / 2)], angle)
    assert (amap.sample("zone", *ends) == LOCALIZABLE).all()


def test_middle_of_a_hall_wider_than_the_range_is_open(hall: AmbiguityMap) -> None:
    x, y = np.meshgrid(np.linspace(5, 15, 21), np.linspace(5, 15, 21))
    assert np.asarray(hall.sample("major", x, y)).min() > 0.95
    assert np.asarray(hall.sample("minor", x, y)).min() > 0.95
    assert (hall.sample("zone", x, y) == OPEN).all()
    assert np.asarray(hall.sample("heading", x, y)).min() > 0.95


def test_where_nothing_is_in_range_every_limit_is_met(hall: AmbiguityMap) -> None:
    for layer in LAYERS:
        assert hall.sample(layer, 10.0, 10.0) == pytest.approx(1.0, abs=1e-5)
    # The second moments of a disc of radius R with the cells' own: about R / 2 each way.
    assert hall.sample("major_radius", 10.0, 10.0) == pytest.approx(0.25, abs=0.02)
    # A turn anywhere within 45 degrees: pi / 4 / sqrt(3).
    assert hall.sample("heading_radius", 10.0, 10.0) == pytest.approx(
        math.pi / 4 / math.sqrt(3), rel=0.02
    )


@pytest.mark.parametrize("away", [0.3, 1.0, 2.0, 3.0])
def test_beside_one_wall_it_is_a_corridor(hall: AmbiguityMap, away: float) -> None:
    for x, y, angle in ((10, away, 0), (away, 10, 90), (10, 20 - away, 0), (20 - away, 10, 90)):
        assert hall.sample("zone", x, y) == CORRIDOR
        assert apart(hall.sample("direction", x, y), math.radians(angle)) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [6, 17, 33, 71])
def test_beside_a_tilted_wall_too(laser: RangeScanner, degrees: float) -> None:
    # Where beams flip between echo and no echo within a cell.
    angle = math.radians(degrees)
    amap = build_map(scenes.room(14.0, 8.0).transformed(angle), laser)
    x, y = moved([(x, y) for x in (6.5, 7.0, 7.4) for y in (0.4, 1.1, 2.0, 3.0)], angle)
    assert np.asarray(amap.sample("major", x, y)).min() > 0.9
    assert np.asarray(amap.sample("minor", x, y)).max() < 0.2
    assert apart(amap.sample("direction", x, y), angle) < 2.0


def test_at_the_centre_of_a_circle_heading_is_lost_and_position_is_not(disc: AmbiguityMap) -> None:
    assert disc.sample("heading", 0.05, 0.05) > 0.9
    # Wherever the lattice lies: half a cell off the centre it is still lost.
    assert np.asarray(disc.sample("heading", [0.0, 0.1], [0.1, 0.05])).min() > 0.7
    assert disc.sample("level", 0.05, 0.05) < 0.15
    assert disc.sample("zone", 0.05, 0.05) == LOCALIZABLE


def test_off_the_centre_of_a_circle_the_heading_is_known(disc: AmbiguityMap) -> None:
    around = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    for far in (0.5, 1.0, 2.0, 2.6):
        x, y = 0.05 + far * np.cos(around), 0.05 + far * np.sin(around)
        # A turn by a spacing over this distance looks like a step along the wall.
        assert np.asarray(disc.sample("heading", x, y)).max() < 0.25 / far
        # Towards the wall it is sure; along the circle it is less so.
        assert np.asarray(disc.sample("minor", x, y)).max() < 0.15
    assert apart(disc.sample("direction", 2.05, 0.05), math.pi / 2) < 2.0


def test_quarter_turns_of_a_square_room_do_not_count(laser: RangeScanner) -> None:
    centre = scenes.environment(shapely.box(-1.95, -1.95, 2.05, 2.05))
    amap = build_map(centre, laser)
    # A matter of `aliasing`: the heading is as well known in the centre as elsewhere.
    assert amap.sample("heading", 0.05, 0.05) < 0.05
    assert amap.sample("heading", 0.75, 0.35) < 0.05


@pytest.mark.slow
def test_a_wall_between_halves_the_neighbourhood(laser: RangeScanner) -> None:
    # Free space on the far side of a thin wall is no neighbour: nothing else tells left from right.
    wide = scenes.room(20.0, 20.0, np.array([10.0, 0.0, 10.0, 20.0]))
    amap = build_map(wide, laser)
    assert amap.sample("zone", 9.0, 10.0) == CORRIDOR
    assert amap.sample("zone", 11.0, 10.0) == CORRIDOR
    assert apart(amap.sample("direction", 9.6, 10.0), math.pi / 2) < 2.0


# -- bounds ------------------------------------------------------------------------------------


def test_every_layer_keeps_its_bounds(hall: AmbiguityMap, demo_map: AmbiguityMap) -> None:
    for amap in (hall, demo_map):
        free = amap.dataset["free"].values
        for layer in LAYERS:
            values = amap.dataset[layer].values
            assert np.isnan(values[~free]).all()
            assert values[free].min() >= 0.0 and values[free].max() <= 1.0
        direction = amap.dataset["direction"].values[free]
        assert direction.min() >= 0.0 and direction.max() < math.pi
        major, minor = (amap.dataset[f"{n}_radius"].values[free] for n in ("major", "minor"))
        assert (major >= minor).all() and minor.min() > 0.0
        assert (amap.dataset["zone"].values[~free] == NOT_FREE).all()


# -- figure 1 of the paper, in words -----------------------------------------------------------


def test_blue_near_corners_doors_and_furniture(demo_map: AmbiguityMap, hall: AmbiguityMap) -> None:
    for corner in ((0.5, 0.5), (1.5, 19.0), (19.5, 19.5), (18.5, 1.0)):
        assert hall.sample("zone", *corner) == LOCALIZABLE
    # The doors from the long corridor to the great hall and to the offices.
    for door in ((8.0, 13.9), (8.0, 13.0), (9.25, 12.2), (30.0, 12.3)):
        assert demo_map.sample("zone", *door) == LOCALIZABLE
    offices = {"office 1": (6.2, 6.0, 10.2, 11.8), "office 2": (10.4, 6.0, 14.2, 11.8),
               "canteen": (0.2, 0.2, 8.6, 5.8), "meeting": (0.2, 6.0, 6.0, 9.8)}  # fmt: skip
    for name, box in offices.items():
        assert (box_cells(demo_map, *box) == LOCALIZABLE).mean() > 0.97, name


def test_orange_at_one_wall_and_between_two_parallel_ones(demo_map: AmbiguityMap) -> None:
    # Between its doors the long corridor leaves the robot no hold along it.
    corridor = box_cells(demo_map, 18.0, 12.1, 25.0, 13.9)
    assert (corridor == CORRIDOR).all()
    x, y = np.meshgrid(np.linspace(18, 25, 29), np.linspace(12.2, 13.8, 9))
    assert apart(demo_map.sample("direction", x, y), 0.0) < 2.0
    # The corridor at 33 degrees, in its middle.
    along = moved([(t, 0.0) for t in np.linspace(4.5, 7.5, 13)], math.radians(33))
    x, y = along + np.array([[22.4], [1.81]])
    assert (demo_map.sample("zone", x, y) == CORRIDOR).all()
    assert apart(demo_map.sample("direction", x, y), math.radians(33)) < 2.0
    # Between equal racks.
    assert (box_cells(demo_map, 38.0, 5.5, 39.5, 6.7) == CORRIDOR).all()
    # At the hall's south wall.
    assert demo_map.sample("zone", 15.0, 15.2) == CORRIDOR


def test_red_where_nothing_is_in_range(demo_map: AmbiguityMap) -> None:
    x, y = np.meshgrid(np.linspace(14.5, 15.9, 8), np.linspace(20.5, 22.0, 8))
    assert (demo_map.sample("zone", x, y) == OPEN).all()


def test_white_is_the_border_between_the_others(hall: AmbiguityMap, demo_map: AmbiguityMap) -> None:
    for amap in (hall, demo_map):
        zone = amap.dataset["zone"].values
        for a, b in ((zone[1:], zone[:-1]), (zone[:, 1:], zone[:, :-1])):
            # Nowhere does a step lead from what is lost altogether to what is known altogether.
            assert not ((a == OPEN) & (b == LOCALIZABLE)).any()
            assert not ((a == LOCALIZABLE) & (b == OPEN)).any()
    zone = hall.dataset["zone"].values
    near = [maximum_filter(zone == z, 7)[zone == TRANSITION] for z in (LOCALIZABLE, CORRIDOR, OPEN)]
    assert (np.sum(near, axis=0) >= 2).mean() > 0.9
    assert (zone == TRANSITION).sum() < 0.1 * (zone != NOT_FREE).sum()


def test_from_the_open_to_the_wall_and_into_the_corner_the_level_falls(hall: AmbiguityMap) -> None:
    y = np.linspace(10.0, 0.3, 400)
    level = np.asarray(hall.sample("level", np.full_like(y, 10.0), y))
    assert level[0] > 0.95 and level[-1] == pytest.approx(0.5, abs=0.1)
    assert np.diff(level).max() < 0.05, "it hardly rises again"
    x = np.linspace(10.0, 0.3, 400)
    level = np.asarray(hall.sample("level", x, np.full_like(x, 0.5)))
    assert level[0] == pytest.approx(0.5, abs=0.1) and level[-1] < 0.15
    assert np.diff(level).max() < 0.05


@pytest.mark.slow
def test_environment_without_anything_in_range_of_cells_of_any_size(laser: RangeScanner) -> None:
    free = shapely.box(0.0, 0.0, 30.0, 30.0)
    empty = Environment(scenes.environment(free).segments, free)
    for spacing in (0.5, 0.25):
        amap = build_map(empty, laser, spacing=spacing, radius=0.5)
        assert amap.sample("ambiguity", 15.0, 15.0) == pytest.approx(1.0, abs=1e-5)
        assert amap.sample("level", 15.0, 15.0) == pytest.approx(1.0, abs=1e-5)
