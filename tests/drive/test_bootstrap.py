"""Intervals of means, differences and shares against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom, binomtest, norm

from ambinav.drive.bootstrap import bootstrap, paired, share
from ambinav.runtime.errors import InputError


@pytest.mark.parametrize(("hits", "count"), [(0, 30), (3, 30), (15, 30), (10, 100), (7, 7)])
def test_a_share_has_wilsons_interval(hits: int, count: int) -> None:
    lost = np.arange(count) < hits
    found = bootstrap(lost, np.random.default_rng(1))
    want = binomtest(hits, count).proportion_ci(0.95, "wilson")
    assert found.value == pytest.approx(hits / count)
    assert (found.low, found.high) == pytest.approx((want.low, want.high), abs=1e-12)
    assert found.count == count and found == share(lost.astype(float))
    percent = found.scaled(100.0)
    assert (percent.low, percent.high, percent.count) == (100 * found.low, 100 * found.high, count)


@pytest.mark.parametrize("count", [30, 100, 500])
@pytest.mark.parametrize("chance", [0.02, 0.1, 0.5])
def test_shares_are_covered(chance: float, count: int) -> None:
    """In the exact mean over all samples; where the bootstrap's intervals are points."""
    hits = np.arange(count + 1)
    weight = binom.pmf(hits, count, chance)
    found = [share(np.arange(count) < k) for k in hits]
    covered = np.array([one.low <= chance <= one.high for one in found])
    assert weight @ covered > 0.93
    drawn = binom.ppf([[0.025], [0.975]], count, hits / count) / count
    by_draws = weight @ ((drawn[0] <= chance) & (chance <= drawn[1]))
    print(f"p {chance}, n {count}: {weight @ covered:.3f}, drawn with replacement {by_draws:.3f}")
    if (chance, count) == (0.02, 30):
        assert by_draws < 0.5


def test_a_share_of_nothing_is_none() -> None:
    found = share(np.zeros(0, dtype=bool))
    assert math.isnan(found.value) and found.count == 0
    with pytest.raises(InputError, match="level is 1"):
        share([True], 1.0)


def test_the_mean_of_many_has_the_normal_interval() -> None:
    values = np.random.default_rng(3).exponential(2.0, 2000)
    found = bootstrap(values, np.random.default_rng(4), level=0.9)
    half = norm.ppf(0.95) * values.std() / math.sqrt(2000)
    assert found.value == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.1 * half
    )


def test_no_hit_and_all_alike_have_no_width() -> None:
    found = bootstrap(np.zeros(30), np.random.default_rng(0))
    assert (found.value, found.low, found.high) == (0.0, 0.0, 0.0)
    assert str(bootstrap([2.0, 2.0], np.random.default_rng(0), statistic="median")) == "2 [2, 2]"


def test_one_run_has_no_interval() -> None:
    rng = np.random.default_rng(0)
    for alone in (bootstrap([2.0], rng), paired([2.0], [1.0], rng, compare="ratio")):
        assert (alone.value, alone.count) == (2.0, 1)
        assert math.isnan(alone.low) and math.isnan(alone.high)


def test_what_a_pair_has_in_common_cancels() -> None:
    rng = np.random.default_rng(5)
    theirs = rng.normal(10.0, 5.0, 40)
    found = paired(theirs - 0.5, theirs, rng)
    assert (found.value, found.low, found.high) == pytest.approx((-0.5, -0.5, -0.5))
    ratio = paired(0.25 * theirs, theirs, rng, compare="ratio")
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.25, 0.25, 0.25))


def test_ratios_by_nothing_are_one_or_infinite() -> None:
    rng, none = np.random.default_rng(6), np.zeros(5)
    assert paired(none, none, rng, compare="ratio").value == 1.0
    assert paired(none + 1.0, none, rng, compare="ratio").low == math.inf


def test_runs_without_a_value_are_left_out() -> None:
    rng = np.random.default_rng(7)
    found = bootstrap([1.0, math.nan, 3.0], rng)
    assert (found.value, found.count) == (2.0, 2)
    assert paired([1.0, math.nan, 3.0], [0.0, 0.0, math.nan], rng).count == 1
    nothing = bootstrap([math.nan], rng)
    assert nothing.count == 0 and math.isnan(nothing.value) and math.isnan(nothing.low)


def test_the_same_seed_gives_the_same_interval() -> None:
    values = np.random.default_rng(8).normal(size=30)
    one, two = (bootstrap(values, np.random.default_rng(9)) for _ in range(2))
    assert one == two


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"level": 1.0}, "level is 1.0"),
        ({"draws": 0}, "draws is 0"),
        ({"statistic": "mode"}, "statistic is 'mode'"),
    ],
)
def test_bad_arguments_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        bootstrap([1.0, 2.0], np.random.default_rng(0), **options)


def test_bad_pairs_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="ours has 1 runs and theirs 2"):
        paired([1.0], [1.0, 2.0], rng)
    with pytest.raises(InputError, match="compare is 'sum'"):
        paired([1.0], [1.0], rng, compare="sum")
    with pytest.raises(InputError, match="shape"):
        bootstrap([[1.0]], rng)
