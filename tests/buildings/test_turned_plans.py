"""Drawn plans at any angle and any coordinates: where they adjoin depends on neither."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from tests.geometry import scenes

ANGLES = np.random.default_rng(1).uniform(0.0, 90.0, 25)
HOME, NATIONAL = (0.0, 0.0), (431234.25, 5412345.5)


def turned(
    angle: float, place: tuple[float, float], shapes: list[BaseGeometry]
) -> list[BaseGeometry]:
    return [translate(rotate(shape, angle, origin=(0, 0)), *place) for shape in shapes]


def check_rays(env: Environment, count: int = 300) -> None:
    """Compare rays with the environment's own segments, one by one, near the origin."""
    x, y = scenes.points_inside(env, count, seed=2).T
    angle = np.random.default_rng(3).uniform(-math.pi, math.pi, count)
    xmin, ymin, *_ = env.bounds
    near = env.segments.xy - (xmin, ymin, xmin, ymin)
    expected, _ = scenes.cast_slowly(near, x - xmin, y - ymin, angle)
    np.testing.assert_allclose(env.cast(x, y, angle, 50.0), expected, atol=1e-5)


@pytest.mark.parametrize("place", [HOME, NATIONAL])
@pytest.mark.parametrize("digits", [15, 3])
def test_rooms_that_share_a_stretch_of_their_edges_are_one(
    place: tuple[float, float], digits: int
) -> None:
    """Also where coordinates are written to a millimetre."""
    rooms = [shapely.box(0, 0, 6, 4), shapely.box(6, 1, 9, 3), shapely.box(2, 4, 7, 5)]
    for angle in ANGLES:
        drawn = [
            shapely.transform(room, lambda xy: np.round(xy, digits))
            for room in turned(angle, place, rooms)
        ]
        env = environment_from_shapes(drawn)
        assert isinstance(env.free, shapely.Polygon)
        # 20 + 10 + 12, less both sides of the stretches of 2 and 4 m that two of them share.
        assert env.segments.lengths.sum() == pytest.approx(30.0, abs=0.01)


def test_rooms_that_only_come_near_stay_apart() -> None:
    rooms = [shapely.box(0, 0, 6, 4), shapely.box(6.01, 1, 9, 3)]
    assert isinstance(environment_from_shapes(rooms).free, shapely.MultiPolygon)


@pytest.mark.parametrize("place", [HOME, NATIONAL])
def test_a_wall_that_goes_on_where_an_edge_ends_stays(place: tuple[float, float]) -> None:
    """Half of it lies along the side of a box, half of it in the open."""
    for angle in ANGLES:
        room, box, wall = turned(
            angle,
            place,
            [
                shapely.box(0, 0, 9, 6),
                shapely.box(2, 2, 4, 3),
                shapely.LineString([(2, 3), (6, 3)]),
            ],
        )
        env = environment_from_shapes([room], [box], [wall])
        assert env.segments.lengths.sum() == pytest.approx(30.0 + 6.0 + 2.0, abs=1e-6)


@pytest.mark.parametrize("place", [HOME, NATIONAL])
def test_rays_end_at_thin_walls_and_boxes_that_touch(place: tuple[float, float]) -> None:
    """Bent and crossing walls, boxes in a row or flush with a wall, a corner on its middle."""
    room = [shapely.box(0, 0, 9, 7)]
    boxes = [
        shapely.box(1, 5, 2, 6), shapely.box(2, 6, 3, 7), shapely.box(7, 1, 9, 2),
        shapely.Polygon([(9, 3.5), (8, 4.5), (8, 2.5)]),
    ]  # fmt: skip
    walls = [
        shapely.LineString([(2, 1), (2, 3), (4, 3)]), shapely.LineString([(7, 7), (5, 0.5)]),
        shapely.LineString([(5, 5), (7, 2), (7, 1)]),
    ]  # fmt: skip
    for angle in ANGLES:
        parts = [turned(angle, place, shapes) for shapes in (room, boxes, walls)]
        check_rays(environment_from_shapes(*parts))


def test_a_ray_along_the_line_of_a_wall_behind_it() -> None:
    """From a point on an edge of the triangulation, which goes on where the wall ends."""
    rooms = [shapely.box(0, 0, 9, 5), shapely.box(9, 1, 12, 3)]
    boxes = [shapely.box(1, 0, 2, 1), shapely.box(2, 1, 3, 2), shapely.box(3, 3, 4, 4)]
    env = environment_from_shapes(rooms, boxes)
    x, y = np.meshgrid(np.arange(0.5, 9.0, 0.5), np.arange(0.5, 5.0, 0.5))
    free = env.is_free(x, y) & (np.asarray(env.clearance(x, y)) > 0.01)
    x, y = x[free], y[free]
    for angle in np.arange(8) * math.pi / 4:
        got = env.cast(x, y, np.full(len(x), angle), 50.0)
        beside = [
            scenes.cast_slowly(env.segments.xy, x, y, np.full(len(x), angle + side))[0]
            for side in (-1e-7, 1e-7)
        ]
        assert (got > np.minimum(*beside) - 1e-4).all() and (got < np.maximum(*beside) + 1e-4).all()
