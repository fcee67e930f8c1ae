"""Routes of least time: their cost against the clock of a speed profile, which shares no code."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav import (
    AmbiguityMap,
    AmbiguityService,
    BrakingRule,
    Forecaster,
    Route,
    SpeedLimits,
    with_slowness,
)
from ambinav.runtime.errors import InputError
from ambinav_planners import RoutePlanner

FASTEST = 0.8
RULE = BrakingRule(radius=0.2, acceleration=1.0)
# Through the hall, which a laser of 4 m does not reach across.
ENDS = (3.0, 3.0, 0.0), (42.0, 20.0, 0.0)


@pytest.fixture(scope="module")
def timed(demo_map: AmbiguityMap) -> AmbiguityService:
    slower = with_slowness(demo_map, RULE, FASTEST, odometry="poor")
    return AmbiguityService(slower, "slowness", weight=1.0)


@pytest.fixture(scope="module")
def routes(demo: AmbiguityService, timed: AmbiguityService) -> dict[str, Route]:
    """The route of least time, the shortest one and one of weight 5."""
    services = {"time": timed, "shortest": demo.with_weight(0.0), "weight 5": demo}
    return {name: RoutePlanner(one).plan(*ENDS) for name, one in services.items()}


def speeds(service: AmbiguityService, route: Route) -> NDArray[np.float64]:
    """Rows of metres and the speed that the places allow, 2 cm apart."""
    dense, _, along = route.steering.dense(route.poses, 0.02)
    prices = [service.density.near(x, y, 0.0) for x, y, _ in dense.tolist()]
    return np.column_stack([along, FASTEST / np.array(prices)])


@pytest.mark.slow
def test_without_an_error_only_walls_slow_a_robot(demo_map: AmbiguityMap) -> None:
    rule = BrakingRule(radius=0.2, acceleration=1.0, sigmas=0.0)
    layer = with_slowness(demo_map, rule, FASTEST).dataset["slowness"].values
    clearance = demo_map.dataset["clearance"].values
    free = ~np.isnan(layer)
    assert free.sum() > 1000
    speed = FASTEST / (1.0 + layer[free])
    # It stops from there in the room that it has, unless it creeps or drives as fast as it may.
    needed = speed * rule.reaction + speed**2 / (2.0 * rule.acceleration)
    room = clearance[free] - rule.radius
    between = (speed > rule.creep + 1e-3) & (speed < FASTEST - 1e-3)
    np.testing.assert_allclose(needed[between], room[between], atol=1e-4)
    assert (needed[speed >= FASTEST - 1e-3] <= room[speed >= FASTEST - 1e-3] + 1e-3).all()
    assert between.any() and speed.min() == pytest.approx(rule.creep)


@pytest.mark.slow
def test_errors_slow_a_robot_further(demo_map: AmbiguityMap, timed: AmbiguityService) -> None:
    layers = [timed.map.dataset["slowness"].values]
    for odometry, sigmas in (("good", 3.0), ("good", 0.0)):
        rule = BrakingRule(radius=0.2, acceleration=1.0, sigmas=sigmas)
        slower = with_slowness(demo_map, rule, FASTEST, odometry=odometry)
        layers.append(slower.dataset["slowness"].values)
    free = ~np.isnan(layers[0])
    for worse, better in pairwise(layers):
        assert (worse[free] >= better[free] - 1e-6).all()
        assert worse[free].mean() > better[free].mean() + 0.01


def test_the_cost_is_the_time_of_the_drive(
    timed: AmbiguityService, routes: dict[str, Route]
) -> None:
    """With ramps and turns that take no time the stamps are the cost's seconds."""
    at_once = SpeedLimits(
        max_speed=FASTEST, acceleration=1e4, max_turn_rate=1e4, turn_acceleration=None
    )
    real = SpeedLimits(max_speed=FASTEST, acceleration=RULE.acceleration)
    seconds, driven = {}, {}
    for name, route in routes.items():
        bound = speeds(timed, route)
        seconds[name] = timed.route_cost(route.poses, route.steering) / FASTEST
        assert route.timed(at_once, bound=bound).duration == pytest.approx(seconds[name], rel=0.01)
        driven[name] = route.timed(real, bound=bound).duration or math.inf
        assert driven[name] > seconds[name] > route.length / FASTEST
    for name in ("shortest", "weight 5"):
        assert seconds["time"] < 0.8 * seconds[name]
        assert driven["time"] < driven[name]
    assert routes["time"].cost == pytest.approx(FASTEST * seconds["time"])


def test_it_is_faster_under_the_forecast_error_too(
    demo_map: AmbiguityMap, routes: dict[str, Route]
) -> None:
    """The error along the route is not that of its places, and bounds the stamps."""
    limits = SpeedLimits(max_speed=FASTEST, acceleration=RULE.acceleration)
    forecaster = Forecaster(demo_map, "poor")
    times = {
        name: route.timed(limits, bound=RULE.bound(demo_map, forecaster(route))).duration
        for name, route in routes.items()
    }
    assert all(seconds is not None for seconds in times.values())
    assert times["time"] < 0.8 * min(times["shortest"], times["weight 5"])


@pytest.mark.slow
def test_headings_count(heading_map: AmbiguityMap) -> None:
    slower = with_slowness(heading_map, RULE, FASTEST)
    assert slower.dataset["slowness"].dims == ("y", "x", "theta")
    assert np.isfinite(slower.dataset["slowness"].values[slower.possible]).all()
    assert {"slowness_mean", "slowness_worst"} <= {*slower.layers}


def test_speeds_of_no_use(demo_map: AmbiguityMap) -> None:
    with pytest.raises(InputError, match=r"max_speed is 0\.0; give metres per second above 0"):
        with_slowness(demo_map, RULE, 0.0)
