"""What layers are computed from is what the map was made of."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

ROOM = an.environment_from_shapes(
    [shapely.Polygon([(0, 0), (5, 0), (5, 3), (3, 3), (3, 2), (0, 2)])],
    openings=[shapely.LineString([(5, 1), (5, 2)])],
)


def fan(beams: int, *, mount: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> RangeScanner:
    sensor = RangeSensor(max_range=2.5, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, beams, math.pi, mount=mount)


@pytest.fixture(scope="module")
def sonar() -> RangeScanner:
    sensor = RangeSensor(
        max_range=2.5, std=0.03, resolution=0.01, aperture=math.radians(30.0), max_incidence=0.6
    )
    return RangeScanner.ring(sensor, 8, 0.05)


@pytest.mark.slow
def test_it_is_of_the_map(tmp_path: Path) -> None:
    amap = build_map(ROOM, fan(200), 0.2, 0.4, headings=3, map_std=0.01)
    amap.save(tmp_path / "m.zarr")
    context = LayerContext.of(AmbiguityMap.open(tmp_path / "m.zarr"))
    parameters = json.loads(amap.dataset.attrs["parameters"])
    assert context.scanner.beams == parameters["beams_used"] < 200
    np.testing.assert_array_equal(context.free, amap.dataset["free"].values)
    assert (context.radius, context.map_std, context.spacing) == (0.4, 0.01, pytest.approx(0.2))
    assert len(context.headings) == 3
    assert context.has_theta
    poses = context.poses(1)
    np.testing.assert_allclose(poses[:, 2], math.tau / 3)
    values = context.spread(np.stack([poses[:, 0]] * 3, axis=1))
    assert values.shape == (*context.free.shape, 3)
    np.testing.assert_array_equal(np.isnan(values[..., 0]), ~context.free)
    row, column = np.argwhere(context.free)[7]
    assert values[row, column, 2] == pytest.approx(amap.dataset["x"].values[column])


@pytest.mark.parametrize("beams", [10, 50, 181, 682])
@pytest.mark.parametrize("sonars", [0, 3, 8])
def test_the_beams_are_those_of_the_map(beams: int, sonars: int, sonar: RangeScanner) -> None:
    """A map keeps only how many beams took part."""
    scanner = fan(beams)
    if sonars:
        scanner = RangeScanner.mixed(RangeScanner.ring(sonar.sensors[0], sonars, 0.05), scanner)
    amap = build_map(scenes.room(1.0, 1.0), scanner, 0.5, headings=1)
    assert LayerContext.of(amap).scanner.beams == json.loads(amap.dataset.attrs["parameters"])[
        "beams_used"
    ]  # fmt: skip


def test_a_map_that_does_not_say_how_it_was_made_is_refused(laser: RangeScanner) -> None:
    dataset = build_map(scenes.room(1.0, 1.0), laser, 0.5).dataset
    parameters = {k: v for k, v in json.loads(dataset.attrs["parameters"]).items() if k != "radius"}
    poor = dataset.assign_attrs(parameters=json.dumps(parameters))
    with pytest.raises(InputError, match=r"old\.zarr: its parameters lack radius"):
        LayerContext.of(AmbiguityMap(poor, source="old.zarr"))
    anonymous = dataset.copy()
    del anonymous.attrs["scanner_yaml"]
    with pytest.raises(InputError, match="lack the scanner"):
        LayerContext.of(AmbiguityMap(anonymous))


def test_hits_are_where_the_rays_end() -> None:
    context = LayerContext.of(build_map(ROOM, fan(24, mount=(0.05, 0.0, 0.2)), 0.25, headings=2))
    poses, hits = context.poses(1), context.hits(1)
    np.testing.assert_array_equal(hits.distance, context.scanner.scan(ROOM, *poses.T))
    mount = context.scanner.mounts
    for p in range(0, len(poses), 5):
        x, y, theta = poses[p]
        for b in range(context.scanner.beams):
            sx = x + math.cos(theta) * mount[b, 0] - math.sin(theta) * mount[b, 1]
            sy = y + math.sin(theta) * mount[b, 0] + math.cos(theta) * mount[b, 1]
            if np.isnan(hits.distance[p, b]):
                continue
            angle = theta + mount[b, 2]
            distance, segment = ROOM.cast_hits(sx, sy, angle, 10.0)
            if distance > 2.5:
                assert hits.kind[p, b] == -1
                assert np.isinf(hits.distance[p, b])
                assert np.isnan(hits.normal[p, b]).all()
                continue
            assert hits.kind[p, b] == ROOM.segments.kind[segment]
            normal = ROOM.normals(segment)
            look = np.array([math.cos(angle), math.sin(angle)])
            normal = -normal * np.sign(normal @ look)
            np.testing.assert_allclose(hits.normal[p, b], normal, atol=1e-6)
            assert math.remainder(hits.angle[p, b] - angle, math.tau) == pytest.approx(0, abs=1e-6)
    assert {-1, 0, 1} == set(np.unique(hits.kind).tolist())


def test_hits_of_a_cone_are_its_nearest_echo(sonar: RangeScanner) -> None:
    context = LayerContext.of(build_map(ROOM, sonar, 0.25, headings=1))
    hits = context.hits()
    np.testing.assert_array_equal(hits.distance, sonar.scan(ROOM, *context.poses().T))
    met = np.isfinite(hits.distance)
    assert 0 < met.mean() < 1
    look = np.stack([np.cos(hits.angle), np.sin(hits.angle)], axis=-1)
    facing = -(look * hits.normal).sum(axis=-1)[met]
    assert facing.min() >= math.cos(0.6) - 1e-6


def test_casts_are_shared_and_can_be_had_in_parts(laser: RangeScanner) -> None:
    context = LayerContext.of(build_map(ROOM, laser, 0.25))
    whole = context.returns()
    assert context.returns() is whole
    assert context.hits() is context.hits()
    part = slice(5, 17)
    np.testing.assert_array_equal(context.returns(0, part).data, whole.data[part])
    np.testing.assert_array_equal(context.hits(0, part).kind, context.hits().kind[part])
    # The kernel's ranges go on a little beyond the sensor's.
    seen = np.isfinite(context.hits().distance)
    np.testing.assert_allclose(
        whole.range[:, : laser.beams][seen], context.hits().distance[seen], rtol=1e-6
    )
