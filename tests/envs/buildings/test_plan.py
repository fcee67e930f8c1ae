from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav_envs.buildings.furnish import along_walls, freestanding, racks
from ambinav_envs.buildings.plan import AISLE, Plan, disc, rectangle, sides
from ambinav_envs.buildings.plan_sampler import PlanSampler


def one_room() -> tuple[Plan, shapely.Polygon]:
    plan = Plan()
    return plan, plan.box(0.0, 0.0, 6.0, 5.0)


def test_what_may_stand() -> None:
    plan, room = one_room()
    plan.door((0.0, 2.5), 90.0)
    assert plan.stand(room, shapely.box(2.0, 2.0, 3.0, 3.0))
    assert not plan.stand(room, shapely.box(3.5, 2.0, 4.0, 3.0))  # too near to that
    assert not plan.stand(room, shapely.box(5.0, 1.0, 5.5, 2.0))  # too near to a wall
    assert plan.stand(room, shapely.box(5.5, 1.0, 6.5, 2.0))  # against the wall
    assert plan.stand(room, shapely.box(5.0, 4.5, 6.5, 5.5))  # in a corner
    assert not plan.stand(room, shapely.box(-0.1, 2.0, 0.5, 3.0))  # before the door
    assert not plan.stand(room, shapely.box(-1.0, 0.0, 7.0, 0.5))  # along three walls
    assert not plan.stand(room, shapely.box(1.0, -1.0, 1.5, 6.0))  # across the room
    assert not plan.stand(room, shapely.box(8.0, 8.0, 9.0, 9.0))  # elsewhere
    assert len(plan.solids) == 3


def test_a_plan_becomes_an_environment() -> None:
    plan, room = one_room()
    plan.box(6.2, 0.0, 8.0, 5.0)
    plan.door((6.1, 2.0), 90.0, 1.0)
    assert plan.stand(room, disc((3.0, 2.5), 0.5))
    drawn = plan.environment("plan")
    table = 0.5 * 16 * math.sin(math.tau / 16) * 0.5**2
    assert drawn.free.area == pytest.approx(30.0 + 9.0 + 0.2 - table, abs=1e-6)
    turned = plan.environment("plan", 30.0)
    assert turned.free.area == pytest.approx(drawn.free.area)
    assert turned.is_free(
        math.cos(math.radians(30.0)) * 6.1 - math.sin(math.radians(30.0)) * 2.0,
        math.sin(math.radians(30.0)) * 6.1 + math.cos(math.radians(30.0)) * 2.0,
    )
    assert not drawn.is_free(3.0, 2.5)


def test_what_is_cut_off_is_solid() -> None:
    plan, _ = one_room()
    plan.solids.append(shapely.box(2.0, -1.0, 2.2, 6.0))
    drawn = plan.environment("plan")
    assert drawn.free.area == pytest.approx(3.8 * 5.0)


@pytest.mark.parametrize("seed", range(6))
def test_furniture_leaves_aisles(seed: int) -> None:
    plan = Plan()
    room = plan.room(shapely.Polygon([(0, 0), (9, 1), (8, 7), (1, 6)]))
    sampler = PlanSampler(np.random.default_rng(seed))
    along_walls(plan, sampler, room, 0.6)
    freestanding(plan, sampler, room, 3)
    assert len(plan.solids) >= 4
    for k, solid in enumerate(plan.solids):
        inside = solid.intersection(room)
        for other in plan.solids[:k]:
            assert inside.distance(other.intersection(room)) >= AISLE - 1e-9
        gaps = shapely.distance(inside, sides(room))
        assert ((gaps < 1e-6) | (gaps >= AISLE - 1e-9)).all()


def test_racks_are_rows_along_the_longest_side() -> None:
    plan = Plan()
    room = plan.box(0.0, 0.0, 12.0, 8.0)
    racks(plan, PlanSampler(None), room, depth=1.0, aisle=1.8, border=1.6)
    rows = sorted(solid.bounds for solid in plan.solids)
    np.testing.assert_allclose(rows, [(1.6, 2.6, 10.4, 3.6), (1.6, 5.4, 10.4, 6.4)], atol=1e-5)
    with_gaps = Plan()
    racks(with_gaps, PlanSampler(None), room, depth=1.0, aisle=1.8, border=1.6, gaps=1.0)
    assert len(with_gaps.solids) == 4
    small = Plan()
    racks(small, PlanSampler(None), small.box(0.0, 0.0, 3.0, 3.0), border=1.6)
    assert not small.solids


def test_rectangles_and_sides() -> None:
    shape = rectangle((1.0, 2.0), 90.0, 4.0, 2.0)
    assert shape.bounds == pytest.approx((0.0, 0.0, 2.0, 4.0))
    assert [side.length for side in sides(shape)] == pytest.approx([4.0, 2.0, 4.0, 2.0])


def test_dice() -> None:
    plain = PlanSampler(None)
    assert plain.between(2.0, 4.0) == 3.0
    assert plain.count(2, 4) == 3
    assert plain.happens(0.6) and not plain.happens(0.5)
    assert plain.one_of("abc") == "a"
    assert plain.shuffled("abc") == ["a", "b", "c"]
    sampler = PlanSampler(np.random.default_rng(0))
    counts = [sampler.count(1, 3) for _ in range(300)]
    assert set(counts) == {1, 2, 3}
    assert 80 < counts.count(2) < 120
    orders = {"".join(sampler.shuffled("abc")) for _ in range(100)}
    assert len(orders) == 6
    assert {sampler.one_of("ab") for _ in range(50)} == {"a", "b"}
