"""The bounds that the search leaves pairs out by, against Phi worked out from its definition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ambinav.ambiguity.indistinguishability import evidence, evidence_table
from ambinav.ambiguity.returns import BLIND
from ambinav.layers.aliasing.kernel import orbit_rows, possible
from ambinav.layers.aliasing.scans import Scans
from ambinav.layers.aliasing.sieve import SignatureArrays, TreeArrays, sift
from ambinav.layers.aliasing.signature import Signatures
from ambinav.layers.aliasing.tree import Tree

LIMIT = np.array([4.0, 6.0])
CAP = np.array([2.8, 2.1])
TAU = 2.0
CELL = (0.2**2 / 4, 0.1**2)
# Bins of the second sensor: coarse ones tell less than fine ones of the same variance.
WIDTH = np.array([0.1, 2.5])


def scans(data: np.ndarray, turns: int) -> Scans:
    """Orbits of `turns` beams, each of one sensor or the other in turn."""
    n, _, beams = data.shape
    sensor = np.arange(beams) // turns % 2
    table = evidence_table(WIDTH)[sensor]
    return Scans(
        data=data.astype(np.float32),
        limit=LIMIT[sensor].astype(np.float32),
        inverse_cap=(1 / CAP[sensor]).astype(np.float32),
        use=np.ones(beams, dtype=np.float32),
        evidence=table,
        softness=table.min(axis=1),
        variance=2.0 * np.where(data[:, 4] < BLIND / 2, data[:, 4], 0).max(axis=0) + 1e-4,
        turns=turns,
        x=np.zeros(n),
        y=np.zeros(n),
        heading=np.zeros(n),
        cell=np.arange(n, dtype=np.int32),
        possible=np.ones(n, dtype=np.bool_),
        known=data[:, 4] < BLIND / 2,
        cell_variance=CELL,
        tau=TAU,
        spacing=0.2,
        ranges=beams,
    )


def phi(p: np.ndarray, q: np.ndarray, offset: np.ndarray, sensor: np.ndarray) -> float:
    """Phi of a pair and an offset, by the definition, q turned already."""
    limit, cap = LIMIT[sensor], CAP[sensor]
    moved = np.minimum(q[0] + offset @ q[1:4], limit)
    z = (np.minimum(p[0], limit) - moved) / np.sqrt(p[4] + q[4])
    per_beam = np.array([float(evidence(a, b)) for a, b in zip(z, WIDTH[sensor], strict=True)])
    prior = offset[:2] @ offset[:2] / CELL[0] + offset[2] ** 2 / CELL[1]
    return float(np.sum(per_beam / np.sqrt(1 + (per_beam / cap) ** 2)) / TAU + prior / 2)


def sifted(both: Scans, sig: Signatures, bundle: list[int]) -> int:
    """How many blocks a bundle leaves of a tree that holds pose 1 alone."""
    tree = Tree.over(sig, np.array([1]), both.turns)
    return sift(
        np.array(bundle, dtype=np.int32), both.known, SignatureArrays.of(sig, 1),
        TreeArrays.of(tree), np.empty(len(tree.pose), dtype=np.int32),
    )  # fmt: skip


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.sampled_from([(1, 12), (2, 12), (1, 1), (20, 1)]),
    threshold=st.sampled_from([1.0, 4.6, 9.0]),
    odd=st.integers(0, 6),
    pull=st.floats(0.0, 1.0),
)
def test_no_pair_that_is_alike_is_left_out(seed, shape, threshold, odd, pull):
    rng = np.random.default_rng(seed)
    orbits, turns = shape
    beams = orbits * turns
    sensor = np.arange(beams) // turns % 2
    q = np.empty((5, beams))
    q[0] = rng.uniform(0.1, 7.0, beams)
    q[1:3] = rng.normal(0.0, 1.5, (2, beams))
    q[3] = rng.normal(0.0, 2.0, beams)
    # Half the variance of a sensor varies from beam to beam, with the range for example.
    q[4] = rng.uniform(0.0005, 0.01, beams)
    offset = rng.normal(size=3)
    offset *= pull * math.sqrt(2 * threshold) / np.linalg.norm(offset)
    offset *= np.sqrt([CELL[0], CELL[0], CELL[1]])
    p = np.zeros((5, beams))
    p[4] = rng.uniform(0.0005, 0.01, beams)
    p[0] = q[0] + offset @ q[1:4] + rng.normal(0.0, 0.05, beams)
    there = rng.integers(0, beams, odd)
    p[0, there] = rng.uniform(0.1, 7.0, odd)
    p[0] = np.maximum(p[0], 0.0)
    q[4, rng.random(beams) < 0.1] = BLIND
    p[4, rng.random(beams) < 0.1] = BLIND
    exact = phi(p, q, offset, sensor)
    assume(exact <= threshold)
    # q stands turned: its orbits are shifted back, and the turn that fits is k.
    k = int(rng.integers(turns))
    stored = np.roll(q.reshape(5, orbits, turns), k, axis=2).reshape(5, beams)
    both = scans(np.stack([p, stored]), turns)
    sig = Signatures.of(both, threshold)

    assert (sig.above[0] <= sig.high_above[1] + sig.odd).all()
    assert (sig.above[0] >= sig.low_above[1] - sig.odd - sig.blind[0]).all()
    low, high = (
        np.roll(v[1].reshape(orbits, turns), -k, axis=1).ravel() for v in (sig.low, sig.high)
    )
    outside = ((sig.code[0] < low) | (sig.code[0] > high)) & both.known[0]
    assert outside.sum() <= sig.odd
    rows, beams_of = orbit_rows(both)
    assert possible(rows, 0, 1, k, *beams_of, TAU, threshold)
    # Nor in a bundle with quite another pose that is left out by itself.
    other = p.copy()
    other[0] = rng.uniform(0.1, 7.0, beams)
    three = scans(np.stack([p, stored, other]), turns)
    sig = Signatures.of(three, threshold)
    assert sifted(three, sig, [0]) == sifted(three, sig, [0, 2]) == sifted(three, sig, [2, 0]) == 1


@pytest.mark.parametrize("turns", [1, 12])
def test_pairs_that_are_quite_unlike_are_left_out(turns):
    """The bounds are no empty promise: near and far walls all round pass none of them."""
    data = np.zeros((2, 5, 12))
    data[0, 0], data[1, 0] = 1.0, 3.0
    data[:, 4] = 0.002
    both = scans(data, turns)
    sig = Signatures.of(both, 4.6)
    assert (sig.above[0] + sig.odd + sig.blind[0] < sig.low_above[1]).any()
    assert sifted(both, sig, [0]) == sifted(both, sig, [0, 0]) == 0
    rows, beams_of = orbit_rows(both)
    assert not possible(rows, 0, 1, 0, *beams_of, TAU, 4.6)
