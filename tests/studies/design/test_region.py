"""Regions give the floor and the metres that they are drawn over."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from ambinav.geometry.lattice import Lattice
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.studies.design.region import ALL_HEADINGS, Region
from tests.geometry import scenes

HEADINGS = 2 * math.pi * np.arange(8) / 8


@pytest.fixture(scope="module")
def lattice() -> Lattice:
    return Lattice.over(scenes.room(6.0, 4.0), 0.1)


def test_the_whole_map_is_all_of_its_floor(lattice: Lattice) -> None:
    places = Region.of_map().places(lattice, HEADINGS)
    assert places.weight.sum() == pytest.approx(24.0)
    assert (places.heading == ALL_HEADINGS).all()
    assert not places.is_sample


def test_a_polygon_is_the_floor_within_it(lattice: Lattice) -> None:
    # Half of it lies outside of the room.
    region = Region.of_polygon(shapely.box(-1.0, 1.0, 1.0, 3.0), "west end")
    places = region.places(lattice, HEADINGS)
    x, y = (axis[places.point] for axis in lattice.points)
    assert places.weight.sum() == pytest.approx(2.0)
    assert x.max() < 1.0
    assert 1.0 < y.min() < y.max() < 3.0


def test_a_polygon_is_read_from_a_file(lattice: Lattice, tmp_path: Path) -> None:
    path = tmp_path / "zone.geojson"
    path.write_text(json.dumps(shapely.geometry.mapping(shapely.box(1, 1, 2, 3))))
    places = Region.of_file(path).places(lattice, HEADINGS)
    assert places.weight.sum() == pytest.approx(2.0)


def test_a_file_without_polygons_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "zone.wkt"
    path.write_text("LINESTRING(0 0, 1 1)")
    with pytest.raises(InputError, match="it is a LineString; give polygons"):
        Region.of_file(path)
    path = tmp_path / "zone.geojson"
    path.write_text('{"type": "FeatureCollection", "features": []}')
    with pytest.raises(InputError, match="it holds no polygon; draw one"):
        Region.of_file(path)


def test_polygons_of_a_file_add_up(tmp_path: Path) -> None:
    """They are no plan: one within another is no obstacle, and none has a kind, level or unit."""
    shapes = {
        "outer": shapely.box(0.0, 0.0, 4.0, 4.0),
        "nested": shapely.box(1.0, 1.0, 2.0, 2.0),
        "crossing": shapely.box(3.0, 3.0, 5.0, 5.0),
        "small and far": shapely.box(2000.0, 0.0, 2000.3, 0.4),
    }
    properties = ({"kind": "lane"}, {"level": "EG"}, {"level": "OG", "thickness": "x"}, None)
    features = [
        {"type": "Feature", "properties": each, "geometry": shapely.geometry.mapping(shape)}
        for each, shape in zip(properties, shapes.values(), strict=True)
    ]
    drawn = tmp_path / "zones.geojson"
    drawn.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    words = tmp_path / "zones.wkt"
    words.write_text("\n".join(shape.wkt for shape in shapes.values()))
    for path in (drawn, words):
        shape = Region.of_file(path).shape
        assert shape is not None
        assert shape.area == pytest.approx(16.0 + 3.0 + 0.12)


def test_a_route_counts_its_metres_at_its_headings(lattice: Lattice) -> None:
    route = Route.through([[0.5, 0.55], [4.5, 0.55], [4.5, 2.5]])
    places = Region.of_route(route).places(lattice, HEADINGS)
    assert places.weight.sum() == pytest.approx(5.95)
    assert set(places.heading.tolist()) == {0, 2}
    assert places.weight[places.heading == 2].sum() == pytest.approx(1.95)


def test_a_reversing_curve_keeps_its_heading(lattice: Lattice) -> None:
    steering = Steering("reeds-shepp", 0.5)
    route = Route.through([[3.0, 2.0, 0.0], [1.0, 2.0, 0.0]], steering)
    places = Region.of_route(route).places(lattice, HEADINGS)
    assert set(places.heading.tolist()) == {0}
    assert places.weight.sum() == pytest.approx(2.0)


def test_a_sample_stands_for_all_and_is_spread_evenly(lattice: Lattice) -> None:
    places = Region.of_map().places(lattice, HEADINGS)
    few = places.sampled(lattice, 96, np.random.default_rng(3))
    assert len(few) == 96
    assert few.is_sample
    assert few.weight.sum() == pytest.approx(24.0)
    x, y = (axis[few.point] for axis in lattice.points)
    # Of the four quarters none has more than a few too many.
    counts, _, _ = np.histogram2d(x, y, bins=2, range=[[0, 6], [0, 4]])
    assert np.abs(counts - 24).max() <= 4
    again = places.sampled(lattice, 96, np.random.default_rng(3))
    assert (again.point == few.point).all()
    assert places.sampled(lattice, len(places), np.random.default_rng(3)) is places


def test_a_sample_of_a_route_is_as_likely_as_it_is_long(lattice: Lattice) -> None:
    route = Route.through([[0.5, 0.55], [4.5, 0.55], [4.5, 2.5]])
    places = Region.of_route(route).places(lattice, HEADINGS)
    metres = []
    for seed in range(20):
        few = places.sampled(lattice, 20, np.random.default_rng(seed))
        metres.append(few.among(few.heading == 2).weight.sum())
    assert np.mean(metres) == pytest.approx(1.95, abs=0.2)


def test_a_polygon_beside_the_floor_is_refused(lattice: Lattice) -> None:
    region = Region.of_polygon(shapely.box(10, 10, 12, 12), "far")
    with pytest.raises(InputError, match="region far: the robot can be at no point of it"):
        region.places(lattice, HEADINGS)


def test_a_route_that_leaves_the_floor_is_refused(lattice: Lattice) -> None:
    region = Region.of_route(Route.through([[1, 1], [9, 1]]))
    with pytest.raises(InputError, match=r"first at \(6\."):
        region.places(lattice, HEADINGS)


@pytest.mark.parametrize(
    ("shape", "what"),
    [
        (shapely.LineString([[0, 0], [1, 1]]), "without area"),
        (shapely.Polygon(), "without area"),
        (shapely.Polygon([[0, 0], [1, 0], [1, 1], [math.inf, 1]]), "not finite"),
    ],
)
def test_what_is_no_polygon_is_refused(shape: shapely.Geometry, what: str) -> None:
    with pytest.raises(InputError, match=what):
        Region.of_polygon(shape)


def test_a_route_on_the_spot_is_refused() -> None:
    with pytest.raises(InputError, match="covers no distance"):
        Region.of_route(Route.through([[1, 1, 0], [1, 1, 1]], Steering("se2")))
