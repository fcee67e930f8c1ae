"""Random numbers of the kernels: the generator's own reference, moments, distribution, rows."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from scipy import stats

from ambinav.localization.random import (
    normal_columns,
    normals,
    states,
    states_of_each,
    uniform,
    ziggurat,
    ziggurats,
)

COUNT = 200_000


@njit
def uniforms_of(state, out):
    for i in range(out.size):
        out[i] = uniform(state)


@njit
def normals_of(state, out):
    for i in range(out.shape[0]):
        out[i, 0], out[i, 1] = normals(state)


@njit
def ziggurats_of(state, out):
    for i in range(out.size):
        out[i] = ziggurat(state)


@njit
def ziggurats_at_once(state, out):
    ziggurats(state, out)


def xoshiro(words: list[int], count: int) -> list[int]:
    """xoshiro256++ 1.0 as Blackman and Vigna publish it, in Python's integers."""
    full = (1 << 64) - 1

    def rotated(x: int, k: int) -> int:
        return ((x << k) | (x >> (64 - k))) & full

    s, out = list(words), []
    for _ in range(count):
        out.append((rotated((s[0] + s[3]) & full, 23) + s[0]) & full)
        t = (s[1] << 17) & full
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotated(s[3], 45)
    return out


def test_generator_is_xoshiro() -> None:
    state = states(np.random.default_rng(1), 3)[2]
    words = xoshiro([int(w) for w in state], 1000)
    drawn = np.empty(1000)
    uniforms_of(state, drawn)
    assert drawn.tolist() == [(word >> 11) / 2**53 for word in words]


def test_uniforms_are_uniform() -> None:
    drawn = np.empty(COUNT)
    uniforms_of(states(np.random.default_rng(2), 1)[0], drawn)
    assert drawn.min() >= 0.0 and drawn.max() < 1.0
    assert stats.kstest(drawn, "uniform").pvalue > 0.001


def test_normals_are_normal_and_independent() -> None:
    drawn = np.empty((COUNT, 2))
    normals_of(states(np.random.default_rng(3), 1)[0], drawn)
    for column in drawn.T:
        assert stats.kstest(column, "norm").pvalue > 0.001
        moments = [np.mean(column**k) for k in (1, 2, 3, 4)]
        assert np.allclose(moments, (0, 1, 0, 3), atol=0.06)
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 0.01
    assert abs(np.corrcoef((drawn**2).T)[0, 1]) < 0.01


@pytest.mark.slow
def test_the_ziggurat_is_normal_tails_included() -> None:
    drawn = np.empty(10 * COUNT)
    ziggurats_of(states(np.random.default_rng(5), 1)[0], drawn)
    assert stats.kstest(drawn, "norm").pvalue > 0.01
    # Beyond 3.654 the tail has a method of its own; 258 of a million lie there.
    far = np.abs(drawn) > 3.6541528853610088
    assert abs(far.sum() - drawn.size * 2 * stats.norm.sf(3.6541528853610088)) < 3.5 * 22.7
    beyond = np.abs(drawn[far])
    share = stats.norm.sf(beyond) / stats.norm.sf(3.6541528853610088)
    assert stats.kstest(share, "uniform").pvalue > 0.01
    assert (beyond.max() > 4.5) and abs((drawn > 0.0).mean() - 0.5) < 0.0013
    # One draw says nothing of the next.
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 0.0025


def test_rows_are_independent_and_do_not_depend_on_their_number() -> None:
    few, many = states(np.random.default_rng(4), 2), states(np.random.default_rng(4), 50)
    assert (few == many[:2]).all()
    drawn = np.empty((50, 4000))
    for row, state in zip(drawn, many, strict=True):
        uniforms_of(state, row)
    between = np.corrcoef(drawn)[np.triu_indices(50, 1)]
    assert np.abs(between).max() < 5.0 / np.sqrt(4000)


@pytest.mark.slow
def test_normals_at_once_are_those_one_by_one() -> None:
    state = states(np.random.default_rng(5), 2)
    state[1] = state[0]
    one_by_one, at_once = np.empty(20_000), np.empty(20_000)
    ziggurats_of(state[0], one_by_one)
    ziggurats_at_once(state[1], at_once)
    # So many that all rare branches are taken.
    assert np.abs(at_once).max() > 3.66
    np.testing.assert_array_equal(at_once, one_by_one)
    np.testing.assert_array_equal(state[0], state[1])


def test_states_of_each_are_those_of_its_generator_alone() -> None:
    def rngs() -> list[np.random.Generator]:
        return [np.random.default_rng(seed) for seed in range(40)]

    drawn = states_of_each(rngs(), 6)
    assert drawn.shape == (40, 6, 4)
    assert (drawn[:, :, 0] & np.uint64(1)).all()
    for row, rng in zip(drawn, rngs(), strict=True):
        np.testing.assert_array_equal(row, states_of_each([rng], 6)[0])
    # Every bit but the one that is set comes half of the time.
    bits = np.unpackbits(np.ascontiguousarray(drawn).view(np.uint8), bitorder="little")
    share = bits.reshape(-1, 256).mean(axis=0)
    assert share[0] == 1.0
    assert np.abs(share[1:] - 0.5).max() < 5.0 * 0.5 / np.sqrt(240.0)


def test_columns_are_what_single_calls_draw() -> None:
    """Two calls for each column; the state goes on from there."""
    state = states(np.random.default_rng(9), 1)[0]
    same, columns, pairs = state.copy(), np.empty((4, 300)), np.empty((600, 2))
    normal_columns(state, columns)
    normals_of(same, pairs)
    np.testing.assert_allclose(columns.T, pairs.reshape(300, 4), rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(state, same)
