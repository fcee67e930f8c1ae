"""Figures over places, by hand; and intervals that hold what they should."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, NOT_FREE, OPEN
from ambinav.studies.design.sweep.figures import difference, figures, per_place
from ambinav.studies.design.sweep.turning import NOWHERE, turning

NAN = math.nan
LEVEL = np.array([[0.1, 0.3], [0.5, NAN], [NAN, NAN]], dtype=np.float32)
ZONE = np.array([[LOCALIZABLE, CORRIDOR], [OPEN, NOT_FREE], [NOT_FREE, NOT_FREE]], dtype=np.uint8)
WEIGHT = np.array([1.0, 3.0, 7.0])


def test_places_count_by_weight_and_headings_share_it() -> None:
    found = figures(LEVEL, ZONE, WEIGHT)
    assert found.mean == pytest.approx((0.2 + 3 * 0.5) / 4)
    assert found.worst == pytest.approx(0.5)
    assert found.zones == pytest.approx(
        {"localizable": 0.125, "transition": 0.0, "corridor": 0.125, "open": 0.75}
    )
    assert found.bad == pytest.approx(0.875)
    assert found.standing == pytest.approx(4.0 / 11.0)


def test_the_percentile_is_a_level_that_is_there() -> None:
    level = np.linspace(0.01, 1.0, 100, dtype=np.float32)[:, None]
    found = figures(level, np.zeros((100, 1), dtype=np.uint8), np.ones(100))
    assert found.p95 == pytest.approx(0.95)
    heavy = np.ones(100)
    heavy[-1] = 100.0
    assert figures(level, np.zeros((100, 1), dtype=np.uint8), heavy).p95 == pytest.approx(1.0)


def test_where_nothing_is_known_there_is_no_figure() -> None:
    found = figures(LEVEL[2:], ZONE[2:], WEIGHT[2:])
    assert all(map(math.isnan, (found.mean, found.p95, found.worst, found.bad)))


def test_what_each_place_adds() -> None:
    np.testing.assert_allclose(per_place(LEVEL, ZONE, "mean"), [0.2, 0.5, NAN])  # type: ignore[arg-type]
    np.testing.assert_allclose(per_place(LEVEL, ZONE, "bad"), [0.5, 1.0, NAN])  # type: ignore[arg-type]
    assert per_place(LEVEL, ZONE, "worst") is None


def test_an_interval_holds_the_truth_nineteen_times_in_twenty() -> None:
    rng = np.random.default_rng(1)
    ours, theirs = rng.random(400), rng.random(400)
    true = float((ours - theirs).mean())
    held = 0
    for _ in range(400):
        some = rng.choice(400, 100, replace=False)
        found = difference(ours[some], theirs[some], np.ones(100), 400)
        held += found.low <= true <= found.high
    assert 0.92 <= held / 400 <= 0.98


def test_an_interval_closes_where_all_is_known_and_opens_where_little_is() -> None:
    ours, theirs = np.array([1.0, 3.0, NAN]), np.array([0.0, 1.0, NAN])
    whole = difference(ours, theirs, np.ones(3), 3)
    assert (whole.value, whole.low, whole.high, whole.count) == (1.5, 1.5, 1.5, 2)
    # Each over the places that it has: the difference of the figures that are printed.
    apart = difference(ours, np.array([0.0, 1.0, 5.0]), np.ones(3), 3)
    assert apart.value == pytest.approx(0.0)
    assert math.isinf(difference(ours[:1], theirs[:1], np.ones(1), 3).high)
    assert difference(ours[2:], theirs[2:], np.ones(1), 3).count == 0


def test_an_interval_holds_the_truth_where_either_lacks_places() -> None:
    rng = np.random.default_rng(2)
    theirs = rng.random(400)
    ours = theirs + 0.3 * rng.random(400)
    ours[rng.random(400) < 0.3] = NAN
    theirs[rng.random(400) < 0.1] = NAN
    true = float(np.nanmean(ours) - np.nanmean(theirs))
    held = 0
    for _ in range(400):
        some = rng.choice(400, 100, replace=False)
        found = difference(ours[some], theirs[some], np.ones(100), 400)
        held += found.low <= true <= found.high
    assert 0.92 <= held / 400 <= 0.98


def test_turning_takes_the_best_yaw_at_each_place() -> None:
    level = np.array([[0.2, 0.8, 0.5, NAN], [0.6, 0.1, 0.5, 0.3]], dtype=np.float32)
    zone = np.array([[0, OPEN, 0, NOT_FREE], [CORRIDOR, 0, 0, 0]], dtype=np.uint8)
    found = turning((0.0, 90.0), level, zone, np.array([1.0, 2.0, 1.0, 5.0]), 4)
    assert found is not None
    assert found.fixed == 1
    assert found.best.tolist() == [0, 1, 1, NOWHERE]
    assert found.fixed_mean == pytest.approx((0.6 + 0.2 + 0.5) / 4)
    assert found.gain.value == pytest.approx(0.1)
    assert found.is_worth_it
    assert (found.fixed_bad, found.turned_bad) == pytest.approx((0.25, 0.0))
    assert found.shares == pytest.approx((0.25, 0.75))
    np.testing.assert_allclose(found.gain_at, [0.4, 0.0, 0.0, NAN], atol=1e-6)
    assert turning((0.0,), level[:1, 3:], zone[:1, 3:], np.ones(1), 1) is None
