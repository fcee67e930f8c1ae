"""Routes that keep to a share of lost robots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.ensemble import least_shown
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.promise import WEIGHTS, PromiseError, route_within

ACROSS = (9.0, 21.0), (28.0, 17.0)
"""Ends of a route whose shortest way leads through the middle of the hall."""


@pytest.mark.slow
def test_shortest_of_the_candidates_that_keep_the_promise(robot: RoutePlanner) -> None:
    forecaster = Forecaster(robot.service.map, "poor")
    shortest = robot.plan(*ACROSS, weight=0.0)
    assert forecaster(shortest).lost_probability > 0.3
    lengths = [shortest.length]
    others = [robot.plan(*ACROSS, weight=weight) for weight in WEIGHTS[::3]]
    lost = [forecaster(other).lost_probability for other in others]
    for share in (0.2, 0.02):
        promise = route_within(robot, *ACROSS, forecaster, share, weights=WEIGHTS[::3])
        route = promise.route
        assert promise.driven is None
        assert promise.forecast.lost_probability == promise.share <= share
        assert route.length >= lengths[-1] - 1e-6
        lengths.append(route.length)
        for other, probability in zip(others, lost, strict=True):
            if other.length < route.length - 0.05:
                assert probability > share
    easy = route_within(robot, *ACROSS, forecaster, 0.999, weights=(0.0, 5.0))
    assert easy.route.length == pytest.approx(shortest.length, abs=0.05)


@pytest.mark.sweep
def test_metres_that_the_cost_adds_count_as_length(robot: RoutePlanner) -> None:
    amap = robot.service.map
    service = AmbiguityService(amap, weight=0.0, clearance_weight=5.0, comfort=1.0)
    careful = RoutePlanner(service, footprint=robot.checker.footprint)
    forecaster = Forecaster(amap, "poor")
    route = route_within(careful, *ACROSS, forecaster, 0.065, weights=WEIGHTS[::3]).route
    for weight in WEIGHTS[::3]:
        other = careful.plan(*ACROSS, weight=weight)
        if service.route_cost(other.poses) < service.route_cost(route.poses) - 0.05:
            assert forecaster(other).lost_probability > 0.065


@pytest.mark.slow
def test_says_what_the_best_one_is(robot: RoutePlanner) -> None:
    forecaster = Forecaster(robot.service.map, OdometryNoise(scale=20.0))
    with pytest.raises(
        PromiseError, match=r"none of 2 routes keeps to 1e-05 % .* % are forecast"
    ) as e:
        route_within(robot, *ACROSS, forecaster, 1e-7, weights=(0.0, 2.0))
    assert e.value.best.share > 1e-7
    assert e.value.best.route.weight == 2.0


def rash_forecaster(robot: RoutePlanner) -> Forecaster:
    """A forecaster that promises too much."""
    honest = LocalizerClass.load("product")
    return Forecaster(robot.service.map, "poor", replace(honest, offset=honest.offset - 8.0))


@pytest.mark.slow
def test_drives_have_the_last_word(robot: RoutePlanner) -> None:
    """A class that promises too much is not believed."""
    rash = rash_forecaster(robot)
    weights = (0.0, 8.0)
    believed = route_within(robot, *ACROSS, rash, 0.05, weights=weights)
    driven = route_within(
        robot, *ACROSS, rash, 0.05,
        runner=rash.runner(), rng=np.random.default_rng(3), runs=128, weights=weights,
    )  # fmt: skip
    assert believed.route.weight == 0.0
    assert driven.route.weight == 8.0
    assert driven.driven is not None
    assert driven.share == driven.driven.probability.value <= 0.05
    with pytest.raises(PromiseError, match=r"of 1 routes keeps .* of 16 driven robots get lost"):
        route_within(
            robot, *ACROSS, rash, 0.05,
            runner=rash.runner(), seed=3, runs=128, weights=(0.0, 1e-6),
        )  # fmt: skip


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, float("nan")])
def test_refuses_what_is_no_share(robot: RoutePlanner, share: float) -> None:
    with pytest.raises(InputError, match="max_lost"):
        route_within(robot, *ACROSS, Forecaster(robot.service.map), share)


@pytest.mark.slow
def test_a_limit_on_bad_metres_holds(robot: RoutePlanner) -> None:
    """The search knows no such limit, so it is not asked."""
    amap = robot.service.map
    limited = RoutePlanner(amap, max_bad_metres=8.0, bad_level=0.5)
    promise = route_within(limited, *ACROSS, Forecaster(amap), 0.999, weights=(0.0, 5.0))
    assert promise.route.planner == "reference"
    assert promise.route.longest_bad <= 8.0 + 1e-6


def test_refuses_what_so_few_drives_cannot_confirm(robot: RoutePlanner) -> None:
    forecaster = Forecaster(robot.service.map, "good")
    with pytest.raises(InputError, match=r"16 drives confirm no share below 0\.24, .* drive 96 "):
        route_within(robot, *ACROSS, forecaster, 0.05, runner=forecaster.runner(), seed=1, runs=16)
    assert least_shown(95) > 0.05 > least_shown(96)


@pytest.mark.slow
def test_undecided_drives_keep_no_promise(robot: RoutePlanner) -> None:
    forecaster = rash_forecaster(robot)
    with pytest.raises(
        PromiseError, match=r"is shown to keep .* \d+\.\d to \d+\.\d\) of 32 driven"
    ) as error:
        route_within(
            robot, *ACROSS, forecaster, 0.9,
            runner=forecaster.runner(), seed=1, runs=32, weights=(0.0, 1e-6),
        )  # fmt: skip
    assert error.value.best.driven is not None
    assert error.value.best.driven.side is None
