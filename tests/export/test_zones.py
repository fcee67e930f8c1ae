"""Zones as GeoJSON, Lanelet2 and in Autoware's thresholds, read by shapely and by lanelet2."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.export.formats.autoware import LATERAL, LONG, level, sizes
from ambinav.export.formats.covariance import covariance_grid
from ambinav.export.formats.lanelet2 import without_holes
from ambinav.export.formats.nav2_path import dense_poses
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.maps.judged_floor import JUDGED
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.routes.files import load_route
from ambinav.runtime.errors import InputError, InputWarning
from tests import recorded

Write = Callable[..., tuple[Path, ...]]


def check_geojson(path: Path) -> list[tuple[shapely.Polygon, dict[str, object]]]:
    """The polygons of a file, by the rules of RFC 7946 for them."""
    whole = json.loads(path.read_text())
    assert whole["type"] == "FeatureCollection"
    found = []
    for feature in whole["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        assert feature["geometry"]["type"] == "Polygon"
        for k, ring in enumerate(feature["geometry"]["coordinates"]):
            assert len(ring) >= 4
            assert ring[0] == ring[-1]
            assert shapely.is_ccw(shapely.LinearRing(ring)) == (k == 0)
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        assert shape.is_valid
        found.append((shape, feature["properties"]))
    return found


def floor(amap: an.AmbiguityMap) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres of all cells, and the zone at each of judged floor, read as a user reads it."""
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    judged = np.asarray(amap.sample("judged", x, y)) == JUDGED
    return x, y, np.where(judged, amap.sample("zone", x, y), np.nan)


def test_geojson_covers_the_zones(write: Write, amap: an.AmbiguityMap) -> None:
    features = check_geojson(write("zones-geojson", "z.geojson", least_area=0.0)[0])
    x, y, zone = floor(amap)
    for name, code in (("corridor", CORRIDOR), ("open", OPEN)):
        shape = shapely.union_all(
            [one for one, properties in features if properties["zone"] == name]
        )
        np.testing.assert_array_equal(shapely.contains_xy(shape, x, y), zone == code)
    for shape, properties in features:
        assert properties["area_m2"] == pytest.approx(shape.area, abs=1e-3)
        inside = shapely.contains_xy(shape, x, y)
        along = amap.dataset["major_radius"].values[inside].max()
        assert 0.0 < properties["std_across_m"] <= properties["std_along_m"] <= along + 1e-4


def test_files_say_that_they_are_in_the_map_frame(write: Write, route: Path) -> None:
    for kind, options in (("zones-geojson", {}), ("route-geojson", {"routes": (route,)})):
        document = json.loads(write(kind, f"{kind}.geojson", **options)[0].read_text())
        assert MAP_FRAME.items() <= document.items()


def test_the_corridor_is_told_along_itself(write: Write) -> None:
    features = check_geojson(write("zones-geojson", "z.geojson", zones=("corridor",))[0])
    point = shapely.Point(7.1, 1.7)
    (properties,) = [properties for shape, properties in features if shape.contains(point)]
    turned = math.radians(properties["weak_direction_deg"])
    assert abs(math.sin(turned)) < 0.05
    assert properties["std_along_m"] > 5 * properties["std_across_m"]


def test_small_pieces_are_left_out(write: Write) -> None:
    path = write("zones-geojson", "z.geojson", least_area=5.0)[0]
    features = check_geojson(path)
    assert features
    assert all(properties["area_m2"] >= 5.0 for _, properties in features)
    left_out = json.loads(path.read_text())["left_out_m2"]
    every = write("zones-geojson", "all.geojson", least_area=0.0)[0]
    areas = [sum(shape.area for shape, _ in found) for found in (features, check_geojson(every))]
    assert left_out == pytest.approx(areas[1] - areas[0], abs=2e-3) and left_out > 0.0
    assert json.loads(every.read_text())["left_out_m2"] == 0.0


