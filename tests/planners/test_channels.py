"""Channels hardly wider than the robot are found and used; narrower ones are none."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import affinity

import ambinav as an
from ambinav.service.service import AmbiguityService
from ambinav_planners import NoPathError, RoutePlanner
from ambinav_planners.search.channels import channel_poses
from tests.planners.conftest import LASER

RADIUS = 0.2


def robot_in(floor: shapely.Geometry, spacing: float = 0.2, weight: float = 0.0) -> RoutePlanner:
    """A disc of 0.2 m in the largest part of a floor."""
    parts = [part for part in shapely.get_parts(floor) if part.area > 0.1]
    scanner = an.RangeScanner.planar(sensor=LASER, beams=24, aperture=2.0 * math.pi)
    amap = an.build_map(an.environment_from_shapes(parts), scanner, spacing=spacing)
    return RoutePlanner(AmbiguityService(amap, weight=weight), footprint=RADIUS)


def slot(middle: float, room: float, lean: float, thick: float) -> shapely.Geometry:
    """8 by 5 m, parted by a wall with one slot of the robot's width and some room, leaning."""
    wall = shapely.box(4.0 - thick / 2.0, -1.0, 4.0 + thick / 2.0, 6.0)
    half = RADIUS + 0.5 * room
    gap = affinity.rotate(
        shapely.box(2.0, middle - half, 6.0, middle + half), lean, origin=(4.0, middle)
    )
    return shapely.box(0, 0, 8, 5).difference(wall.difference(gap))


@pytest.mark.sweep
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    middle=st.floats(1.0, 4.0),
    room=st.sampled_from([0.0005, 0.001, 0.005, 0.01, 0.03, 0.1]),
    lean=st.floats(-35.0, 35.0),
    thick=st.sampled_from([0.05, 0.2, 0.8]),
    spacing=st.sampled_from([0.1, 0.2, 0.4]),
)
def test_the_reference_goes_through_every_slot_that_is_wide_enough(
    middle: float, room: float, lean: float, thick: float, spacing: float
) -> None:
    floor = slot(middle, room, lean, thick)
    route = robot_in(floor, spacing).plan((1, 1), (7, 4), planner_name="reference")
    # Nothing is shorter than the string through the slot, and it is nearly that.
    free = floor.buffer(-RADIUS + 1e-6, quad_segs=64)
    line = shapely.LineString(route.poses[:, :2])
    assert line.difference(free.buffer(1e-5)).length < 1e-3
    through = np.hypot(3.0, middle - 1.0) + np.hypot(3.0, 4.0 - middle)
    assert route.length <= through + 0.5 * thick + 0.3


@pytest.mark.parametrize("lean", [0.0, 20.0])
def test_a_slot_that_is_too_narrow_is_none(lean: float) -> None:
    with pytest.raises(NoPathError):
        robot_in(slot(2.53, -0.002, lean, 0.2)).plan((1, 1), (7, 4), planner_name="reference")


@pytest.mark.parametrize("weight", [0.0, 5.0])
def test_a_bent_channel_is_the_cheaper_way(weight: float) -> None:
    """A quarter of a ring, 1 cm wider than the robot, saves the path round a wall."""
    ring = shapely.Point(3.0, 0.0).buffer(1.5 + 0.205, quad_segs=64)
    ring = ring.difference(shapely.Point(3.0, 0.0).buffer(1.5 - 0.205, quad_segs=64))
    rooms = shapely.union_all([shapely.box(0.5, -1.6, 2.5, 0.0), shapely.box(3.0, 0.6, 5.0, 2.6)])
    quarter = ring.intersection(shapely.box(0.0, -0.1, 3.1, 3.0))
    detour = shapely.union_all(
        [shapely.box(0.5, -3.0, 1.5, -1.5), shapely.box(0.5, -3.0, 7.0, -2.0),
         shapely.box(6.0, -3.0, 7.0, 2.6), shapely.box(4.5, 1.6, 7.0, 2.6)]
    )  # fmt: skip
    robot = robot_in(shapely.union_all([rooms, quarter, detour]), 0.2, weight)
    route = robot.plan((1.5, -0.5), (4.0, 1.5), planner_name="reference")
    assert route.length < 4.0  # the path round has more than 13 m


def test_an_empty_room_has_no_channel() -> None:
    robot = robot_in(shapely.box(0, 0, 6, 5))
    dataset = robot.service.map.dataset
    cells = dataset["x"].values, dataset["y"].values, dataset["free"].values, 0.2
    assert channel_poses(*cells, robot.checker).shape == (0, 3)


def test_points_stand_in_the_middle_of_a_corridor() -> None:
    lean = math.radians(17.0)
    corridor = affinity.rotate(shapely.box(1.0, 2.0, 7.0, 2.43), 17.0, origin=(4.0, 2.2))
    floor = shapely.union_all([shapely.box(0, 0, 2, 3), corridor, shapely.box(6, 2, 8, 4)])
    robot = robot_in(floor)
    dataset = robot.service.map.dataset
    cells = dataset["x"].values, dataset["y"].values, dataset["free"].values, 0.2
    found = channel_poses(*cells, robot.checker)[:, :2]
    inside = found[(found[:, 0] > 2.5) & (found[:, 0] < 5.5)]
    normal = np.array([-math.sin(lean), math.cos(lean)])
    middle = normal @ (np.array([4.0, 2.2]) + (2.215 - 2.2) * normal)
    np.testing.assert_allclose(inside @ normal, middle, atol=1e-4)
    along = np.sort(inside @ np.array([math.cos(lean), math.sin(lean)]))
    assert np.diff(along).max() < 0.15
