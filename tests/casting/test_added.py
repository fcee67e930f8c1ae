"""Rays that added obstacles shorten, against the building with these obstacles in it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.casting.added import AddedWalls
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceRays
from ambinav.geometry.segments import edges_of

REACH = 15.0
BARE = [(0, 0, 8, 0), (8, 0, 8, 6), (8, 6, 0, 6), (0, 6, 0, 0)]


def shapes(seed: int) -> list[Solid]:
    """Posts, thick walls, and one that is not convex, between any heights."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform((1, 1), (7, 5), (4, 2))
    z = np.sort(rng.uniform(0.0, 2.5, (4, 2)), axis=1)
    bent = shapely.LineString([(0.0, 0.0), (0.9, 0.1), (0.8, 0.9)]).buffer(0.1, cap_style="flat")
    outlines = [
        shapely.Point(0, 0).buffer(0.3, quad_segs=4), shapely.box(0, 0, 0.6, 0.2), bent,
        shapely.Point(0, 0).buffer(0.2) - shapely.Point(0, 0).buffer(0.1),
    ]  # fmt: skip
    return [
        Solid(shapely.affinity.translate(shape, *at), low, high)
        for shape, at, (low, high) in zip(outlines, middle.tolist(), z.tolist(), strict=True)
    ]


@pytest.mark.parametrize("seed", range(6))
def test_shortened_rays_are_those_of_the_building_with_the_obstacles(seed: int) -> None:
    solids, rng = shapes(seed), np.random.default_rng(seed + 100)
    bare = Prisms(BARE, [(0.0, 3.0)] * 4, floor=0.0, ceiling=3.0)
    built = Prisms(BARE, [(0.0, 3.0)] * 4, solids=solids, floor=0.0, ceiling=3.0)
    azimuth, elevation = rng.uniform(0, math.tau, 60), rng.uniform(-1.2, 1.2, 60)
    elevation[:10] = 0.0
    height = rng.uniform(0.2, 2.8, 60)
    origin = np.column_stack([rng.uniform(-0.2, 0.2, (60, 2)), height])
    x, y = rng.uniform((0.5, 0.5), (7.5, 5.5), (300, 2)).T
    rays, theta = SpaceRays(origin, azimuth, elevation), 0.7
    turned = np.full(len(x), theta)
    expected = built.cast_scans(x, y, turned, rays, REACH)
    hits = bare.cast_scans(x, y, turned, rays, REACH)
    added = AddedWalls.of(
        [edges_of(solid.outline) for solid in solids],
        [solid.kind for solid in solids],
        [(solid.bottom, solid.top) for solid in solids],
        [True] * len(solids),
    )
    first = len(bare.surface_kind)
    given = np.column_stack([azimuth, origin, elevation])
    before = hits[0].copy()
    added.shorten(x, y, theta, given, REACH, first, hits)
    known = np.isfinite(expected[0]) | np.isinf(expected[0])  # of others the ray starts in a solid
    assert known.mean() > 0.9
    assert (hits[0][known] < before[known] - 1e-4).mean() > 0.03
    np.testing.assert_allclose(hits[0][known], expected[0][known], rtol=0, atol=2e-5)
    np.testing.assert_allclose(hits[2][known], expected[2][known], rtol=0, atol=1e-4)
    normals = np.concatenate([bare.surface_normal, added.normals])[hits[1]]
    wanted = built.surface_normal[expected[1]]
    facing = np.abs((normals * wanted).sum(axis=-1))
    assert (facing[known & (expected[1] >= 0)] > 1.0 - 1e-6).mean() > 0.999


def test_poses_that_see_an_obstacle_are_those_whose_rays_it_shortens() -> None:
    solids, rng = shapes(3), np.random.default_rng(5)
    added = AddedWalls.of(
        [edges_of(solid.outline) for solid in solids], [0] * 4,
        [(solid.bottom, solid.top) for solid in solids], [True] * 4,
    )  # fmt: skip
    x, y = rng.uniform((0.5, 0.5), (7.5, 5.5), (400, 2)).T
    rays = np.column_stack(
        [rng.uniform(0, 6, 4), np.zeros((4, 2)), [0.3, 1, 1, 2], [0, 0.5, 0, -1]]
    )
    limit = rng.uniform(0.5, 4.0, (400, 4))
    distance = limit.astype(np.float32)
    hits = distance, np.full((400, 4), -1, dtype=np.int32), np.empty((0, 0), dtype=np.float32)
    before = distance.copy()
    added.shorten(x, y, 0.0, rays, REACH, 0, hits)
    seen = added.seen_by(x, y, rays, np.arange(4), limit)
    shortened = (distance < before - 1e-4).any(axis=1)
    assert (seen[shortened]).all()
    assert 0.1 < shortened.mean() < 0.9
    assert (seen & ~shortened).mean() < 0.01


@pytest.mark.parametrize(
    ("start", "azimuth"), [((0.0, 2.0), 0.0), ((0.0, 4.0), 0.0), ((3.0, 0.0), math.pi / 2)]
)
def test_rays_that_touch_a_corner_from_above_meet_no_bottom(
    start: tuple[float, float], azimuth: float
) -> None:
    """A plate, and rays that rise past one of its corners."""
    plate = shapely.Polygon([(4, 2), (5, 3), (4, 4), (3, 3)])
    added = AddedWalls.of([edges_of(plate)], [0], [(0.7, 0.75)], [True])
    elevation = np.radians([5.0, 9.0, 15.0])
    rays = np.zeros((3, 5))
    rays[:, 0], rays[:, 3], rays[:, 4] = azimuth, 0.5, elevation
    hits = (
        np.full((1, 3), REACH, np.float32),
        np.full((1, 3), -1, np.int32),
        np.full((1, 3), np.nan, np.float32),
    )
    added.shorten(np.array(start[:1]), np.array(start[1:]), 0.0, rays, REACH, 100, hits)
    np.testing.assert_array_equal(hits[0], REACH)
