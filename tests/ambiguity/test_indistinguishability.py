"""J, rho and the evidence: against Monte Carlo, the closed form and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.ambiguity.indistinguishability import (
    MOST,
    Z_MAX,
    Z_STEP,
    evidence,
    evidence_table,
    indistinguishability,
    same_reading,
    same_reading_averaged,
)
from ambinav.sensing import RangeSensor

SENSOR = RangeSensor(max_range=3.0, std=0.02, resolution=0.05, random_share=0.03, lost_share=0.05)
CLEAN = RangeSensor(max_range=50.0, std=0.02, resolution=0.05, random_share=0.0)
RANGES = st.one_of(st.floats(0.0, 5.0), st.just(math.inf))


# -- J -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "second"),
    [(1.0, 1.0), (1.0, 1.02), (1.024, 1.026), (1.0, 1.1), (2.97, 3.02), (2.99, math.inf),
     (math.inf, math.inf), (0.01, 0.0), (1.0, 2.0)],
)  # fmt: skip
def test_same_reading_is_how_often_two_captures_agree(first: float, second: float) -> None:
    count, rng = 400_000, np.random.default_rng(7)
    a = SENSOR.read(np.full(count, first), rng)
    b = SENSOR.read(np.full(count, second), rng)
    expected = float(same_reading(SENSOR, first, second))
    deviation = math.sqrt(expected * (1 - expected) / count)
    assert np.mean(a == b) == pytest.approx(expected, abs=4.5 * deviation)


@pytest.mark.parametrize("std", [0.01, 0.02, 0.07])
@pytest.mark.parametrize("difference", [0.0, 0.01, 0.04, 0.05, 0.12])
def test_averaged_over_the_phase_of_the_bins_it_is_the_closed_form(
    std: float, difference: float
) -> None:
    sensor = RangeSensor(max_range=5.0, std=std, resolution=0.05, random_share=0.0)
    first = 2.0 + 0.05 * np.arange(256) / 256
    averaged = same_reading(sensor, first, first + difference).mean()
    closed = float(same_reading_averaged(difference, std, std, 0.05))
    assert averaged == pytest.approx(closed, abs=1e-9)


def test_closed_form_with_two_deviations() -> None:
    # The density of the difference of two readings, folded with the triangle of two bins.
    first, second, delta, d = 0.02, 0.05, 0.1, 0.07
    u = np.linspace(-delta, delta, 20001)
    t = math.hypot(first, second)
    density = np.exp(-0.5 * ((u - d) / t) ** 2) / (t * math.sqrt(2 * math.pi))
    expected = np.trapezoid(density * (1 - np.abs(u) / delta), u)
    assert float(same_reading_averaged(d, first, second, delta)) == pytest.approx(
        expected, rel=1e-6
    )
    assert float(same_reading_averaged(-d, second, first, delta)) == pytest.approx(
        expected, rel=1e-6
    )


def test_the_example_of_the_design() -> None:
    # J(d, d) for bins of 1 cm and a deviation of 5 mm.
    assert float(same_reading_averaged(0.0, 0.005, 0.005, 0.01)) == pytest.approx(0.486, abs=5e-4)


@pytest.mark.parametrize("std", [0.0, 1e-9])
def test_without_noise_it_is_the_triangle(std: float) -> None:
    d = np.linspace(-0.2, 0.2, 81)
    triangle = np.maximum(0.0, 1 - np.abs(d) / 0.1)
    assert same_reading_averaged(d, std, std, 0.1) == pytest.approx(triangle, abs=1e-7)


def test_far_apart_it_falls_to_nothing_without_noise_of_rounding() -> None:
    value = same_reading_averaged(np.array([0.5, 1.0, 5.0, 100.0]), 0.02, 0.02, 0.01)
    assert (value >= 0).all() and (np.diff(value) <= 0).all() and value[-1] == 0.0


def test_both_out_of_range() -> None:
    assert float(same_reading(CLEAN, math.inf, math.inf)) == 1.0
    for sensor in (CLEAN, SENSOR):
        assert float(indistinguishability(sensor, math.inf, math.inf)) == pytest.approx(1.0)
        assert float(indistinguishability(sensor, math.inf, 99.0)) == pytest.approx(1.0)


# -- rho ---------------------------------------------------------------------------------------


@pytest.mark.slow
@given(RANGES, RANGES)
def test_rho_is_a_symmetric_share(first: float, second: float) -> None:
    rho = float(indistinguishability(SENSOR, first, second))
    assert 0.0 < rho <= 1.0
    assert rho == pytest.approx(float(indistinguishability(SENSOR, second, first)))
    assert float(indistinguishability(SENSOR, first, first)) == pytest.approx(1.0)
    assert float(same_reading(SENSOR, first, second)) == pytest.approx(
        float(same_reading(SENSOR, second, first))
    )


def test_rho_broadcasts() -> None:
    first = np.array([1.0, 1.01, math.inf])
    table = indistinguishability(SENSOR, first[:, None], first)
    assert table.shape == (3, 3)
    assert np.diag(table) == pytest.approx(1.0)
    assert float(indistinguishability(SENSOR, 1.0, 1.01)) == table[0, 1]


# -- evidence ----------------------------------------------------------------------------------


@pytest.mark.parametrize("width", [0.0, 1e-7, 1e-3, 0.05])
def test_fine_bins_tell_a_quarter_of_z_squared(width: float) -> None:
    z = np.array([0.0, 0.1, 1.0, 3.0, 6.0, 10.0])
    assert evidence(z, width) == pytest.approx(z * z / 4, rel=1e-3, abs=1e-7)


def test_up_to_the_bound_called_fine_it_is_so_to_a_ten_thousandth() -> None:
    from ambinav.ambiguity.indistinguishability import FINE

    z = np.linspace(0.05, 3.0, 60)
    assert np.abs(evidence(z, FINE) / (z * z / 4) - 1).max() < 2e-3


@pytest.mark.parametrize("width", [0.3, 1.0, 2.0, 3.0])
def test_it_is_rho_averaged_over_the_phase(width: float) -> None:
    # In metres: a deviation and a resolution that make bins of this width.
    effective = 0.04
    delta = width * effective
    sigma = math.sqrt(effective**2 - delta**2 / 12)
    for z in (0.2, 1.0, 2.5):
        ratio = same_reading_averaged(z * effective, sigma, sigma, delta)
        ratio /= same_reading_averaged(0.0, sigma, sigma, delta)
        assert float(evidence(z, width)) == pytest.approx(-math.log(float(ratio)), rel=1e-9)


def test_bins_without_noise_tell_all_once_they_part() -> None:
    widest = math.sqrt(12.0)
    assert float(evidence(widest / 2, widest)) == pytest.approx(math.log(2.0), rel=1e-6)
    assert float(evidence(widest * 1.001, widest)) == MOST


@pytest.mark.parametrize("width", [0.0, 0.6, 2.0, 3.4, 5.0])
def test_it_starts_at_nothing_grows_and_ends(width: float) -> None:
    values = evidence(np.linspace(-40, 40, 1601), width)
    assert values.min() == pytest.approx(0.0, abs=1e-12)
    assert values.max() <= MOST and np.isfinite(values).all()
    half = values[800:]
    assert (np.diff(half) >= -1e-9).all()
    assert values == pytest.approx(values[::-1])


@pytest.mark.parametrize("width", [0.6, 1.0, 2.0, 3.0])
def test_the_table_interpolates_the_evidence(width: float) -> None:
    z = np.random.default_rng(3).uniform(0.0, Z_MAX, 3000)
    (row,) = evidence_table(np.array([width]))
    assert row.dtype == np.float32
    ratio = np.interp(z, np.arange(len(row)) * Z_STEP, row)
    exact = evidence(z, width)
    counts = exact < 18.0  # beyond exp(-18) nothing matters
    assert np.abs(ratio * z * z / 4 - exact)[counts].max() < 3e-3
    assert np.abs(ratio * z * z / 4 - exact)[exact < 3.0].max() < 5e-4
