"""Classes whose robots gain different shares of a scan, against classes of one gain each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION
from ambinav.forecasting.calibrate import calibrate, raw_shares
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.steady_layers import expected_error, lost_rate
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.forecasting.test_calibrate import BEGIN, START, TRUTH, driven_routes
from tests.forecasting.test_forecast import HALL, ROOMS
from tests.geometry import scenes

WIDE = LocalizerClass(name="wide", title="wide", gain=0.3, gain_spread=10.0, slope=0.9)
SINGLE = [replace(WIDE, gain=gain, gain_spread=1.0) for gain in (3.0, 0.3, 0.03)]


def test_robots_are_lost_in_the_mean_over_the_gains(demo_map: AmbiguityMap) -> None:
    mixed, parts = (
        [Forecaster(demo_map, "poor", entry) for entry in entries] for entries in ([WIDE], SINGLE)
    )
    for route in (HALL, ROOMS):
        found = mixed[0](route)
        each = [part(route) for part in parts]
        raw = np.mean([[WIDE.raw(p) for p in own.lost] for own in each], axis=0)
        np.testing.assert_allclose(found.lost, WIDE.calibrated(raw), atol=1e-5)
        # Who is not lost is who gains most.
        np.testing.assert_array_equal(found.covariance, each[0].covariance)
        assert mixed[0].lost_probabilities([route])[0] == found.lost_probability


def test_layers_are_of_the_same_mixture() -> None:
    laser = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor=laser, beams=60, aperture=2.0 * math.pi)
    context = LayerContext.of(build_map(scenes.room(12.0, 3.0), scanner, spacing=0.5))
    errors, rates = (
        [layer(context, odometry="poor", localizer=entry)[name] for entry in (WIDE, *SINGLE)]
        for name, layer in (("expected_error", expected_error), ("lost_rate", lost_rate))
    )
    np.testing.assert_array_equal(errors[0], errors[1])
    inside = np.isfinite(rates[0])
    assert (rates[0] > rates[1])[inside].any()
    assert (rates[0] >= np.min(rates[1:], axis=0))[inside].all()
    assert (rates[0] <= np.max(rates[1:], axis=0))[inside].all()


@pytest.mark.slow
def test_the_spread_is_found_again() -> None:
    rng, truth = np.random.default_rng(11), replace(TRUTH, gain_spread=30.0)
    routes = driven_routes(rng, 160, 200, truth)
    begin = replace(BEGIN, gain_spread=5.0)
    found = calibrate(begin, routes, rng, start_std=START, folds=2)
    start = np.diag(np.square(START))
    ours, theirs = (
        entry.calibrated(raw_shares(entry, routes, start)) for entry in (found.localizer, truth)
    )
    assert np.abs(ours - theirs).mean() < 0.01
    assert found.localizer.gain_spread > 8.0
    single = calibrate(replace(begin, gain_spread=1.0), routes, rng, start_std=START, folds=2)
    assert single.localizer.gain_spread == 1.0
    assert found.skill.value > single.skill.value


def test_one_gain_is_one_filter() -> None:
    assert len(WIDE.settings(LOST_POSITION, LOST_HEADING)) == 3
    (own,) = SINGLE[0].settings(LOST_POSITION, LOST_HEADING)
    assert own == WIDE.settings(LOST_POSITION, LOST_HEADING)[0]._replace(gain=own.gain)
    with pytest.raises(InputError, match=r"gain_spread is 0\.5; give 1 or more"):
        replace(WIDE, gain_spread=0.5)


@pytest.mark.slow
def test_routes_within_a_share_are_found_among_those_of_several_weights(
    demo_map: AmbiguityMap,
) -> None:
    """The search within a share is for one gain."""
    pytest.importorskip("ompl")
    from ambinav_planners import RoutePlanner, route_within

    forecaster = Forecaster(demo_map, "poor", WIDE)
    shortest = forecaster(RoutePlanner(demo_map).plan((3.0, 3.0), (42.0, 20.0), weight=0.0))
    most = 0.5 * shortest.lost_probability
    promise = route_within(RoutePlanner(demo_map), (3.0, 3.0), (42.0, 20.0), forecaster, most)
    assert forecaster(promise.route).lost_probability <= most