def osm_polygons(path: Path) -> list[tuple[shapely.Polygon, dict[str, str]]]:
    root = ElementTree.parse(path).getroot()
    assert (root.tag, root.get("version")) == ("osm", "0.6")
    nodes = {}
    for node in root.iter("node"):
        tags = {tag.get("k"): float(tag.get("v") or "nan") for tag in node.iter("tag")}
        nodes[node.get("id")] = (tags["local_x"], tags["local_y"])
    found = []
    for way in root.iter("way"):
        assert way.get("id") not in nodes
        tags = {tag.get("k"): tag.get("v") for tag in way.iter("tag")}
        assert (tags["type"], tags["area"]) == ("degenerate_area", "yes")
        found.append((shapely.Polygon([nodes[nd.get("ref")] for nd in way.iter("nd")]), tags))
    return found


def test_lanelet2_xml(write: Write, amap: an.AmbiguityMap) -> None:
    found = osm_polygons(write("zones-lanelet2", "z.osm", least_area=0.0)[0])
    x, y, zone = floor(amap)
    for name, code in (("corridor", CORRIDOR), ("open", OPEN)):
        shapes = [shape for shape, tags in found if tags["subtype"] == name]
        assert all(shape.is_valid for shape in shapes)
        whole = shapely.union_all(shapes)
        # Outlines are smoothed by less than a cell.
        inner = shapely.contains_xy(whole.buffer(-0.75 * amap.spacing), x, y)
        assert (zone[inner] == code).all()
        assert whole.area == pytest.approx((zone == code).sum() * amap.cell_area, rel=0.1)


def test_lanelet2_reads_it(write: Write) -> None:
    """The library itself: polygons with their type, at their places."""
    pytest.importorskip("lanelet2")
    from lanelet2.io import Origin, load
    from lanelet2.projection import LocalCartesianProjector

    path = write("zones-lanelet2", "z.osm", least_area=0.0)[0]
    loaded = load(str(path), LocalCartesianProjector(Origin(0.0, 0.0, 0.0)))
    theirs = sorted(loaded.polygonLayer, key=lambda one: one.id)
    for one, (mine, tags) in zip(theirs, osm_polygons(path), strict=True):
        assert one.attributes["type"] == "degenerate_area"
        assert one.attributes["subtype"] == tags["subtype"]
        their = shapely.Polygon([(p.x, p.y) for p in one])
        assert shapely.hausdorff_distance(mine, their) < 0.001


def check_areas(path: Path, cell: float) -> float:
    """Every way is a simple ring of a cell or more, and its `area_m2` is its own; their sum."""
    polygons = osm_polygons(path)
    for shape, tags in polygons:
        assert shape.is_valid and shape.exterior.is_simple
        assert shape.area >= cell * (1.0 - 1e-2)
        assert float(tags["area_m2"]) == pytest.approx(shape.area, abs=1e-3)
    return float(sum(shape.area for shape, _ in polygons))


def test_lanelet2_areas_are_those_of_the_ways(write: Write, amap: an.AmbiguityMap) -> None:
    path = write("zones-lanelet2", "z.osm", least_area=0.0)[0]
    area = check_areas(path, amap.cell_area)
    _, _, zone = floor(amap)
    assert area == pytest.approx(np.isin(zone, (CORRIDOR, OPEN)).sum() * amap.cell_area, rel=0.1)
    assert ElementTree.parse(path).getroot().get("left_out_m2") == "0"


