"""Bootstrap intervals against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom, norm

from ambinav.drive.bootstrap import bootstrap, paired
from ambinav.errors import InputError


@pytest.mark.parametrize(("hits", "count"), [(3, 30), (15, 30), (10, 100)])
def test_a_share_has_the_quantiles_of_a_binomial(hits: int, count: int) -> None:
    """Drawn with replacement, the number of hits is binomial: exactly, to the count's steps."""
    lost = np.arange(count) < hits
    found = bootstrap(lost, np.random.default_rng(1), draws=20_000)
    want = binom.ppf([0.025, 0.975], count, hits / count) / count
    assert found.value == pytest.approx(hits / count)
    assert (found.low, found.high) == pytest.approx(want, abs=1.0 / count + 1e-12)
    assert found.count == count


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
