"""Random numbers in kernels: one generator per run, so that runs are independent.

The generator is xoshiro256++ (Blackman & Vigna 2021, "Scrambled linear pseudorandom number
generators", ACM TOMS 47(4)). Its state is four words, a row of a table with one row for each run:
what a run draws depends neither on the number of runs nor on the threads that they share.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ambinav.localization.sine_cosine import sine_cosine
from ambinav.runtime.array_types import Floats, UInts
from ambinav.runtime.kernels import kernel

_SEVENTEEN, _NINETEEN, _TWENTY_THREE = np.uint64(17), np.uint64(19), np.uint64(23)
_FORTY_ONE, _FORTY_FIVE, _ELEVEN = np.uint64(41), np.uint64(45), np.uint64(11)
_UNIT = 1.0 / (1 << 53)

# Of the ziggurat: how many layers, where its tail begins, and the area of each layer, under
# exp(-x^2 / 2).
_LAYERS, _TAIL, _AREA = 256, 3.6541528853610088, 0.00492867323397466
_LAYER, _EIGHT, _ONE = np.uint64(_LAYERS - 1), np.uint64(8), np.uint64(1)


def _ziggurat() -> tuple[Floats, Floats]:
    """Return the layers' right ends, bottom up, and the curve's height there; (L + 1,) each."""
    x = np.empty(_LAYERS + 1)
    x[0], x[1], x[_LAYERS] = _AREA * math.exp(0.5 * _TAIL * _TAIL), _TAIL, 0.0
    for i in range(2, _LAYERS):
        x[i] = math.sqrt(-2.0 * math.log(_AREA / x[i - 1] + math.exp(-0.5 * x[i - 1] ** 2)))
    return x, np.exp(-0.5 * x * x)


_RIGHT, _HEIGHT = _ziggurat()


def states(rng: np.random.Generator, runs: int) -> UInts:
    """Return the first states of `runs` generators, uint64, shape (runs, 4).

    The first rows are the same whatever `runs` is.
    """
    drawn = rng.integers(0, 2**64, size=(runs, 4), dtype=np.uint64)
    # All zeros is the one state that the generator never leaves.
    drawn[:, 0] |= np.uint64(1)
    return drawn


def states_of_each(rngs: Iterable[np.random.Generator], runs: int) -> UInts:
    """Return states from each of N generators, shape (N, runs, 4), not those of `states`.

    A fifth of the time where `runs` is small.
    """
    # 32 bits of each number: `Generator.integers` takes six times as long as `random`.
    shares = np.array([rng.random(8 * runs) for rng in rngs])
    drawn = (shares * 2.0**32).astype(np.uint32).view(np.uint64).reshape(-1, runs, 4)
    drawn[:, :, 0] |= np.uint64(1)
    return drawn


@kernel(inline="always")
def word(state):
    """Draw 64 random bits; `state` is one row, advanced in place."""
    drawn, state[0], state[1], state[2], state[3] = _next(state[0], state[1], state[2], state[3])
    return drawn


@kernel(inline="always")
def _next(s0, s1, s2, s3):
    """Return 64 random bits of a state, and the next state."""
    mixed = s0 + s3
    drawn = ((mixed << _TWENTY_THREE) | (mixed >> _FORTY_ONE)) + s0
    kept = s1 << _SEVENTEEN
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= kept
    return drawn, s0, s1, s2, (s3 << _FORTY_FIVE) | (s3 >> _NINETEEN)


@kernel(inline="always")
def uniform(state):
    """Draw from [0, 1), a multiple of 2^-53; `state` is one row, advanced in place."""
    return float(word(state) >> _ELEVEN) * _UNIT


@kernel
def normals(state):
    """Draw two independent standard normal numbers (Box & Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    angle = 2.0 * math.pi * uniform(state)
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel(_nrt=False)
def normal_columns(state, out):
    """Draw standard normal numbers, shape (2 K, n), as K calls of `normals` for each column would.

    In a third of the time: many at a time, and with the state in registers.
    """
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    for i in range(out.shape[1]):
        for k in range(out.shape[0]):
            drawn, s0, s1, s2, s3 = _next(s0, s1, s2, s3)
            out[k, i] = float(drawn >> _ELEVEN) * _UNIT
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3
    for k in range(0, out.shape[0], 2):
        for i in range(out.shape[1]):
            out[k, i] = math.sqrt(-2.0 * math.log(1.0 - out[k, i]))
        for i in range(out.shape[1]):
            s, c = sine_cosine(2.0 * math.pi * out[k + 1, i])
            out[k + 1, i] = out[k, i] * s
            out[k, i] *= c


@kernel(forceinline=True)
def ziggurat(state):
    """Draw one standard normal number, at a tenth of the cost of `normal`.

    The ziggurat of Marsaglia & Tsang 2000, J. Stat. Software 5(8), with layer, sign and place
    from bits of their own, as Doornik 2005, "An improved ziggurat method to generate normal random
    samples", asks for. How many words are drawn depends on what comes.
    """
    layer, sign, x = _decode(word(state))
    return sign * x if x < _RIGHT[layer + 1] else _accepted(layer, sign, x, state)


@kernel(forceinline=True)
def ziggurats(state, out):
    """Draw a standard normal number for each entry of `out`, as repeated `ziggurat` calls would.

    The state stays in registers meanwhile, whatever else `out` may share memory with.
    """
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    for i in range(out.size):
        drawn, s0, s1, s2, s3 = _next(s0, s1, s2, s3)
        layer, sign, x = _decode(drawn)
        if x < _RIGHT[layer + 1]:
            out[i] = sign * x
        else:
            state[0], state[1], state[2], state[3] = s0, s1, s2, s3
            out[i] = _accepted(layer, sign, x, state)
            s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3


@kernel(inline="always")
def _decode(drawn):
    """Decode layer, sign and position from 64 bits."""
    layer = np.int64(drawn & _LAYER)
    return (
        layer,
        1.0 - 2.0 * float(drawn >> _EIGHT & _ONE),
        float(drawn >> _ELEVEN) * _UNIT * _RIGHT[layer],
    )


@kernel
def _accepted(layer, sign, x, state):
    """Return a sample for a position that may be above the curve, as happens once in 80 draws."""
    while True:
        if x < _RIGHT[layer + 1]:
            return sign * x
        if layer == 0:
            while True:
                x = -math.log(1.0 - uniform(state)) / _TAIL
                if -2.0 * math.log(1.0 - uniform(state)) >= x * x:
                    return sign * (_TAIL + x)
        low, high = _HEIGHT[layer], _HEIGHT[layer + 1]
        if low + uniform(state) * (high - low) < math.exp(-0.5 * x * x):
            return sign * x
        layer, sign, x = _decode(word(state))
