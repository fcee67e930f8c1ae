"""Layers of the forecast's steady state against the forecast itself, on floor that is alike."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.drive.noise import OdometryNoise
from ambinav.drive.odometries import ODOMETRIES
from ambinav.forecasting.filter_kernel import FilterSettings
from ambinav.forecasting.forecast import START_STD, Forecaster
from ambinav.forecasting.steady_kernel import steady_rows
from ambinav.forecasting.steady_layers import DIRECTIONS, expected_error, lost_rate
from ambinav.geometry.environment import Environment
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.forecasting.test_filter import even_field, run, straight
from tests.geometry import scenes

Floats = NDArray[np.float64]
SETTINGS = FilterSettings(0.5, 0.4, 0.25, 0.2, 0.5, math.inf, math.radians(30.0))
START = np.diag(np.square(START_STD))
DOUBLINGS = 8
METRES = (1 + 2**DOUBLINGS) * SETTINGS.distance
CORRIDOR = np.diag([0.05, 200.0, 80.0])
"""What a scan tells in a corridor along x: little along it."""
COUPLED = np.array([[3.0, 1.0, 2.0], [1.0, 6.0, -3.0], [2.0, -3.0, 30.0]])


def state(
    matrix: Floats, heading: float, noise: OdometryNoise, doublings: int = DOUBLINGS
) -> tuple[Floats, float]:
    """Return the position's covariance and the lost share."""
    spread, lost = np.empty((1, 1, 3)), np.empty((1, 1))
    turning = np.diag([1.0, 1.0, math.sqrt(SETTINGS.turn_gain)])
    gained = SETTINGS.gain * turning @ matrix @ turning
    steady_rows(
        0, 1, gained[np.newaxis], np.array([heading]), START, noise.packed, SETTINGS, doublings,
        spread, lost,
    )  # fmt: skip
    return spread[0, 0, [[0, 1], [1, 2]]], float(lost[0, 0])


def steady(
    matrix: Floats, heading: float, noise: OdometryNoise, doublings: int = DOUBLINGS
) -> tuple[float, float]:
    """Return root mean square error and lost share."""
    covariance, lost = state(matrix, heading, noise, doublings)
    return math.sqrt(np.trace(covariance)), lost


