"""Aged walls and moved furniture in space: the extrusion of the aged plan, and known pieces."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.drive.ageing import with_aged_walls, with_moved_furniture
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.drive.test_ageing import hall
from tests.geometry.furnished import furnished

SENSOR = RangeSensor(max_range=20.0, std=0.03, resolution=0.001)
LASER = RangeScanner.planar(SENSOR, 60, 6.28, (0.0, 0.0, 0.003)).raised(0.4)
HEIGHT = 2.5


def prisms(env: Environment) -> Prisms:
    assert isinstance(env.space, Prisms)
    return env.space


def heights(env: Environment) -> list[tuple[float, float]]:
    return [(solid.bottom, solid.top) for solid in prisms(env).solids]


def test_the_aged_extrusion_is_the_extrusion_of_the_aged_plan() -> None:
    plan = hall()
    tall = plan.in_space(extruded(plan, HEIGHT))
    for seed in range(3):
        flat, solid = (
            with_aged_walls(env, 0.05, np.random.default_rng(seed)) for env in (plan, tall)
        )
        assert prisms(solid).checksum == extruded(flat, HEIGHT).checksum
        assert solid.free.equals(flat.free) and solid.floor == tall.floor


@pytest.mark.slow
def test_furniture_of_an_extruded_plan_moves_as_in_the_plan() -> None:
    plan = hall(shapely.box(14.0, 10.0, 15.0, 11.0))
    tall = plan.in_space(extruded(plan, HEIGHT))
    rng = np.random.default_rng(0)
    where = rng.uniform((0, 0, -3), (15, 14, 3), (300, 3)).T
    changed = 0
    for seed in range(5):
        flat, solid = (
            with_moved_furniture(env, 0.4, np.random.default_rng(seed), 0.5) for env in (plan, tall)
        )
        assert solid.free.equals(flat.free) and solid.segments.same_as(flat.segments)
        wanted = LASER.scan(flat, *where)
        found = LASER.scan(solid, *where)
        assert np.isnan(wanted).any() and np.array_equal(np.isnan(wanted), np.isnan(found))
        some = np.isfinite(wanted)
        assert np.array_equal(some, np.isfinite(found))
        assert np.abs(wanted[some] - found[some]).max() < 1e-4
        changed += int((np.abs(wanted - LASER.scan(plan, *where)) > 0.01).sum())
    assert changed > 1000


def test_no_furniture_is_no_change() -> None:
    plan = an.environment_from_shapes([shapely.box(0, 0, 5, 5)])
    bare = plan.in_space(extruded(plan, HEIGHT))
    assert with_moved_furniture(bare, 0.5, np.random.default_rng(0), 0.5) is bare


def office() -> Environment:
    """A table on four legs with a chair half under it, and a shelf on a wall; the plan at 0.3 m."""
    legs = [shapely.box(x, y, x + 0.05, y + 0.05) for x in (4.0, 5.35) for y in (3.0, 3.75)]
    chair = shapely.box(4.5, 2.7, 4.9, 3.2)
    plan = an.environment_from_shapes([shapely.box(0, 0, 10, 8)], [*legs, chair])
    solids = [
        *(Solid(leg, 0.0, 0.70) for leg in legs),
        Solid(shapely.box(4.0, 3.0, 5.4, 3.8), 0.70, 0.75),
        Solid(chair, 0.0, 0.45),
        Solid(shapely.box(7.0, 7.7, 8.0, 8.0), 1.2, 1.25),
        Solid(shapely.box(-1, -1, 11, 9), -0.3, 0.0),
    ]
    walls = np.array([(0, 0, 10, 0), (10, 0, 10, 8), (10, 8, 0, 8), (0, 8, 0, 0)])
    free = shapely.box(0, 0, 10, 8)
    return plan.in_space(Prisms(walls, [(0.0, 3.0)] * 4, solids=solids, ceiling=3.0, free=free))


@pytest.mark.slow
def test_a_table_moves_with_its_legs_and_the_chair_by_itself() -> None:
    env = office()
    before = [solid.outline for solid in prisms(env).solids]
    shifts = []
    for seed in range(20):
        world = with_moved_furniture(env, 0.5, np.random.default_rng(seed), 0.3)
        after = prisms(world).solids
        assert heights(world) == heights(env)
        moved = np.array(
            [np.subtract(s.outline.centroid.coords[0], o.centroid.coords[0])
             for s, o in zip(after, before, strict=True)]
        )  # fmt: skip
        assert np.abs(moved[:5] - moved[0]).max() < 1e-9 and not moved[6:].any()
        shifts.append((moved[0], moved[5]))
        # The plan shows them where they stand, and nothing within.
        for solid in after[:4] + after[5:6]:
            assert not world.free.contains(solid.outline.centroid)
        assert prisms(world).free is prisms(env).free
        assert world.free.area == pytest.approx(env.free.area, abs=1e-9)
    table, chair = np.array(shifts).transpose(1, 0, 2)
    assert np.abs(table).max() > 0.3 and np.abs(chair).max() > 0.3
    assert np.abs(table - chair).max() > 0.3
    again = with_moved_furniture(env, 0.5, np.random.default_rng(19), 0.3)
    assert prisms(again).checksum == prisms(world).checksum


def test_what_touches_a_wall_above_the_floor_stays() -> None:
    env = office()
    # A board over the table, from it to the wall.
    board = Solid(shapely.box(4.6, 3.5, 4.8, 8.0), 0.72, 0.74)
    space = prisms(env)
    tied = env.in_space(space.refilled(space.given, solids=[*space.solids, board], free=space.free))
    for seed in range(5):
        world = with_moved_furniture(tied, 0.5, np.random.default_rng(seed), 0.3)
        assert prisms(world).solids[:5] == space.solids[:5]


def test_solids_age_with_the_walls() -> None:
    world = with_aged_walls(office(), 0.03, np.random.default_rng(2))
    flat = with_aged_walls(office().plan, 0.03, np.random.default_rng(2))
    rings = [shapely.Polygon(ring) for ring in shapely.get_parts(flat.free)[0].interiors]
    solids = prisms(world).solids
    # Those that the plan shows stand where the aged plan has them.
    for solid in [*solids[:4], solids[5]]:
        assert min(solid.outline.symmetric_difference(ring).area for ring in rings) < 1e-9
    assert heights(world) == heights(office())


def test_a_mesh_is_refused() -> None:
    mesh, rng = furnished()[1], np.random.default_rng(0)
    with pytest.raises(InputError, match=r"it is a mesh.*an aged building is known.*give its plan"):
        with_aged_walls(mesh, 0.03, rng)
    with pytest.raises(InputError, match=r"it is a mesh.*moved furniture is known"):
        with_moved_furniture(mesh, 0.3, rng, 0.3)
