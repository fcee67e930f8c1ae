"""Routes under a limit on bad metres: legal where one is found at all, and cheap."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner
from ambinav_planners.improve.limited import improve_within, priced
from ambinav_planners.search.limit import BadStretchLimit, longest_bad
from tests.planners.conftest import LASER

LEVEL = 0.5


@pytest.fixture(scope="module")
def hall() -> AmbiguityMap:
    """12 by 9 m whose level is 1 in the middle 6 m of x, 0 left and right and on an island."""
    scanner = an.RangeScanner.planar(sensor=LASER, beams=24, aperture=2.0 * math.pi)
    environment = an.environment_from_shapes([shapely.box(0, 0, 12, 9)], name="hall")
    amap = an.build_map(environment, scanner, spacing=0.3)
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    bad = (x > 3.0) & (x < 9.0) & (np.hypot(x - 6.2, y - 6.5) > 0.8)
    level = amap.dataset["level"].copy(data=bad.astype(np.float32))
    return AmbiguityMap(amap.dataset.assign(level=level))


def bad_metres(robot: RoutePlanner, poses: np.ndarray) -> float:
    """Metres in a row above the level, by sampling every centimetre."""
    dense, _, along = robot.checker.steering.dense(poses, 0.01)
    most = begun = 0.0
    for (x, y, _), gone in zip(dense.tolist(), along.tolist(), strict=True):
        if robot.service.ambiguity.near(x, y, 0.0) <= LEVEL:
            begun = gone
        most = max(most, gone - begun)
    return most


def shortest_over_the_island(metres: float) -> float:
    """Length from (1, 1) by x = 3, the island's edge twice and x = 9 to (11, 2), by trying all."""
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    edge = np.stack([6.2 + 0.8 * np.cos(angle), 6.5 + 0.8 * np.sin(angle)], axis=-1)
    y = np.linspace(0.5, 8.5, 801)

    def side(x: float, end: tuple[float, float]) -> np.ndarray:
        bridge = np.hypot(edge[:, :1] - x, edge[:, 1:] - y)
        length = np.where(bridge <= metres, bridge + np.hypot(x - end[0], y - end[1]), np.inf)
        return np.asarray(length.min(axis=1))

    across = np.hypot(*(edge[:, np.newaxis] - edge).transpose(2, 0, 1))
    total = side(3.0, (1, 1))[:, np.newaxis] + across + side(9.0, (11, 2))
    return float(total.min())


@pytest.mark.slow
@pytest.mark.parametrize("metres", [6.2, 3.2, 2.75])
def test_a_limit_just_above_what_a_straight_line_needs_is_kept(
    hall: AmbiguityMap, metres: float
) -> None:
    """The hall is 6 m wide, 2.5 m up to the island: no path over the lattice is that straight."""
    robot = RoutePlanner(AmbiguityService(hall, weight=0.0), max_bad_metres=metres, bad_level=LEVEL)
    route = robot.plan((1.0, 1.0), (11.0, 2.0), planner_name="reference")
    assert bad_metres(robot, route.poses) <= metres + 0.02
    straight = math.dist((1, 1), (11, 2)) if metres > 6.0 else math.inf
    # The island consists of cells of 0.3 m.
    assert route.length <= 1.02 * min(straight, shortest_over_the_island(metres))
    assert robot.checker.motions_free(route.poses[:-1], route.poses[1:]).all()


def test_what_keeps_the_limit_does_not_get_dearer(hall: AmbiguityMap) -> None:
    service = AmbiguityService(hall, weight=2.0)
    robot = RoutePlanner(service)
    limit, steering = BadStretchLimit(3.2, LEVEL), robot.checker.steering
    rng = np.random.default_rng(6)
    for _ in range(5):
        island = rng.normal([6.2, 6.5], 0.15, 2)
        poses = np.array([[1, 3, 0], [3, 6.5, 0], [*island, 0], [9, 6.2, 0], [11, 3, 0]], float)
        assert limit.kept_by(poses, service, steering)
        better = improve_within(poses, service, robot.checker, limit)
        assert better is not None
        assert longest_bad(better, service, steering, LEVEL) <= 3.2 + 1e-6
        before, after = (service.route_cost(route, steering) for route in (poses, better))
        assert after < before


def test_a_price_is_paid_where_the_floor_is_bad(hall: AmbiguityMap) -> None:
    service = AmbiguityService(hall, weight=0.0)
    dear = priced(service, LEVEL, 4.0)
    assert dear.cost(6.0, 2.0) == pytest.approx(5.0)
    assert dear.cost(1.0, 2.0) == pytest.approx(1.0)
    assert service.cost(6.0, 2.0) == pytest.approx(1.0)
