"""Figures of routes, on a map whose every value is known, and against plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import UNEXPLORED_FLOOR
from ambinav.maps.zones import NOT_FREE
from ambinav.routes.bad_floor import BadFloor, unexplored_note
from ambinav.routes.evaluate import evaluate_route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from tests.judged.buildings import LASER, seen_in_part
from tests.maps import synthetic

# One sample of the zone stands for a quarter of a cell.
SAMPLE = synthetic.SPACING / 4

THROUGH = [(2.0, 2.0, 0.0), (14.0, 2.0, 0.0)]
"""From the room into the corridor: 2 m localizable, 0.5 m transition, 9.5 m corridor."""


@pytest.fixture(scope="module")
def service() -> AmbiguityService:
    return AmbiguityService(AmbiguityMap(synthetic.dataset()), weight=5.0)


@pytest.fixture(scope="module")
def turning() -> AmbiguityService:
    return AmbiguityService(AmbiguityMap(synthetic.dataset(headings=8)), weight=5.0)


R2 = Steering("r2")


def measure(service, poses, steering=R2, **options):
    return evaluate_route(service, poses, steering, planner="by hand", **options)


def test_metres_in_zones(service):
    route = measure(service, THROUGH)
    assert route.length == pytest.approx(12.0)
    assert list(route.zone_metres) == ["localizable", "transition", "corridor", "open"]
    assert list(route.zone_metres.values()) == pytest.approx([2.0, 0.5, 9.5, 0.0], abs=SAMPLE)
    assert sum(route.zone_metres.values()) == pytest.approx(route.length)
    assert route.bad_metres == pytest.approx(9.5, abs=SAMPLE)


def test_the_open_zone_is_bad_too(service):
    route = measure(service, [(17.0, 5.0, 0.0), (21.0, 5.0, 0.0)])
    assert route.zone_metres["open"] == pytest.approx(3.0, abs=SAMPLE)
    assert route.bad_metres == pytest.approx(4.0)
    assert route.longest_bad == pytest.approx(4.0)
    assert (route.corridor_metres, route.open_metres) == pytest.approx((1.0, 3.0), abs=SAMPLE)
    assert (route.longest_corridor, route.longest_open) == pytest.approx((1.0, 3.0), abs=SAMPLE)


def test_longest_bad_stretch_goes_over_vertices_and_not_over_good_floor(service):
    there_and_back = [(14.0, 2.0, 0.0), (9.0, 2.0, 0.0), (2.0, 2.0, 0.0), (10.0, 2.0, 0.0)]
    route = measure(service, there_and_back)
    assert route.bad_metres == pytest.approx(9.5 + 5.5, abs=2 * SAMPLE)
    assert route.longest_bad == pytest.approx(9.5, abs=SAMPLE)
    assert route.longest_corridor == route.longest_bad
    assert route.longest_open == 0.0
    assert measure(service, [(1.0, 2.0, 0.0), (3.0, 2.0, 0.0)]).longest_bad == 0.0


def test_a_stop_does_not_end_a_stretch(service):
    se2 = Steering("se2")
    poses = [(6.0, 2.0, 0.0), (9.0, 2.0, 0.0), (9.0, 2.0, 2.0), (12.0, 2.0, 2.0)]
    route = measure(service, poses, se2)
    assert route.longest_bad == route.longest_corridor == pytest.approx(6.0)


@pytest.mark.parametrize(
    "steering",
    [R2, Steering("se2"), Steering("dubins", 0.3), Steering("reeds-shepp", 0.3)],
    ids=lambda steering: steering.space,
)
def test_cost_is_what_plain_numpy_sums_up(turning, steering):
    poses = np.array([(18.0, 3.0, 0.3), (21.0, 5.0, 2.0), (24.0, 7.0, -1.0), (20.0, 8.0, 4.0)])
    route = measure(turning, poses, steering)
    dense, _, along = steering.dense(poses, 1e-3)
    middle, metres = 0.5 * (dense[1:] + dense[:-1]), np.diff(along)
    turn = (np.diff(dense[:, 2]) + math.pi) % (2 * math.pi) - math.pi
    level = turning.map.sample("level", middle[:, 0], middle[:, 1], dense[:-1, 2] + turn / 2)
    assert route.length == pytest.approx(metres.sum())
    assert route.exposure == pytest.approx((level * metres).sum(), rel=1e-3)
    assert route.cost == pytest.approx(((1.0 + 5.0 * level) * metres).sum(), rel=1e-3)
    assert route.spent[-1] == pytest.approx(route.cost)
    assert route.distance[-1] == pytest.approx(route.length)
    assert sum(route.zone_metres.values()) == pytest.approx(route.length)


def test_weight_zero_costs_the_length(service):
    free = AmbiguityService(service.map, weight=0.0)
    assert measure(free, THROUGH).cost == pytest.approx(12.0)


def test_headings_of_r2_lie_along_the_travel(service):
    route = measure(service, [(1.0, 1.0, 9.0), (3.0, 1.0, 9.0), (3.0, 3.0, 9.0)])
    assert route.poses[:, 2].tolist() == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert route.turn == pytest.approx(math.pi / 2)
    assert route.start == (1.0, 1.0, 0.0)
    assert route.goal == pytest.approx((3.0, 3.0, math.pi / 2))
    # So they need not be given; where they count they must be.
    points = [(1.0, 1.0), (3.0, 1.0), (3.0, 3.0)]
    assert np.array_equal(measure(service, points).poses, route.poses)
    with pytest.raises(InputError, match=r"shape \(N, 3\)"):
        measure(service, points, Steering("se2"))


def test_turn_counts_curves_and_turns_on_the_spot(service):
    half_circle = measure(service, [(1.0, 1.0, 0.0), (1.0, 3.0, math.pi)], Steering("dubins", 1.0))
    assert half_circle.length == pytest.approx(math.pi)
    assert half_circle.turn == pytest.approx(math.pi)
    spot = measure(service, [(1.0, 1.0, 0.0), (1.0, 1.0, -2.0)], Steering("se2"))
    assert (spot.length, spot.turn) == (0.0, pytest.approx(2.0))
    assert spot.zone_metres["localizable"] == 0.0


def test_zones_are_read_at_the_pose_heading():
    dataset = synthetic.dataset(headings=4)
    zone = dataset["zone"].values.copy()
    zone[:, :, 1] = np.where(zone[:, :, 1] == 0, 3, zone[:, :, 1])  # looking along y: open
    dataset["zone"] = (("y", "x", "theta"), zone)
    service = AmbiguityService(AmbiguityMap(dataset))
    across = measure(service, [(1.0, 1.0, 0.0), (3.0, 1.0, 0.0), (3.0, 3.0, 0.0)])
    assert across.zone_metres["localizable"] == pytest.approx(2.0)
    assert across.zone_metres["open"] == pytest.approx(2.0)
    assert across.zones.tolist() == [0, 3, 3]


def test_close_to_a_wall_the_nearest_free_cell_counts(service):
    # Cells in the wall at y < 1, though the route touches it from above only.
    route = measure(service, [(6.0, 0.97, 0.0), (12.0, 0.97, 0.0)])
    assert route.zone_metres["corridor"] == pytest.approx(6.0)
    assert np.isfinite(route.levels).all()


def test_what_the_planner_knows_is_kept(service):
    covariances = np.array([np.diag([0.1, 0.2, 0.3])] * 2)
    covariances[0, 0, 1] = covariances[0, 1, 0] = 0.05
    route = measure(
        service, THROUGH, seed=3, seconds=0.5, first_seconds=0.1, iterations=10,
        curve=[(0.1, 70.0), (0.5, 65.0)], covariances=covariances,
    )  # fmt: skip
    assert (route.planner, route.seed, route.iterations) == ("by hand", 3, 10)
    assert (route.seconds, route.first_seconds) == (0.5, 0.1)
    assert route.curve == ((0.1, 70.0), (0.5, 65.0))
    np.testing.assert_array_equal(route.covariances, covariances)
    assert (route.environment, route.scanner) == ("synthetic", "made-up scanner")
    assert (route.layer, route.weight, route.power) == ("level", 5.0, 1.0)
    assert "by hand" in repr(route)


@pytest.mark.parametrize(
    ("poses", "options", "message"),
    [
        ([(1.0, 1.0, 0.0)], {}, "start and a goal"),
        ([(1.0,), (2.0,)], {}, r"shape \(2, 1\)"),
        ([(1.0, 1.0, 0.0), (math.nan, 1.0, 0.0)], {}, r"poses\[1\]"),
        ([(1.0, 1.0, 0.0), (90.0, 1.0, 0.0)], {}, r"poses\[1\] is at \(90, 1\) m, outside"),
        (THROUGH, {"covariances": np.eye(3)}, r"shape \(3, 3\)"),
        (THROUGH, {"covariances": np.full((2, 3, 3), math.inf)}, "covariances must be finite"),
        (THROUGH, {"covariances": np.triu(np.ones((2, 3, 3)))}, "not symmetric"),
    ],
)
def test_unusable_input(service, poses, options, message):
    with pytest.raises(InputError, match=message):
        measure(service, poses, **options)


def test_unexplored_floor_is_told_apart():
    amap = build_map(seen_in_part(), LASER, spacing=0.25, store=False)
    cost = AmbiguityService(amap)
    route = measure(cost, [(1.0, 2.0, 0.0), (13.0, 2.0, 0.0)])
    x = np.arange(1.0, 13.0, 0.01) + 0.005
    unexplored = np.asarray(amap.sample("judged", x, np.full_like(x, 2.0))) == UNEXPLORED_FLOOR
    assert route.unexplored_metres == pytest.approx(0.01 * unexplored.sum(), abs=0.1)
    assert route.unexplored_metres > 4.0
    assert sum(route.zone_metres.values()) + route.unexplored_metres == pytest.approx(12.0)
    zone = np.where(unexplored, NOT_FREE, amap.sample("zone", x, np.full_like(x, 2.0)))
    assert route.bad_metres == pytest.approx(0.01 * np.isin(zone, (2, 3)).sum(), abs=0.1)
    assert route.longest_bad <= route.bad_metres + 1e-9
    assert route.zones.tolist() == [zone[0], NOT_FREE]
    assert unexplored_note(BadFloor.of(route)).startswith(f"{route.unexplored_metres:.1f} m on")


def test_a_robot_that_drives_beside_a_wall_reaches_it():
    """Floor that is too close to walls for the map's robot counts for one that drives there."""
    amap = AmbiguityMap(synthetic.dataset())
    route = measure(AmbiguityService(amap), [(6.0, 1.15, 0.0), (14.0, 1.15, 0.0)])
    assert not amap.judged.counted[16, 70:140].any()
    assert (route.corridor_metres, route.unexplored_metres) == (pytest.approx(8.0), 0.0)
