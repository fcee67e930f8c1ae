"""The bundled building is what its script draws, and has what the demo wants to show."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import shapely
import shapely.geometry
from skimage.graph import MCP_Geometric

import ambinav

CONFIGS = Path(__file__).parents[1] / "configs"
ROBOT_RADIUS = 0.25


def drawing_script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_demo", CONFIGS / "draw_demo.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def shapes() -> list[tuple[str, str, shapely.Geometry]]:
    features = json.loads((CONFIGS / "demo.geojson").read_text())["features"]
    return [
        (f["properties"]["kind"], f["properties"]["name"], shapely.geometry.shape(f["geometry"]))
        for f in features
    ]


@pytest.fixture(scope="module")
def free(shapes) -> shapely.Polygon:
    """Rooms less obstacles, made without the loader under test."""
    rooms = shapely.union_all([shape for kind, _, shape in shapes if kind == "room"])
    return rooms - shapely.union_all([shape for kind, _, shape in shapes if kind == "obstacle"])


@pytest.fixture(scope="module")
def drivable(shapes, free) -> shapely.Geometry:
    """Where the middle of a round robot can be."""
    walls = shapely.union_all([shape for kind, _, shape in shapes if kind == "wall"])
    return free.buffer(-ROBOT_RADIUS) - walls.buffer(ROBOT_RADIUS)


def named(shapes, name: str) -> shapely.Geometry:
    (shape,) = [shape for _, label, shape in shapes if label == name]
    return shape


def path_length(
    region: shapely.Geometry, start: tuple[float, float], goal: tuple[float, float]
) -> float:
    """Length of the shortest 8-connected way on a 10 cm lattice, metres."""
    step = 0.1
    x, y = np.meshgrid(np.arange(0, 45, step), np.arange(0, 29, step))
    costs = np.where(shapely.contains_xy(region, x, y), 1.0, -1.0)
    cell = [(round(py / step), round(px / step)) for px, py in (start, goal)]
    cumulative, _ = MCP_Geometric(costs).find_costs([cell[0]], [cell[1]])
    return float(cumulative[cell[1]]) * step


def test_committed_file_is_what_the_script_draws():
    assert (CONFIGS / "demo.geojson").read_text(encoding="utf-8") == drawing_script().draw()


def test_every_shape_is_valid_and_named(shapes):
    assert all(shape.is_valid and not shape.is_empty and name for _, name, shape in shapes)
    assert {kind for kind, _, _ in shapes} == {"room", "obstacle", "wall"}


def test_size(free):
    assert free.geom_type == "Polygon"
    xmin, ymin, xmax, ymax = free.bounds
    assert 40 < xmax - xmin <= 45
    assert 25 < ymax - ymin <= 30


def test_a_robot_gets_everywhere(drivable):
    assert drivable.geom_type == "Polygon"


def test_the_hall_is_wider_than_the_range(shapes, free):
    centre = named(shapes, "great hall").centroid
    assert free.contains(centre.buffer(5.0))


def test_the_long_corridor_is_bare_for_more_than_fifteen_metres(shapes, free):
    xmin, ymin, xmax, ymax = named(shapes, "long corridor").bounds
    assert (xmax - xmin, ymax - ymin) == pytest.approx((25.0, 2.0))
    around = shapely.box(13.6, ymin - 0.1, 29.3, ymax + 0.1)
    assert free.intersection(around).area == pytest.approx((29.3 - 13.6) * 2.0)


@pytest.mark.parametrize("degrees", [17, 33])
def test_corridors_at_odd_angles(shapes, degrees):
    corners = np.asarray(named(shapes, f"corridor at {degrees} degrees").exterior.coords)
    side = np.diff(corners, axis=0)
    longest = side[np.argmax(np.hypot(*side.T))]
    angle = np.degrees(np.arctan2(longest[1], longest[0])) % 180
    assert angle == pytest.approx(degrees, abs=0.02)  # corners are rounded to the millimetre


def test_the_round_room_is_round(shapes):
    room = named(shapes, "round room")
    distance = np.hypot(*(np.asarray(room.exterior.coords) - [38.5, 24.5]).T)
    assert len(distance) == 64 + 1
    assert distance == pytest.approx(3.0, abs=1e-3)


def test_the_racks_are_equal_and_equally_spaced(shapes):
    bounds = np.array([shape.bounds for _, name, shape in shapes if name == "rack"])
    size = bounds[:, 2:] - bounds[:, :2]
    assert size == pytest.approx(np.broadcast_to(size[0], size.shape))
    assert np.ptp(np.diff(np.sort(bounds[:, 1]))) == pytest.approx(0, abs=1e-9)


def test_the_furnished_way_is_little_longer_than_the_bare_one(shapes, drivable):
    start, goal = (3.0, 13.0), (33.0, 13.0)
    bare = path_length(drivable, start, goal)
    offices = drivable - named(shapes, "long corridor") - named(shapes, "great hall")
    assert bare == pytest.approx(30.0, abs=1.0)
    assert bare < path_length(offices, start, goal) < 1.25 * bare


def test_the_loader_finds_the_same_free_space(free):
    environment = ambinav.load_environment(CONFIGS / "demo.geojson")
    assert environment.bounds == pytest.approx(free.bounds, abs=1e-6)
    assert environment.free.symmetric_difference(free).area < 1e-6
