"""Shortest routes between random places, against closed forms and exact polygons."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.reach import find_reach
from ambinav.routes.sampled import PlaceGraph, explored, sample_routes
from ambinav.runtime.errors import InputError, InputWarning

RADIUS = 0.3
CORNER = shapely.Polygon([(0, 0), (10, 0), (10, 10), (8, 10), (8, 2), (0, 2)])


@pytest.fixture(scope="module")
def corner():
    return environment_from_shapes([CORNER], name="corner")


@pytest.fixture(scope="module")
def graph(corner):
    return PlaceGraph.of(corner, find_reach(corner, RADIUS))


def nearest(graph, x, y):
    return int(np.hypot(*(graph.points - (x, y)).T).argmin())


def length(points):
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def around_corner(start, goal):
    """Length of the shortest path of a disc around the inner corner (8, 2): tangents and arc."""
    centre = np.array([8.0, 2.0])
    straight, bearings, tangents = 0.0, [], 0.0
    for end in (start, goal):
        away = np.asarray(end) - centre
        far = float(np.hypot(*away))
        straight += math.sqrt(far**2 - RADIUS**2)
        bearings.append(math.atan2(away[1], away[0]))
        tangents += math.acos(RADIUS / far)
    # On the side of the corner where there is floor.
    turned = (bearings[1] - bearings[0]) % (2 * math.pi) - tangents
    return straight + RADIUS * turned


def test_around_a_corner_a_route_is_as_short_as_a_disc_can_go(graph):
    for ends in (((0.55, 0.55), (9.55, 9.55)), ((0.35, 1.65), (8.35, 9.65))):
        start, goal = (nearest(graph, *end) for end in ends)
        exact = around_corner(graph.points[start], graph.points[goal])
        found = length(graph.shortest(start, goal))
        assert exact * (1 - 1e-3) <= found <= 1.005 * exact


def test_where_nothing_is_in_between_it_is_straight(graph):
    start, goal = nearest(graph, 1.0, 1.0), nearest(graph, 7.0, 1.5)
    assert np.array_equal(graph.shortest(start, goal), graph.points[[start, goal]])
    assert np.array_equal(graph.shortest(start, start), graph.points[[start]])


def test_all_of_it_lies_where_the_disc_fits(corner):
    reach = find_reach(corner, RADIUS)
    routes = sample_routes(corner, reach, 12, np.random.default_rng(3))
    inside = shapely.buffer(reach.floor, 2e-3)  # of chords, and a tangent at exactly the radius
    for route in routes:
        assert inside.contains(shapely.LineString(route.poses[:, :2]))
        step = np.diff(route.poses[:, :2], axis=0)
        assert np.allclose(np.arctan2(step[:, 1], step[:, 0]), route.poses[:-1, 2])
    ends = np.array([route.poses[[0, -1], :2] for route in routes]).reshape(-1, 2)
    assert (ends[:, 1] > 2.0).any() and (ends[:, 0] < 7.0).any()  # in both legs


def test_the_generator_alone_decides(corner):
    reach = find_reach(corner, RADIUS)
    one, same, other = (
        sample_routes(corner, reach, 3, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert all(np.array_equal(a.poses, b.poses) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0].poses[0], other[0].poses[0])


def test_floor_beyond_the_end_of_the_map_is_left_out():
    # A room of 4 x 4 m with a court in front of it that the map ends in on three sides.
    room, court = shapely.box(0, 0, 4, 4), shapely.box(4, -6, 20, 10)
    rim = [(4, 10), (20, 10), (20, -6), (4, -6)]
    env = environment_from_shapes(
        [room, court], walls=[[(4, 0), (4, 1)], [(4, 3), (4, 4)]], openings=[rim], name="court"
    )
    x, y = np.array([1.0, 2.0, 12.0, 18.0]), np.array([1.0, 3.0, 2.0, 8.0])
    assert explored(env, x, y).tolist() == [True, True, False, False]
    found = PlaceGraph.of(env, find_reach(env, 0.3))
    assert found.points[:, 0].max() < 12.0 and found.points[:, 0].min() < 1.0


def test_a_passage_that_the_lattice_misses_is_said():
    # Two rooms, and a doorway of 0.62 m: the centre of a disc of 0.3 m has 2 cm.
    walls = [[(4, 0), (4, 1.19)], [(4, 1.81), (4, 3)]]
    env = environment_from_shapes([shapely.box(0, 0, 10, 3)], walls=walls, name="two rooms")
    reach = find_reach(env, 0.3)
    with pytest.warns(InputWarning, match=r"two rooms: routes are sampled on 6\d % of the explor"):
        found = PlaceGraph.of(env, reach, 0.25)
    assert found.points[:, 0].min() > 4.0


def test_what_cannot_be_sampled_is_refused(corner):
    reach = find_reach(corner, RADIUS)
    with pytest.raises(InputError, match="routes is 0; give a whole number"):
        sample_routes(corner, reach, 0, np.random.default_rng(0))
    open_field = environment_from_shapes(bbox=(0, 0, 5, 5), name="field")
    with pytest.warns(InputWarning, match="touches the rim of the map"):
        reach = find_reach(open_field, 0.3)
    with pytest.raises(InputError, match=r"field: no two places .* give routes of your own"):
        sample_routes(open_field, reach, 1, np.random.default_rng(0))
