"""Calibration against drives whose truth is known, and the scores against their definitions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.calibrate import (
    DrivenRoute,
    brier_skill,
    calibrate,
    raw_shares,
    skill_ceiling,
    skill_interval,
)
from ambinav.forecasting.localizer_class import LocalizerClass, log_odds
from ambinav.runtime.errors import InputError
from tests.forecasting.test_filter import even_field, straight

BEGIN = LocalizerClass(name="test", title="a test", gain=0.25)
TRUTH = replace(BEGIN, gain=0.6, turn_gain=0.3, offset=-0.4, slope=0.8)
START = (0.05, 0.05, 0.02)


def driven_routes(
    rng: np.random.Generator,
    count: int,
    runs: int,
    truth: LocalizerClass = TRUTH,
    echoes: tuple[float, ...] = (),
) -> list[DrivenRoute]:
    """Routes whose robots get lost as `truth` says, with such shares of beams with an echo."""
    fields = [
        even_field(
            np.diag([weak, 3.0 * weak, 4.0 * weak + turn]),
            echoes=np.diag([share, share, 5.0]) if echoes else None,
        )
        for weak in (0.0, 0.5, 2.0, 8.0) for turn in (1.0, 50.0) for share in echoes or (0.0,)
    ]  # fmt: skip
    routes = []
    for k in range(count):
        noise = OdometryNoise(scale=rng.choice([0.25, 0.5, 0.8]))
        poses = straight(rng.uniform(2.0, 9.0), 0.25)
        building = f"building-{k % 10}"
        routes.append(DrivenRoute(building, fields[k % len(fields)], poses, noise, 0, runs))
    shares = truth.calibrated(raw_shares(truth, routes, np.diag(np.square(START))))
    return [
        replace(route, lost=int(rng.binomial(runs, share)))
        for route, share in zip(routes, shares.tolist(), strict=True)
    ]


@pytest.mark.slow
def test_finds_the_truth_again() -> None:
    rng = np.random.default_rng(1)
    routes = driven_routes(rng, 160, 200)
    done: list[float] = []
    result = calibrate(BEGIN, routes, rng, start_std=START, folds=3, progress=done.append)
    assert result.localizer.gain == pytest.approx(TRUTH.gain, rel=0.25)
    assert result.localizer.slope == pytest.approx(TRUTH.slope, rel=0.15)
    assert result.localizer.offset == pytest.approx(TRUTH.offset, abs=0.25)
    assert result.skill.value == pytest.approx(result.ceiling, abs=0.02)
    assert done == sorted(done)
    assert sum(each.routes for each in result.localizer.reliability) == len(routes)
    start = np.diag(np.square(START))
    ours, theirs = (
        entry.calibrated(raw_shares(entry, routes, start)) for entry in (result.localizer, TRUTH)
    )
    assert np.abs(ours - theirs).max() < 0.05


@pytest.mark.slow
def test_finds_the_truth_beyond_the_limit_by_echoes() -> None:
    rng, truth = np.random.default_rng(7), replace(TRUTH, gain=3.0, echo_gain=4.0)
    routes = driven_routes(rng, 160, 200, truth, (0.02, 0.2, 1.0))
    begin = replace(BEGIN, echo_gain=truth.echo_gain)
    found = calibrate(begin, routes, rng, start_std=START, folds=2).localizer
    assert found.echo_gain == truth.echo_gain
    assert found.gain == pytest.approx(truth.gain, rel=0.3)
    assert found.slope == pytest.approx(truth.slope, rel=0.15)


def test_skill_is_none_for_the_base_rate_and_reaches_the_ceiling() -> None:
    rng = np.random.default_rng(2)
    truth = rng.beta(0.3, 1.0, size=4000)
    runs = np.full(4000, 8)
    shares = rng.binomial(8, truth) / 8.0
    assert brier_skill(np.full(4000, shares.mean()), shares) == pytest.approx(0.0, abs=1e-12)
    assert brier_skill(truth, shares) == pytest.approx(skill_ceiling(shares, runs), abs=0.02)
    # Of single drives: one row each, as Brier scored them.
    outcomes = (rng.random((4000, 50)) < truth[:, None]).astype(float)
    score = float(((truth[:, None] - outcomes) ** 2).mean())
    base = float(outcomes.mean())
    expected = 1.0 - score / (base * (1.0 - base))
    assert brier_skill(truth, outcomes.mean(axis=1)) == pytest.approx(expected)


def test_interval_holds_the_value() -> None:
    rng = np.random.default_rng(3)
    truth = rng.beta(0.3, 1.0, size=300)
    shares = rng.binomial(8, truth) / 8.0
    buildings = np.array([f"b{k % 12}" for k in range(300)])
    interval = skill_interval(truth, shares, buildings, rng)
    assert interval.low < interval.value < interval.high
    assert interval.count == 12


def test_refuses_what_cannot_be_fitted() -> None:
    rng = np.random.default_rng(4)
    routes = driven_routes(rng, 20, 10)
    few = [route for route in routes if route.building in ("building-1", "building-2")]
    with pytest.raises(InputError, match="routes are in 2 buildings; give drives in at least 5"):
        calibrate(BEGIN, few, rng, start_std=START)
    none = [replace(route, lost=0) for route in routes]
    with pytest.raises(InputError, match="of all robots 0 % got lost; give drives"):
        calibrate(BEGIN, none, rng, start_std=START)


def test_log_odds_are_finite() -> None:
    assert np.isfinite(log_odds(np.array([0.0, 0.5, 1.0]))).all()
    assert log_odds(np.array([0.5]))[0] == 0.0
