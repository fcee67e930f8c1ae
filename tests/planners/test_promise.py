"""Routes that keep to a share of lost robots."""

from __future__ import annotations

import pytest

from ambinav.forecasting.forecast import Forecaster
from ambinav.runtime.errors import InputError
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.promise import WEIGHTS, PromiseError, route_within

ACROSS = (9.0, 21.0), (28.0, 17.0)
"""Ends of a route whose shortest way leads through the middle of the hall."""


def test_shortest_of_the_candidates_that_keep_the_promise(robot: RoutePlanner) -> None:
    forecaster = Forecaster(robot.service.map, "poor")
    shortest = robot.plan(*ACROSS, weight=0.0)
    assert forecaster(shortest).lost_probability > 0.3
    lengths = [shortest.length]
    for share in (0.2, 0.02):
        route, forecast = route_within(robot, *ACROSS, forecaster, share, weights=WEIGHTS[::2])
        assert forecast.lost_probability <= share
        assert route.length >= lengths[-1] - 1e-6
        lengths.append(route.length)
        for weight in WEIGHTS[::2]:
            other = robot.plan(*ACROSS, weight=weight)
            if other.length < route.length - 0.05:
                assert forecaster(other).lost_probability > share
    easy, _ = route_within(robot, *ACROSS, forecaster, 0.999, weights=(0.0, 5.0))
    assert easy.length == pytest.approx(shortest.length, abs=0.05)


def test_says_what_the_best_one_is(robot: RoutePlanner) -> None:
    forecaster = Forecaster(robot.service.map, "amcl-default")
    with pytest.raises(PromiseError, match=r"none of 2 routes keeps to 1e-05 % .* % get lost") as e:
        route_within(robot, *ACROSS, forecaster, 1e-7, weights=(0.0, 2.0))
    assert e.value.forecast.lost_probability > 1e-7
    assert e.value.route.weight == 2.0


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, float("nan")])
def test_refuses_what_is_no_share(robot: RoutePlanner, share: float) -> None:
    with pytest.raises(InputError, match="max_lost"):
        route_within(robot, *ACROSS, Forecaster(robot.service.map), share)
