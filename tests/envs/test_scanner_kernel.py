"""Readings that the kernel makes of true ranges, against the sensor's own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from scipy import stats

from ambinav.localization.random import states
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.curves import Polynomial
from ambinav_envs.simulation.scanner_kernel import ScannerArrays, capture, scanner_arrays

SENSORS = {
    "steady": RangeSensor(
        max_range=4.0, min_range=0.1, std=0.03, bias=0.02, resolution=0.01, random_share=0.0
    ),
    "growing": RangeSensor(
        max_range=4.0,
        min_range=0.1,
        std=Polynomial((0.01, 0.02)),
        resolution=0.001,
        random_share=0.0,
    ),
    "odd": RangeSensor(
        max_range=4.0, min_range=0.1, std=0.03, resolution=0.5, random_share=0.2, lost_share=0.1
    ),
    "mostly odd": RangeSensor(max_range=4.0, std=0.03, resolution=0.5, random_share=0.95),
}


@njit
def captured(ranges, scanner, state, noise, readings):
    for row in range(len(readings)):
        capture(ranges, scanner, state, noise, readings, row)


def arrays_of(sensor: RangeSensor, beams: int) -> ScannerArrays:
    return scanner_arrays(RangeScanner.planar(sensor, beams, 2.0 * math.pi))


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("true", [0.05, 0.11, 2.3, 3.98, math.inf])
def test_readings_are_distributed_as_the_sensors(name: str, true: float) -> None:
    sensor = SENSORS[name]
    ranges, readings = np.full(20, true), np.empty((1000, 20))
    state = states(np.random.default_rng(1), 1)[0]
    captured(ranges, arrays_of(sensor, 20), state, np.empty(20), readings)
    wanted = sensor.read(np.full(20_000, true), np.random.default_rng(2))
    for which in (np.isposinf, np.isneginf):
        assert which(readings).mean() == pytest.approx(which(wanted).mean(), abs=0.02)
    # The sensor gives float32; the bins' middles are the same.
    seen, expected = (np.round(r[np.isfinite(r)].astype(float), 5) for r in (readings, wanted))
    if min(len(seen), len(expected)) > 100:
        assert stats.ks_2samp(seen, expected).pvalue > 1e-4
    # No beam is odd more often than another.
    if name == "odd" and true == 2.3:
        share = np.isposinf(readings).mean(axis=0)
        assert np.abs(share - 0.1).max() < 0.05


def test_outside_of_the_free_space_is_too_near() -> None:
    readings = np.empty((1, 20))
    for name in ("steady", "growing"):
        scanner = arrays_of(SENSORS[name], 20)
        state = states(np.random.default_rng(1), 1)[0]
        captured(np.full(20, math.nan), scanner, state, np.empty(20), readings)
        assert (readings == -math.inf).all()
