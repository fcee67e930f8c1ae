"""Signature of a scan, which rules out pairs of poses before their beams are compared.

Let p and q be poses, k a turn of q, and o the offset within q's cell that `compare` finds. The pair
counts as alike if

    Phi = sum_b c(U_b) / tau + |o|^2 / 2 <= T,       |o|^2 = o^T C^-1 o,

with the capped evidence c(U_b) of beam b between the range d_b of p and the range
y_b = min(e_b + g_b o, limit) of q (docs/model.md; e_b, g_b: range and gradient of q's beam).

**Reach.** Both parts of Phi are at least 0, so |o| <= r = sqrt(2 T); by Cauchy and Schwarz
|g_b o| <= |o| sd_b with sd_b = sqrt(g_b^T C g_b). So y_b lies between min(e_b -+ r sd_b, limit).

**Gap.** More sharply: if a <= |o| <= r, then y_b lies in that interval for this r, d_b differs from
y_b by at least its distance to the interval, evidence rises with the difference, and

    sum_b c(evidence of the gap of beam b at r) <= tau (T - a^2 / 2).

A pair that fails this for every one of the rings [a, r] that make up [0, sqrt(2 T)] is not alike.

**Count.** Let a margin m_b be so wide that a difference of m_b alone gives c >= `SURE` times the
cap of the beam, whatever its noise. Each beam whose d_b lies outside the interval widened by m_b
then costs at least SURE times the smallest cap, so at most

    odd = floor(tau T / (SURE min_b cap_b))

beams do. Ranges become whole numbers for this: d_b is rounded down, the ends of the interval
outward, so that whole numbers outside of the interval mean ranges outside. A beam that tells
nothing (at either pose) is outside of nothing.

**Signature.** The count forgets the order of the beams, hence the turn. For a level l let
N(l) be the number of telling beams of p with d_b > l, and low(l), high(l) those of q whose
interval begins, ends above l (a beam that tells nothing only ends there). Of the N(l) beams all but
`odd` at the most meet an interval that ends at d_b or above; of the low(l) beams, all but `odd`
and the `blind` ones of p that tell nothing meet a d_b at their interval's beginning or above.
So for every turn

    low(l) - odd - blind <= N(l) <= high(l) + odd.

Turns map beams on beams of the same sensor, so each may have its own unit of length.

**Bundle.** Poses close to each other see nearly the same, and are asked for together first: let
each beam, and each N(l), run from the least to the largest of them, let a beam tell something only
if it does at all of them, and let `blind` be their largest. A beam all of whose values lie outside
lies outside for each of them, so both bounds above hold for the bundle where they hold for one of
its poses: what it leaves out, each of them would. The rest each looks through by itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.layers.aliasing.scans import Scans
from ambinav.runtime.array_types import Bools, Bytes, Floats32

SURE = 0.95
"""Share of its cap from which a beam is odd: the margin grows fast beyond, the cost does not."""
TOP = 250
"""The whole number that a beam's maximum range becomes."""
LEVELS = 16
# What the float32 sums of the kernel may be off by, in metres; all intervals are widened by it.
SLACK = 1e-3


@dataclass(frozen=True, eq=False)
class Signatures:
    """Integer signatures of N scans with B beams, and how many beams exceed each of S levels.

    Attributes:
        code: Range of each beam, rounded down; uint8, shape (N, B).
        low: Beginning of the beam's interval, rounded down; uint8, shape (N, B).
        high: End of the beam's interval, rounded up; uint8, shape (N, B).
        above: N(l), int16, shape (N, S).
        low_above: low(l), int16, shape (N, S).
        high_above: high(l), int16, shape (N, S).
        blind: Number of beams that tell nothing, int16, shape (N,).
        odd: How many beams of two scans that are alike may differ clearly.
    """

    code: Bytes
    low: Bytes
    high: Bytes
    above: NDArray[np.int16]
    low_above: NDArray[np.int16]
    high_above: NDArray[np.int16]
    blind: NDArray[np.int16]
    odd: int

    @classmethod
    def of(cls, scans: Scans, threshold: float) -> Signatures:
        """Compute the signatures of scans.

        Args:
            scans: The scans.
            threshold: T.
        """
        beams = scans.beams
        limit = scans.limit[:beams].astype(np.float64)
        ranges = np.minimum(scans.data[:, 0, :beams], limit)
        unit = limit / TOP
        cap = 1.0 / scans.inverse_cap[:beams].astype(np.float64)
        # c(U) = U / sqrt(1 + (U / cap)^2) is SURE times the cap at this U.
        least = cap * SURE / math.sqrt(1.0 - SURE * SURE)
        margin = 2.0 * np.sqrt(least * scans.variance / scans.softness[:beams]) + SLACK
        reach = math.sqrt(2.0 * threshold) * slides(scans)[:, :beams]
        centre = scans.data[:, 0, :beams].astype(np.float64)
        low = np.floor((np.minimum(centre - reach, limit) - margin) / unit)
        high = np.ceil((np.minimum(centre + reach, limit) + margin) / unit)
        code = np.floor(ranges / unit).astype(np.uint8)
        low = np.where(scans.known, np.clip(low, 0, 255), 0).astype(np.uint8)
        high = np.where(scans.known, np.clip(high, 0, 255), 255).astype(np.uint8)
        inner = code[scans.known & (code < TOP)]
        levels = np.unique(
            np.quantile(inner, (np.arange(LEVELS) + 0.5) / LEVELS).astype(int)
            if inner.size
            else [0]
        )

        def above(values: Bytes, mask: Bools | bool) -> NDArray[np.int16]:
            counts = [((values > level) & mask).sum(axis=1) for level in levels]
            return np.stack(counts, axis=1).astype(np.int16)

        return cls(
            code=code,
            low=low,
            high=high,
            above=above(code, scans.known),
            low_above=above(low, True),
            high_above=above(high, True),
            blind=(~scans.known).sum(axis=1).astype(np.int16),
            odd=math.floor(scans.tau * threshold / (SURE * float(cap.min())) + 1e-6),
        )


def slides(scans: Scans) -> Floats32:
    """Compute sd_b: how far a standard offset in the cell moves each beam, metres, (N, padded)."""
    at, turn = scans.cell_variance
    x, y, t = scans.data[:, 1], scans.data[:, 2], scans.data[:, 3]
    return np.asarray(np.sqrt(at * (x * x + y * y) + turn * t * t), dtype=np.float32)
