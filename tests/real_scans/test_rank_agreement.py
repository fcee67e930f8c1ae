"""Rank correlations, ranks at equal something else, and blocks of floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from real_scans.rank_agreement import floor_squares, rank_agreement, rank_at_equal, spearman
from scipy.stats import spearmanr

NUMBERS = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=40)


@pytest.mark.slow
@given(NUMBERS)
def test_spearman_is_scipys(values):
    a, b = np.array(values, dtype=float).T
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        assert np.isnan(spearman(a, b))
    else:
        assert spearman(a, b) == pytest.approx(spearmanr(a, b).statistic, abs=1e-12)


@pytest.mark.slow
def test_alike_neighbours_widen_the_interval():
    rng = np.random.default_rng(1)
    place = np.repeat(rng.normal(size=30), 20)
    seen = 0.7 * place + np.repeat(rng.normal(size=30), 20)
    each = rank_agreement(place, seen, np.arange(600), rng, draws=300)
    blocks = rank_agreement(place, seen, np.repeat(np.arange(30), 20), rng, draws=300)
    assert each.value == blocks.value
    assert blocks.high - blocks.low > 2.5 * (each.high - each.low)
    assert blocks.low < blocks.value < blocks.high
    assert (blocks.count, blocks.blocks) == (600, 30)


def test_what_is_not_known_is_left_out():
    rng = np.random.default_rng(1)
    a, b = np.array([1.0, 2.0, np.nan, 3.0]), np.array([1.0, 2.0, 9.0, 3.0])
    found = rank_agreement(a, b, np.arange(4), rng, draws=50)
    assert (found.value, found.count) == (1.0, 3)
    none = rank_agreement(a[:0], b[:0], np.arange(0), rng, draws=50)
    assert np.isnan(none.value) and none.count == 0
    assert str(found).startswith("1.00 (")


def test_at_equal_distance_the_distance_is_gone():
    rng = np.random.default_rng(2)
    distance, view = rng.uniform(0.1, 1.5, 4000), rng.uniform(0.5, 1.0, 4000)
    own = rng.normal(size=4000)
    first = -9.0 * distance**2 + view + own
    second = -5.0 * distance - view + rng.normal(size=4000)
    assert spearman(first, second) > 0.7
    left = [rank_at_equal(values, distance, view) for values in (first, second)]
    assert abs(spearman(*left)) < 0.1
    assert spearman(left[0], own) > 0.6
    assert 0.0 < left[0].min() < left[0].max() < 1.0


def test_squares_of_floor():
    found = floor_squares(np.array([0.1, 4.9, 5.1, -0.1]), np.array([0.1, 4.9, 0.1, 0.1]), 5.0)
    assert found[0] == found[1]
    assert len(set(found.tolist())) == 3
