"""What a scanner sees from places where it can be said beforehand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.geometry.extrude import extruded
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting.scan import plot_scan
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.sight import count_surfaces, look
from tests.geometry import scenes
from tests.maps import synthetic


def test_middle_of_the_hall_sees_nothing(building, laser):
    sight = look(building, laser, 21.0, 5.0, 0.0)
    assert sight.silent == sight.beams == 60
    assert (sight.surfaces, sight.directions) == (0, 0)
    assert "None of the 60 beams returns an echo" in sight.sentence


def test_corridor_sees_two_parallel_walls(building, laser):
    sight = look(building, laser, 10.0, 2.0, 0.0)
    assert (sight.surfaces, sight.directions) == (2, 1)
    # A beam at angle a returns if 1 / |sin a| <= 4: closed form.
    angle = np.arange(60) * 2 * math.pi / 60
    expected = np.abs(np.sin(angle)) >= 0.25
    assert sight.silent == 60 - expected.sum()
    assert "the position along them is not observable" in sight.sentence
    np.testing.assert_allclose(
        np.abs(sight.hit[np.isfinite(sight.distance), 1] - 2.0), 1.0, atol=1e-5
    )


def test_room_sees_all_its_walls(building, laser):
    sight = look(building, laser, 2.0, 3.5, 1.0)
    assert sight.directions == 2
    assert sight.surfaces >= 3
    assert "not observable" not in sight.sentence


def test_the_edge_of_the_unknown_is_no_surface(building, laser):
    sight = look(building, laser, 25.0, 5.0, 0.0)
    assert sight.frontier.sum() == 60 - sight.silent > 0
    assert sight.surfaces == 0
    assert "end at unknown space; no beam meets a wall" in sight.sentence


def test_its_picture_tells_the_unknown_from_echoes(building, laser):
    amap = AmbiguityMap(synthetic.dataset())
    for x, y in ((25.0, 5.0), (10.0, 2.0)):
        sight = look(building, laser, x, y, 0.0)
        axes = plot_scan(amap, sight)
        labels = {text.get_text() for text in axes.get_legend().get_texts()}
        unknown = int(sight.frontier.sum())
        echoes = int(np.isfinite(sight.distance).sum()) - unknown
        assert {f"echo ({echoes})", f"no echo ({sight.silent})"} <= labels
        assert (f"to unknown ({unknown})" in labels) == (unknown > 0)
        dots = [line for line in axes.get_lines() if line.get_marker() == "."]
        assert sum(len(line.get_xdata()) for line in dots) == echoes


@pytest.mark.parametrize("theta", [0.0, 0.7])
def test_cones_hit_what_is_nearest_in_them(building, sonar, theta):
    sight = look(building, sonar, 10.0, 2.0, theta)
    np.testing.assert_allclose(sight.distance, sonar.scan(building, 10.0, 2.0, theta))
    returned = np.isfinite(sight.distance)
    assert returned.any()
    from_sensor = np.hypot(*(sight.hit - sight.origin)[returned].T)
    np.testing.assert_allclose(from_sensor, sight.distance[returned], rtol=1e-6)
    # The ring's sensors sit 0.2 m from the robot, along their own axis.
    out = np.column_stack([np.cos(sight.axis), np.sin(sight.axis)])
    np.testing.assert_allclose(sight.origin, [10.0, 2.0] + 0.2 * out, atol=1e-12)


def test_pieces_of_one_wall_count_once():
    pieces = np.array([[0, 0, 1, 0], [2, 0.02, 3, 0], [4, 0, 5, -0.05]], dtype=float)
    assert count_surfaces(pieces) == (1, 1)
    assert count_surfaces(np.vstack([pieces, [[0, 2, 5, 2]]])) == (2, 1)
    assert count_surfaces(np.vstack([pieces, [[5, 0, 5, 2]]])) == (2, 2)
    assert count_surfaces(np.empty((0, 4))) == (0, 0)


def test_floors_and_ceilings_are_no_surfaces_that_tell_a_place():
    plan = scenes.room(40.0, 2.0)
    corridor = plan.in_space(extruded(plan, 2.5))
    sensor = RangeSensor(max_range=8.0, std=0.01, resolution=0.01)
    lidar = RangeScanner.layered(sensor, 60, np.radians([-30.0, 0.0, 30.0]), z=0.5)
    sight = look(corridor, lidar, 20.0, 1.0, 0.3)
    assert (sight.surfaces, sight.directions) == (2, 1)
    assert "the position along them is not observable" in sight.sentence
    # Drawn from above: what lies on the floor half a metre down at 30 degrees is 0.87 m away.
    down = np.isclose(sight.distance, 1.0)
    assert down.sum() > 10
    away = np.hypot(*(sight.hit[down] - sight.origin[down]).T)
    np.testing.assert_allclose(away, math.cos(math.radians(30)), rtol=1e-6)
