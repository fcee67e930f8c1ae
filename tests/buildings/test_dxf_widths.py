"""Polylines with a width, against the walls that they stand for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import shapely
import shapely.affinity

from tests.buildings.test_dxf import differ, loaded, rectangle


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_the_width_of_a_polyline_is_that_of_its_wall(
    tmp_path: Path, angle: float, old: bool
) -> None:
    turned = shapely.affinity.rotate(shapely.box(0.1, 0.1, 6.1, 4.1), angle, (0, 0), True)
    middle = shapely.get_coordinates(turned)[:-1]

    def draw(space: Any) -> None:
        if old:
            points = [(x, y, 0.2, 0.2) for x, y in middle]
            space.add_polyline2d(points, format="xyse", close=True, dxfattribs={"layer": "Walls"})
        else:
            wall = space.add_lwpolyline(middle, close=True, dxfattribs={"layer": "Walls"})
            wall.dxf.const_width = 0.2

    env = loaded(tmp_path, draw)
    assert differ(env.free, shapely.buffer(turned, -0.1, join_style="mitre")) < 1e-5


def test_polylines_of_several_widths_and_with_arcs(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        rectangle(space, shapely.box(-4.0, -1.0, 4.0, 6.0), "Walls")
        # A wall from 0.4 to 0.2 thick, one that is a line, and half a ring around (0, 0), whose
        # chords are within 1 mm.
        parts = [(-3, 3, 0.4, 0.2, 0), (0, 3, 0.0, 0.0, 0), (2, 3, 0.0, 0.0, 0)]
        space.add_lwpolyline(parts, format="xyseb", dxfattribs={"layer": "Walls"})
        ring = [(2, 0, 0.3, 0.3, 1), (-2, 0, 0.3, 0.3, 0)]
        space.add_lwpolyline(ring, format="xyseb", dxfattribs={"layer": "Walls"})

    env = loaded(tmp_path, draw)
    wedge = shapely.Polygon([(-3, 3.2), (-3, 2.8), (0, 2.9), (0, 3.1)])
    circles = [shapely.Point(0, 0).buffer(radius, 1000) for radius in (1.85, 2.15)]
    half = shapely.intersection(circles[1] - circles[0], shapely.box(-3, 0, 3, 3))
    assert differ(env.free, shapely.box(-4.0, -1.0, 4.0, 6.0) - wedge - half) < 1e-3 * math.pi * 4.0
    line = (env.segments.xy[:, [1, 3]] == 3.0).all(axis=1)
    assert env.segments.lengths[line].max() == pytest.approx(2.0)
