"""Worlds that are not what their map says, against geometry and the deviations asked for."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.drive.ageing import FURNITURE, with_aged_walls, with_moved_furniture
from ambinav.geometry.environment import Environment

TABLES = [shapely.box(x, y, x + 0.8, y + 0.5) for x in (3, 6, 9, 12) for y in (2, 5, 8)]
PILLAR = shapely.box(7.0, 10.5, 10.0, 12.0)
TOUCHING = shapely.box(14.0, 10.0, 15.0, 11.0)


def hall(*more: shapely.Polygon) -> Environment:
    """15 m by 14 m, with twelve tables, a block that is too wide to be one, and what is given."""
    floor = shapely.box(0, 0, 15, 14)
    return an.environment_from_shapes([floor], [*TABLES, PILLAR, *more])


@pytest.mark.slow
def test_walls_are_off_by_the_deviation_asked_for() -> None:
    mapped, std = hall(), 0.04
    offsets, wide = [], []
    for seed in range(150):
        world = with_aged_walls(mapped, std, np.random.default_rng(seed))
        outer = np.array(shapely.get_parts(world.free)[0].exterior.coords)
        left = outer[(np.abs(outer[:, 0]) < 0.5) & (outer[:, 1] > 1.0) & (outer[:, 1] < 13.0)]
        low = outer[(np.abs(outer[:, 1]) < 0.5) & (outer[:, 0] > 1.0) & (outer[:, 0] < 14.0)]
        offsets += [left[:, 0], low[:, 1]]
        wide.append(np.abs(np.diff(left[np.argsort(left[:, 1]), 0])).max())
    found = np.concatenate(offsets)
    assert found.std() == pytest.approx(std, rel=0.06)
    assert found.mean() == pytest.approx(0.0, abs=0.1 * std)
    # Neighbours, 0.25 m apart, are off alike: waves are 2 m long and more.
    assert np.mean(wide) < 0.6 * std
    twice = with_aged_walls(mapped, 2 * std, np.random.default_rng(3))
    once = with_aged_walls(mapped, std, np.random.default_rng(3))
    plain = with_aged_walls(mapped, 0.0, np.random.default_rng(3))
    np.testing.assert_allclose(
        twice.segments.xy - plain.segments.xy, 2 * (once.segments.xy - plain.segments.xy),
        atol=1e-9,
    )  # fmt: skip
    assert plain.free.symmetric_difference(mapped.free).area < 1e-9


@pytest.mark.slow
def test_furniture_is_moved_as_it_is_by_the_deviation_asked_for() -> None:
    mapped, std = hall(), 0.15
    shifts = []
    for seed in range(40):
        world = with_moved_furniture(mapped, std, np.random.default_rng(seed), 0.5)
        assert world.free.area == pytest.approx(mapped.free.area, abs=1e-6)
        things = [shapely.Polygon(ring) for ring in world.free.interiors]
        assert len(things) == len(TABLES) + 1
        assert any(thing.equals(PILLAR) for thing in things)
        for table in TABLES:
            thing = min(things, key=lambda other: other.centroid.distance(table.centroid))
            dx, dy = thing.centroid.x - table.centroid.x, thing.centroid.y - table.centroid.y
            placed = shapely.transform(table, lambda points, by=(dx, dy): points + by)
            assert placed.symmetric_difference(thing).area < 1e-9
            shifts.append((dx, dy))
    assert np.std(shifts, axis=0) == pytest.approx([std, std], rel=0.1)
    assert np.mean(shifts, axis=0) == pytest.approx([0.0, 0.0], abs=0.02)


@pytest.mark.slow
def test_furniture_leaves_passages_open_and_what_belongs_to_a_wall_alone() -> None:
    mapped = hall(TOUCHING, shapely.box(1.0, 12.5, 2.0, 13.9))
    for seed in range(25):
        world = with_moved_furniture(mapped, 1.5, np.random.default_rng(seed), 0.6)
        rings = shapely.get_parts(world.free)[0].interiors
        things = [shapely.Polygon(ring) for ring in rings]
        walls = shapely.box(0, 0, 15, 14).boundary
        # The one that stood 0.1 m off a wall may stay as near, all others keep the passage.
        for thing in things:
            others = [walls, TOUCHING, *(other for other in things if other is not thing)]
            if thing.area > 1.3 and not thing.equals(PILLAR):
                assert min(thing.distance(other) for other in others) >= 0.1 - 1e-9
                continue
            near = [other for other in others if not 1.3 < other.area < 1.5]
            assert min(thing.distance(other) for other in near) >= 0.6 - 1e-9
        assert not world.free.contains(TOUCHING.centroid)
        assert shapely.get_parts(world.free).size == 1


def test_no_furniture_is_no_change() -> None:
    bare = an.environment_from_shapes([shapely.box(0, 0, 5, 5)])
    assert with_moved_furniture(bare, 0.5, np.random.default_rng(0), 0.5) is bare
    assert PILLAR.length / 2 > FURNITURE
