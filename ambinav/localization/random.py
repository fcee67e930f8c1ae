"""Random numbers inside kernels: one generator a run, so that a run's draws are its own.

The generator is xoshiro256++ (Blackman & Vigna 2021, "Scrambled linear pseudorandom number
generators", ACM TOMS 47(4)). Its state is four words, a row of a table with one row for each run:
what a run draws depends neither on the number of runs nor on the threads that they share.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_SEVENTEEN, _NINETEEN, _TWENTY_THREE = np.uint64(17), np.uint64(19), np.uint64(23)
_FORTY_ONE, _FORTY_FIVE, _ELEVEN = np.uint64(41), np.uint64(45), np.uint64(11)
_UNIT = 1.0 / (1 << 53)


def states(rng: np.random.Generator, runs: int) -> NDArray[np.uint64]:
    """Return the first states of `runs` generators, uint64, shape (runs, 4).

    The first rows are the same whatever `runs` is.
    """
    drawn = rng.integers(0, 2**64, size=(runs, 4), dtype=np.uint64)
    # All zeros is the one state that the generator never leaves.
    drawn[:, 0] |= np.uint64(1)
    return drawn


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def uniform(state):
    """Draw from [0, 1), a multiple of 2^-53; `state` is one row, advanced in place."""
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    mixed = s0 + s3
    word = ((mixed << _TWENTY_THREE) | (mixed >> _FORTY_ONE)) + s0
    kept = s1 << _SEVENTEEN
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= kept
    state[0], state[1], state[2] = s0, s1, s2
    state[3] = (s3 << _FORTY_FIVE) | (s3 >> _NINETEEN)
    return float(word >> _ELEVEN) * _UNIT


@njit(cache=True, nogil=True, error_model="numpy")
def normals(state):
    """Draw two independent standard normal numbers (Box & Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    angle = 2.0 * math.pi * uniform(state)
    return radius * math.cos(angle), radius * math.sin(angle)


@njit(cache=True, nogil=True, error_model="numpy")
def normal(state):
    """Draw one standard normal number; two are cheaper from `normals`."""
    return normals(state)[0]
