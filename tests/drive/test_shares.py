"""Intervals of shares and their differences against likelihoods, papers and simulations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import xlogy
from scipy.stats import multinomial, norm

from ambinav.drive.bootstrap import bootstrap, paired, paired_share, share
from ambinav.drive.shares import Evidence, evidence_of, newcombe, tango
from ambinav.runtime.errors import InputError

Z = float(norm.ppf(0.975))


def pairs(gained: int, lost: int, count: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Runs with ours and with theirs: so many with one alone, all others with neither."""
    number = np.arange(count)
    return number < gained, (number >= gained) & (number < gained + lost)


def score(difference: float, gained: int, lost: int, count: int) -> float:
    """The score statistic of a difference, with the likeliest nuisance found by search."""

    def unlikely(theirs: float) -> float:
        ours = theirs + difference
        rest = 1.0 - ours - theirs
        return float(
            -(xlogy(gained, ours) + xlogy(lost, theirs) + xlogy(count - gained - lost, rest))
        )

    low, high = max(0.0, -difference), (1.0 - difference) / 2.0
    theirs = minimize_scalar(
        unlikely, bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    ).x
    variance = (2.0 * theirs + difference - difference**2) / count
    return float((difference - (gained - lost) / count) / math.sqrt(variance))


@pytest.mark.parametrize("counts", [(1, 9, 44), (3, 1, 30), (0, 4, 30), (20, 5, 100), (7, 7, 20)])
def test_the_ends_are_where_the_score_is_the_quantile(counts: tuple[int, int, int]) -> None:
    found = paired_share(*pairs(*counts))
    assert found.value == pytest.approx((counts[0] - counts[1]) / counts[2])
    assert score(found.low, *counts) == pytest.approx(-Z, abs=2e-3)
    assert score(found.high, *counts) == pytest.approx(Z, abs=2e-3)


def test_of_no_difference_at_all() -> None:
    """Equation 8 at 0 of N discordant pairs: |d| = z^2 / (N + z^2)."""
    found = paired_share(*pairs(0, 0, 30))
    end = Z * Z / (30 + Z * Z)
    assert (found.value, found.low, found.high) == pytest.approx((0.0, -end, end))
    both = paired([True] * 30, [True] * 30, np.random.default_rng(0))
    assert both == found


def test_it_is_symmetric_and_holds_what_cannot_be_more() -> None:
    one, other = (paired_share(*pairs(*counts)) for counts in ((5, 1, 25), (1, 5, 25)))
    assert (one.low, one.high) == pytest.approx((-other.high, -other.low))
    always = paired_share(*pairs(10, 0, 10))
    assert always.high == pytest.approx(1.0) and 0.4 < always.low < 1.0


@pytest.mark.parametrize(
    ("counts", "ends"),
    [((56, 70, 48, 80), (0.0524, 0.3339)), ((9, 10, 3, 10), (0.1705, 0.8090)),
     ((10, 10, 0, 10), (0.6075, 1.0)), ((0, 10, 0, 10), (-0.2775, 0.2775))],
)  # fmt: skip
def test_other_runs_as_in_the_paper(
    counts: tuple[int, int, int, int], ends: tuple[float, float]
) -> None:
    """Newcombe 1998, table II, method 10."""
    a, m, b, n = counts
    found = newcombe(a / m, b / n, Evidence(m, Z), Evidence(n, Z))
    assert found == pytest.approx(ends, abs=6e-5)


@pytest.mark.slow(kept=("chances0-30", "chances3-100", "chances5-30"))
@pytest.mark.parametrize("count", [30, 100])
@pytest.mark.parametrize(
    "chances", [(0.02, 0.0), (0.02, 0.02), (0.1, 0.02), (0.25, 0.25), (0.5, 0.0), (0.3, 0.02)]
)
def test_differences_are_covered(chances: tuple[float, float], count: int) -> None:
    """In the exact mean over all samples; the bootstrap's interval of the same beside it."""
    gained, lost = chances
    evidence = Evidence(float(count), Z)
    ours = drawn = 0.0
    rng = np.random.default_rng(1)
    for b in range(count + 1):
        for c in range(count - b + 1):
            weight = multinomial.pmf(
                [b, c, count - b - c], count, [gained, lost, 1 - gained - lost]
            )
            if weight < 1e-5:
                continue
            low, high = tango(b / count, c / count, evidence)
            ours += weight * (low <= gained - lost <= high)
            rows = rng.multinomial(count, [b / count, c / count, 1 - (b + c) / count], size=400)
            ends = np.quantile((rows[:, 0] - rows[:, 1]) / count, [0.025, 0.975])
            drawn += weight * (ends[0] <= gained - lost <= ends[1])
    print(f"{gained:g} and {lost:g} of {count}: {ours:.3f}, bootstrap {drawn:.3f}")
    assert ours > 0.94
    if (chances, count) == ((0.02, 0.0), 30):
        assert drawn < 0.5