@pytest.mark.slow(kept=("maps_from_logs-freiburg-079-hc-sr04-0.4",))
@pytest.mark.parametrize(
    ("folder", "name", "preset", "spacing"),
    [
        ("maps_from_logs", "freiburg-079", "hc-sr04", 0.4),
        ("maps_from_logs", "belgioioso", "turtlebot3-lds", 0.2),
        ("maps", "stata_basement", "hc-sr04", 0.4),
    ],
)
def test_lanelet2_areas_on_recorded_maps(
    write: Write, data_dir: Path, folder: str, name: str, preset: str, spacing: float
) -> None:
    """Pieces with hundreds of holes: each way had the area of the whole piece in its tags."""
    environment, _ = recorded.read(data_dir / folder / f"{name}.yaml")
    headings = 4 if preset == "hc-sr04" else None
    scanner = an.RangeScanner.from_preset(preset)
    amap = an.build_map(environment, scanner, spacing=spacing, headings=headings)
    path = write("zones-lanelet2", "z.osm", of=amap, least_area=0.0)[0]
    area = check_areas(path, amap.cell_area)
    _, _, zone = floor(amap)
    assert area == pytest.approx(np.isin(zone, (CORRIDOR, OPEN)).sum() * amap.cell_area, rel=0.02)


def test_lanelet2_says_what_it_leaves_out(write: Write, amap: an.AmbiguityMap) -> None:
    path = write("zones-lanelet2", "z.osm", least_area=5.0)[0]
    kept = json.loads(write("zones-geojson", "z.geojson", least_area=5.0)[0].read_text())
    left_out = float(ElementTree.parse(path).getroot().get("left_out_m2", "nan"))
    assert left_out >= kept["left_out_m2"] > 0.0
    with pytest.warns(InputWarning, match=r"0\.32 m² .* in pieces below 0\.5 m² and left out"):
        write("zones-lanelet2", "usual.osm")


@pytest.mark.parametrize(
    ("kind", "name"),
    [("zones-geojson", "z.geojson"), ("zones-lanelet2", "z.osm"), ("zones-autoware", "z.geojson")],
)
def test_pieces_that_are_all_too_small_are_named(write: Write, kind: str, name: str) -> None:
    with pytest.warns(InputWarning, match=r"no piece of 900 m² or more; [\d.]+ m² are in smaller"):
        write(kind, name, least_area=900.0)


def test_polygons_with_holes_are_cut() -> None:
    holes = [shapely.Point(x, y).buffer(0.4) for x in (1, 2.5, 4) for y in (1, 3)]
    shape = shapely.box(0, 0, 5, 4).difference(shapely.union_all(holes))
    parts = without_holes(shape)
    assert all(not part.interiors and part.is_valid for part in parts)
    assert sum(part.area for part in parts) == pytest.approx(shape.area, rel=1e-4)
    assert shapely.union_all(parts).symmetric_difference(shape).area < 1e-4 * shape.length


def ellipse_of_autoware(p: np.ndarray, yaw: float) -> tuple[float, float]:
    """As covariance_ellipse.cpp: 3 sigma of the long axis, and across the body."""
    inverse = np.linalg.inv(p)
    e = np.array([math.cos(yaw), math.sin(yaw)])
    d = math.sqrt(e @ inverse @ e / np.linalg.det(inverse))
    return 3.0 * math.sqrt(np.linalg.eigvalsh(p)[1]), 3.0 * d


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0, -1.3])
def test_sizes_are_those_of_the_monitor(heading: float) -> None:
    rng = np.random.default_rng(3)
    roots = rng.normal(0.0, 0.2, (50, 2, 2))
    p = roots @ roots.transpose(0, 2, 1) + 1e-4 * np.eye(2)
    long, across = sizes(p[:, 0, 0], p[:, 0, 1], p[:, 1, 1], heading)
    expected = np.array([ellipse_of_autoware(one, heading) for one in p])
    np.testing.assert_allclose(long, expected[:, 0], rtol=1e-6)
    np.testing.assert_allclose(across, expected[:, 1], rtol=1e-6)


def test_levels_are_reached_at_the_thresholds() -> None:
    long = np.array([1.19, 1.2, 1.49, 1.5, np.nan])
    assert level(long, LONG).tolist() == [0, 1, 1, 2, 0]
    assert level(np.array([0.249, 0.25, 0.3]), LATERAL).tolist() == [0, 1, 2]


