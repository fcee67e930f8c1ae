"""Discs and polygons: their radii, shapes and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.geometry.footprint import Footprint
from ambinav.runtime.errors import InputError

FORK = [
    (-0.3, -0.4), (0.5, -0.4), (0.5, -0.2), (0.1, -0.2), (0.1, 0.2), (0.5, 0.2), (0.5, 0.4),
    (-0.3, 0.4),
]  # fmt: skip


def test_disc() -> None:
    disc = Footprint.disc(0.25)
    assert disc.is_disc and disc.inner == disc.outer == 0.25
    assert disc.shape.area == pytest.approx(math.pi * 0.25**2, rel=1e-3)
    assert repr(disc) == "Footprint.disc(0.25)"


def test_point() -> None:
    point = Footprint.disc(0.0)
    assert point.inner == point.outer == 0.0
    assert point.placed(np.array([[1.0, 2.0, 3.0]]))[0].equals(shapely.Point(1, 2))


def test_polygon_radii() -> None:
    box = Footprint.polygon([(-0.2, -0.3), (0.6, -0.3), (0.6, 0.3), (-0.2, 0.3)])
    assert not box.is_disc
    assert box.inner == pytest.approx(0.2)
    assert box.outer == pytest.approx(math.hypot(0.6, 0.3))
    assert box.shape.equals(shapely.box(-0.2, -0.3, 0.6, 0.3))
    assert "polygon" in repr(box)


def test_origin_outside_has_no_inner_disc() -> None:
    trailer = Footprint.polygon([(-2.0, -0.5), (-1.0, -0.5), (-1.0, 0.5), (-2.0, 0.5)])
    assert trailer.inner == 0.0
    assert trailer.outer == pytest.approx(math.hypot(2.0, 0.5))


def test_order_and_closing_corner_do_not_matter() -> None:
    first = Footprint.polygon(FORK)
    second = Footprint.polygon([*FORK[::-1], FORK[-1]])
    assert len(first.corners) == len(second.corners) == len(FORK)
    assert first.shape.equals(second.shape)
    assert shapely.Polygon(second.corners).exterior.is_ccw


def test_placed_turns_and_shifts() -> None:
    poses = np.array([[1.0, 2.0, 0.7], [-3.0, 0.5, -2.0]])
    shape = Footprint.polygon(FORK).shape
    for placed, (x, y, theta) in zip(Footprint.polygon(FORK).placed(poses), poses, strict=True):
        turned = shapely.affinity.rotate(shape, theta, origin=(0, 0), use_radians=True)
        expected = shapely.affinity.translate(turned, x, y)
        assert placed.symmetric_difference(expected).area < 1e-12


@pytest.mark.parametrize("radius", [-0.1, math.nan, math.inf])
def test_bad_radius(radius: float) -> None:
    with pytest.raises(InputError, match=f"radius is {radius}"):
        Footprint.disc(radius)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0), (1, 0)], "2 corners make no polygon"),
        ([(0, 0), (1, 0), (0, 0)], "2 corners"),
        ([(0, 0), (1, 0), (2, 0)], "no simple polygon"),
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "Self-intersection"),
        ([(0, 0), (1, math.nan), (1, 0)], r"corner 1 is \[1.0, nan\]"),
        ([(0, 0, 0), (1, 0, 0), (1, 1, 0)], r"shape \(3, 3\)"),
        ([(0, 0), (1,), (2, 2)], "not numbers"),
    ],
)
def test_bad_polygons(points: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Footprint.polygon(points)  # type: ignore[arg-type]
