"""Wall normals by convolution against a sum over every piece of every wall; and clearance."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import LAYERS
from ambinav.layers.wall_normals import wall_normals
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

SPACING = 0.25


def laser_of(reach: float) -> RangeScanner:
    return RangeScanner.planar(
        RangeSensor(max_range=reach, std=0.03, resolution=0.001), 24, 2 * math.pi
    )


@pytest.fixture(scope="module")
def sonar() -> RangeScanner:
    sensor = RangeSensor(max_range=9.0, std=0.03, resolution=0.01, aperture=math.radians(30.0))
    return RangeScanner.ring(sensor, 12, 0.2)


def brute(context: LayerContext, reach: float) -> np.ndarray:
    """Sum over all pieces of wall whose cell's centre is within reach, (P, 2, 2)."""
    x, y = context.points
    out = np.zeros((len(x), 2, 2))
    for (ax, ay, bx, by), kind in zip(
        context.environment.segments.xy, context.environment.segments.kind, strict=True
    ):
        if kind:
            continue
        length = math.hypot(bx - ax, by - ay)
        n = np.array([ay - by, bx - ax]) / length
        pieces = max(math.ceil(2 * length / SPACING), 1)
        for k in range(pieces):
            share = (k + 0.5) / pieces
            column = round((ax + share * (bx - ax) - context.lattice.x[0]) / SPACING)
            row = round((ay + share * (by - ay) - context.lattice.y[0]) / SPACING)
            cx, cy = context.lattice.x[0] + column * SPACING, context.lattice.y[0] + row * SPACING
            near = (x - cx) ** 2 + (y - cy) ** 2 <= reach**2 * (1 + 1e-9)
            out[near] += length / pieces * np.outer(n, n)
    return out


@pytest.mark.parametrize("reach", [1.0, 2.6, 12.0])
def test_against_the_sum_over_all_pieces(reach: float) -> None:
    env = scenes.scene(7, size=8.0, blocks=4, thin=2)
    context = LayerContext.of(build_map(env, laser_of(reach), SPACING))
    found = {name: values[context.free] for name, values in wall_normals(context).items()}
    values, vectors = np.linalg.eigh(brute(context, reach))
    np.testing.assert_allclose(found["wall_normals"], values[:, 0], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(found["wall_normals_strong"], values[:, 1], rtol=1e-4, atol=1e-6)
    axis = np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0])
    off = np.abs(np.sin(found["wall_normals_direction"] - axis))
    assert (off * (values[:, 1] - values[:, 0]) < 1e-3).all()


def test_a_corridor_has_no_wall_that_faces_along_it() -> None:
    amap = build_map(scenes.room(20.0, 2.0), laser_of(4.0), SPACING, layers=["wall_normals"])
    assert amap.sample("wall_normals", 10.0, 1.0) == pytest.approx(0.0, abs=1e-6)
    assert amap.sample("wall_normals_direction", 10.0, 1.0) == pytest.approx(0.0, abs=1e-6)
    # Both walls over the chord of the disc.
    chords = 2 * 2 * math.sqrt(4.0**2 - 1.0)
    assert amap.sample("wall_normals_strong", 10.0, 1.0) == pytest.approx(chords, rel=0.06)


def test_it_sees_through_walls_and_past_frontiers() -> None:
    parted = build_map(
        scenes.room(4.0, 4.0, thin=np.array([0.0, 2.0, 4.0, 2.0])), laser_of(6.0), SPACING,
        layers=["wall_normals"],
    )  # fmt: skip
    whole = build_map(scenes.room(4.0, 4.0), laser_of(6.0), SPACING, layers=["wall_normals"])
    np.testing.assert_allclose(
        parted.sample("wall_normals", 2.0, 1.0), whole.sample("wall_normals", 2.0, 1.0), rtol=1e-5
    )
    open_ended = an.environment_from_shapes(
        [shapely.box(0, 0, 4, 4)], openings=[shapely.LineString([(4, 0), (4, 4)])]
    )
    half = build_map(open_ended, laser_of(6.0), SPACING, layers=["wall_normals"])
    assert half.sample("wall_normals", 2.0, 1.0) == pytest.approx(4.0, rel=1e-5)


def test_nothing_in_range_is_nothing() -> None:
    amap = build_map(scenes.room(12.0, 12.0), laser_of(2.0), 0.5, layers=["wall_normals"])
    assert amap.sample("wall_normals", 6.0, 6.0) == 0.0
    assert amap.sample("wall_normals_strong", 6.0, 6.0) == 0.0


def test_a_scanner_of_cones_alone_cannot_have_it(sonar: RangeScanner) -> None:
    with pytest.raises(InputError, match="wall normals need a laser beam"):
        build_map(scenes.room(2.0, 2.0), sonar, 0.5, layers=["wall_normals"])
    mixed = RangeScanner.mixed(sonar, laser_of(2.0))
    context = LayerContext.of(build_map(scenes.room(12.0, 12.0), mixed, 0.5, headings=1))
    # The range is the laser's, not the sonars'.
    found = LAYERS.get("wall_normals").compute(context)["wall_normals_strong"]
    assert np.nanmin(found) == 0.0


def test_bad_reach(laser: RangeScanner) -> None:
    amap = build_map(scenes.room(2.0, 2.0), laser, 0.5)
    with pytest.raises(InputError, match=r"reach is -1"):
        with_layers(amap, "wall_normals", wall_normals={"reach": -1})


def test_clearance_is_the_distance_to_the_nearest_segment(laser: RangeScanner) -> None:
    env = scenes.scene(11, size=8.0, blocks=4, thin=2)
    amap = with_layers(build_map(env, laser, SPACING), "clearance")
    x, y = LayerContext.of(amap).points
    lines = shapely.multilinestrings(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    expected = shapely.distance(lines, shapely.points(x, y))
    found = amap.dataset["clearance"].values[amap.dataset["free"].values]
    np.testing.assert_allclose(found, expected, atol=1e-6)