@pytest.mark.parametrize("heading", [None, 0.0, 90.0])
def test_autoware_levels_on_the_map(
    write: Write, amap: an.AmbiguityMap, heading: float | None
) -> None:
    path = write("zones-autoware", "a.geojson", heading=heading, least_area=0.0)[0]
    features = check_geojson(path)
    x, y, _ = floor(amap)
    grid = covariance_grid(amap)
    expected = np.zeros(x.shape, dtype=int)
    for row, column in np.argwhere(np.isfinite(grid[0]) & amap.judged.counted):
        xx, xy, _, yy = grid[:4, row, column].astype(float)
        p = np.array([[xx, xy], [xy, yy]])
        values, vectors = np.linalg.eigh(p)
        yaw = math.atan2(vectors[1, 1], vectors[0, 1]) if heading is None else math.radians(heading)
        long = 3.0 * math.sqrt(values[1])
        # The marginal deviation across the heading, without an inverse.
        side = np.array([-math.sin(yaw), math.cos(yaw)])
        across = 3.0 * math.sqrt(side @ p @ side)
        expected[row, column] = max(
            (long >= 1.2) + (long >= 1.5), (across >= 0.25) + (across >= 0.30)
        )
    for code, name in ((1, "warning"), (2, "error")):
        shape = shapely.union_all(
            [one for one, properties in features if properties["level"] == name]
        )
        np.testing.assert_array_equal(shapely.contains_xy(shape, x, y), expected == code)
    assert (expected == 2).any()
    # A vehicle that stands across the corridor slides sideways in it.
    here = shapely.Point(7.1, 1.7)
    causes = [properties["cause"] for shape, properties in features if shape.contains(here)]
    assert ("across the heading" in "".join(causes)) == (heading == 90.0)


def test_stretches_of_a_route(write: Write, amap: an.AmbiguityMap, route: Path) -> None:
    """Along the corridor the robot slides ahead only; in the hall it is lost in all directions."""
    path = write("zones-autoware", "a.geojson", routes=(route,))[0]
    stretches = [
        (shapely.from_geojson(json.dumps(one["geometry"])), one["properties"])
        for one in json.loads(path.read_text())["features"]
        if one["geometry"]["type"] == "LineString"
    ]
    assert stretches
    poses = dense_poses(load_route(route))
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    levels = np.zeros(len(poses), dtype=int)
    for k, p in enumerate(expected_covariance(amap, poses)[:, :2, :2]):
        if np.isfinite(p).all():
            long, across = ellipse_of_autoware(p, poses[k, 2])
            levels[k] = max((long >= 1.2) + (long >= 1.5), (across >= 0.25) + (across >= 0.3))
    for k in range(len(poses) - 1):
        names = [
            one["level"] for _, one in stretches if one["from_m"] - 1e-3 <= along[k] < one["to_m"]
        ]
        expected = [] if levels[k] == 0 else [("ok", "warning", "error")[levels[k]]]
        # A pose that ends one stretch begins the next.
        assert names[-1:] == expected or abs(levels[k] - levels[k - 1]) > 0
    assert all(
        line.length == pytest.approx(one["to_m"] - one["from_m"], abs=2e-3)
        for line, one in stretches
    )
    assert {one["route"] for _, one in stretches} == {"route.csv"}


def test_a_small_neighbourhood_cannot_tell(write: Write, headed_map: an.AmbiguityMap) -> None:
    with pytest.raises(InputError, match=r"radius is 0\.6 m.*--ambiguity-radius 1\.2"):
        write("zones-autoware", "a.geojson", of=headed_map)


def test_a_zone_named_twice_is_written_once(write: Write) -> None:
    once = json.loads(write("zones-geojson", "a.geojson", zones=("corridor",))[0].read_text())
    twice = write("zones-geojson", "b.geojson", zones=("corridor", "corridor"))[0]
    assert json.loads(twice.read_text()) == once
    assert once["features"]