@pytest.mark.parametrize("odometry", ["mediocre", "poor"])
@pytest.mark.parametrize("matrix", [CORRIDOR, 0.1 * COUPLED, np.diag([0.3, 0.3, 1.0])])
def test_lost_share_is_the_forecast_of_such_floor(matrix: Floats, odometry: str) -> None:
    noise = ODOMETRIES[odometry]
    _, expected = run(
        straight(METRES, SETTINGS.distance), even_field(matrix, 700), noise, SETTINGS, START
    )
    _, lost = steady(matrix, 0.0, noise)
    assert 1e-4 < expected[-1] < 1.0
    assert lost == pytest.approx(expected[-1], rel=0.02)
    # It does not grow in proportion, so that a rate needs a length.
    if expected[-1] < 0.05:
        assert expected[len(expected) // 2] > 0.6 * expected[-1]


def test_error_has_settled_where_scans_tell_the_position() -> None:
    noise = OdometryNoise()
    for matrix in (100.0 * COUPLED, 1000.0 * CORRIDOR):
        covariance, _ = run(
            straight(METRES, SETTINGS.distance), even_field(matrix, 700), noise, SETTINGS, START
        )
        error, lost = steady(matrix, 0.0, noise)
        settled = state(matrix, 0.0, noise)[0]
        np.testing.assert_allclose(settled, covariance[-1, :2, :2], rtol=1e-3, atol=1e-4 * error**2)
        assert error == pytest.approx(math.sqrt(np.trace(covariance[-1, :2, :2])), rel=1e-4)
        assert error == pytest.approx(steady(matrix, 0.0, noise, 12)[0], rel=1e-3)
        assert lost < 1e-3


def test_error_of_dead_reckoning() -> None:
    """Where scans tell nothing: the closed form of the odometry's model, without a ceiling."""
    noise = OdometryNoise()
    packed, L, d = noise.packed, METRES, SETTINGS.distance
    along = packed.trans_trans * L
    across = 2.0 * packed.turn_trans * L**3 / 3.0
    start = START[0, 0] + START[1, 1] + START[2, 2] * L**2
    error, lost = steady(np.zeros((3, 3)), 0.7, noise)
    assert error**2 == pytest.approx(along + across + start, rel=2.0 * d / L)
    assert lost > 0.99
    assert steady(np.zeros((3, 3)), 0.7, noise, DOUBLINGS + 1)[0] > 2.0 * error


def test_the_frame_does_not_matter() -> None:
    angle = 0.8
    turn = np.array(
        [
            [math.cos(angle), -math.sin(angle), 0.0],
            [math.sin(angle), math.cos(angle), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    noise = OdometryNoise()
    assert steady(turn @ COUPLED @ turn.T, 0.3 + angle, noise) == pytest.approx(
        steady(COUPLED, 0.3, noise)
    )


def corridor() -> Environment:
    """A corridor of 80 m; a laser of 4 m sees its ends only near them."""
    return scenes.room(80.0, 2.0)


@pytest.fixture(scope="module")
def laser() -> RangeScanner:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor=sensor, beams=60, aperture=2.0 * math.pi)


@pytest.fixture(scope="module")
def corridor_map(laser: RangeScanner) -> AmbiguityMap:
    return build_map(corridor(), laser, spacing=0.25)


def test_a_corridor_loses_what_its_forecast_says(corridor_map: AmbiguityMap) -> None:
    options = {"directions": 1, "odometry": "good"}
    amap = with_layers(corridor_map, ["expected_error", "lost_rate"],
                       expected_error=options, lost_rate=options)  # fmt: skip
    rate, error = (float(amap.sample(name, 40.0, 1.0)) for name in ("lost_rate", "expected_error"))
    driven = 64.25
    forecast = Forecaster(amap, "good")(Route.through([[8.0, 1.0], [8.0 + driven, 1.0]]))
    # The floor is not quite the same everywhere: the map's cells meet the walls in other places.
    assert -math.expm1(-rate * driven) == pytest.approx(forecast.lost_probability, rel=0.1)
    assert forecast.lost_probability > 0.01
    assert error > 2.0 * float(amap.sample("expected_error", 1.5, 1.0))
    assert amap.dataset["lost_rate"].attrs["units"] == "1/m"


def test_headings_are_those_of_the_map(laser: RangeScanner) -> None:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    ahead = RangeScanner.planar(sensor=sensor, beams=30, aperture=math.pi)
    amap = build_map(scenes.room(12.0, 3.0), ahead, spacing=0.5)
    context = LayerContext.of(amap)
    errors = expected_error(context)["expected_error"]
    assert errors.shape == amap.dataset["level"].shape
    assert np.isfinite(errors[amap.possible]).all()
    assert (lost_rate(context)["lost_rate"][amap.possible] >= 0.0).all()


def test_directions_are_averaged(corridor_map: AmbiguityMap) -> None:
    context = LayerContext.of(corridor_map)
    each = [expected_error(context, directions=n)["expected_error"] for n in (1, DIRECTIONS)]
    assert each[0].shape == each[1].shape == corridor_map.dataset["level"].shape
    assert not np.allclose(*each, equal_nan=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"odometry": "wheels"}, "odometry is 'wheels'"),
        ({"localizer": "gps"}, "localizer is 'gps'"),
        ({"metres": 0.0}, "metres is 0.0; "),
        ({"directions": 0}, "directions"),
    ],
)
def test_bad_options(corridor_map: AmbiguityMap, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        with_layers(corridor_map, ["lost_rate"], lost_rate=options)