def clustered(
    chance: float, groups: int, size: int, correlation: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Runs in groups whose chances are drawn from a beta distribution, shape (groups, size)."""
    chances = np.full(groups, chance)
    if correlation > 0.0:
        spread = 1.0 / correlation - 1.0
        chances = rng.beta(chance * spread, (1.0 - chance) * spread, groups)
    return np.asarray(rng.random((groups, size)) < chances[:, None])


SAMPLES = 1500


@pytest.mark.slow(kept=("0.02-8-19-0.1", "0.02-30-5-0.0", "0.5-8-19-0.05", "0.5-30-32-0.1"))
@pytest.mark.parametrize("correlation", [0.0, 0.05, 0.1])
@pytest.mark.parametrize(("groups", "size"), [(8, 19), (30, 5), (30, 32)])
@pytest.mark.parametrize("chance", [0.02, 0.5])
def test_shares_over_buildings_are_covered(
    chance: float, groups: int, size: int, correlation: float
) -> None:
    rng = np.random.default_rng(2)
    group = np.repeat(np.arange(groups), size)
    covered = 0
    for _ in range(SAMPLES):
        found = share(clustered(chance, groups, size, correlation, rng).ravel(), group=group)
        covered += found.low <= chance <= found.high
    print(f"{chance:g}, {groups} of {size}, {correlation:g}: {covered / SAMPLES:.3f}")
    assert covered / SAMPLES > 0.93


@pytest.mark.slow(kept=("0.02-8-19-0.1", "0.5-30-5-0.0"))
@pytest.mark.parametrize("correlation", [0.0, 0.1])
@pytest.mark.parametrize(("groups", "size"), [(8, 19), (30, 5)])
@pytest.mark.parametrize("chance", [0.02, 0.5])
def test_differences_over_buildings_are_covered(
    chance: float, groups: int, size: int, correlation: float
) -> None:
    """Ours and theirs are as good, and each has bad buildings of its own."""
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(groups), size)
    covered = 0
    for _ in range(SAMPLES):
        both = [clustered(chance, groups, size, correlation, rng).ravel() for _ in range(2)]
        found = paired_share(*both, group=group)
        covered += found.low <= 0.0 <= found.high
    print(f"{chance:g}, {groups} of {size}, {correlation:g}: {covered / SAMPLES:.3f}")
    assert covered / SAMPLES > 0.93


def test_groups_of_one_and_one_group_are_independent_runs() -> None:
    values = np.arange(40) < 10
    plain = share(values)
    assert share(values, group=np.arange(40)) == plain == share(values, group=np.zeros(40))
    assert bootstrap(values, np.random.default_rng(0)) == plain


def test_alike_runs_say_no_more_than_their_groups() -> None:
    """Of 12 buildings 6 are bad, and all runs in each are the same."""
    group = np.repeat(np.arange(12), 50)
    found = evidence_of((group % 2).astype(float), group, 0.95)
    assert found.runs == pytest.approx(11.0, rel=1e-6)
    assert found.quantile == pytest.approx(2.201, abs=1e-3)


def test_where_nothing_happened_buildings_count() -> None:
    group = np.repeat(np.arange(8), 20)
    nothing = share(np.zeros(160, dtype=bool), group=group)
    assert nothing.low == 0.0 and nothing.high > 2 * share(np.zeros(160, dtype=bool)).high


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(InputError, match="pairs need the same seeds"):
        paired_share([True], [True, False])
    with pytest.raises(InputError, match="level is 0"):
        paired_share([True], [True], 0.0)
    assert math.isnan(paired_share([], []).value)
