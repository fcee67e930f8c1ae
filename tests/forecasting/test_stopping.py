"""The confidence sequence: its definition, its coverage under continuous looking, stopping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import beta, binom

from ambinav.drive.bootstrap import Interval, share
from ambinav.forecasting.stopping import StoppingRule, confidence_sequence, side
from ambinav.runtime.errors import InputError


@pytest.mark.parametrize(("events", "count"), [(0, 5), (3, 40), (20, 40), (40, 40), (1, 1000)])
def test_ends_are_where_the_mixture_is_20_times_as_likely(events: int, count: int) -> None:
    interval = confidence_sequence(events, count)
    likelihood = np.linspace(0.0, 1.0, 200_001)
    mixture = np.mean(binom.pmf(events, count, beta(0.5, 0.5).ppf((likelihood + 5e-6)[:-1])))
    for end in (interval.low, interval.high):
        if 0.0 < end < 1.0:
            assert mixture / binom.pmf(events, count, end) == pytest.approx(20.0, rel=1e-3)
    assert interval.low <= events / count <= interval.high
    fixed = share(np.arange(count) < events)
    assert interval.high - interval.low > fixed.high - fixed.low or count < 10


def test_no_runs_leave_all_shares() -> None:
    interval = confidence_sequence(0, 0)
    assert math.isnan(interval.value) and (interval.low, interval.high) == (0.0, 1.0)


def test_events_and_no_events_mirror_each_other() -> None:
    ours, theirs = confidence_sequence(3, 50), confidence_sequence(47, 50)
    assert (ours.low, ours.high) == pytest.approx((1.0 - theirs.high, 1.0 - theirs.low))


@pytest.mark.parametrize("truth", [0.02, pytest.param(0.3, marks=pytest.mark.sweep)])
def test_covers_though_looked_at_after_each_run(truth: float) -> None:
    """Of 1000 sequences at most 5 % ever exclude the truth; of ordinary intervals far more do."""
    runs, sequences = 200, 1000
    events = np.cumsum(np.random.default_rng(4).random((sequences, runs)) < truth, axis=1)
    outside = np.zeros((2, sequences), dtype=bool)
    for count in range(1, runs + 1):
        for seen in np.unique(events[:, count - 1]).tolist():
            rows = events[:, count - 1] == seen
            for k, interval in enumerate(
                (confidence_sequence(seen, count), share(np.arange(count) < seen))
            ):
                outside[k, rows] |= not interval.low <= truth <= interval.high
    ours, ordinary = outside.mean(axis=1)
    assert ours < 0.05 + 2.0 * math.sqrt(0.05 * 0.95 / sequences)
    assert ordinary > 0.15


@pytest.mark.parametrize(
    ("truth", "expected"), [(0.5, "above"), pytest.param(0.002, "below", marks=pytest.mark.slow)]
)
def test_stops_early_where_the_truth_is_far_from_the_threshold(truth: float, expected: str) -> None:
    rule, rng = StoppingRule(threshold=0.1), np.random.default_rng(2)
    needed = []
    for _ in range(100):
        events = np.cumsum(rng.random(400) < truth)
        for count in range(1, 401):
            interval = confidence_sequence(int(events[count - 1]), count)
            if rule.met(interval):
                assert side(interval, 0.1) == expected
                break
        needed.append(count)
    assert np.quantile(needed, 0.9) < (30 if truth == 0.5 else 90)


def test_stops_at_a_width() -> None:
    rule = StoppingRule(width=0.2)
    assert rule.met(Interval(0.5, 0.4, 0.6 - 1e-9, 10))
    assert not rule.met(Interval(0.5, 0.4, 0.61, 10))


def test_refuses_what_is_of_no_use() -> None:
    for wrong in ({"threshold": 0.0}, {"threshold": 1.5}, {"width": -0.1}):
        with pytest.raises(InputError, match="between 0 and 1"):
            StoppingRule(**wrong)
    with pytest.raises(InputError, match="events"):
        confidence_sequence(3, 2)
    with pytest.raises(InputError, match="level"):
        confidence_sequence(0, 2, 1.0)
