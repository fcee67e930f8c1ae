"""Agreement of the scans of each pair, by the model's own comparison, one pair at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.gaussian import FAST
from ambinav.ambiguity.pair import compare
from ambinav.ambiguity.tensor import relative_radii
from ambinav.runtime.array_types import Floats
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from real_scans.scan_pairs import ScanPairs


@dataclass(frozen=True, eq=False)
class Agreement:
    """Result of comparing N pairs; `own` compares each of U scans with itself.

    Attributes:
        alike: Indistinguishability I of the pair, shape (N,).
        offset: Best offset of the second pose, shape (N, 2), metres, map frame.
        spread: Covariance (xx, xy, yy) of the offset, shape (N, 3), square metres.
        own: Shape (U, 6): the same six figures of each scan that is first in a pair with itself.
        cell_variance: Variance of the offset beforehand in x and y, square metres.
    """

    alike: Floats
    offset: Floats
    spread: Floats
    own: Floats
    cell_variance: float


def compare_pairs(
    own: NDArray[np.float32],
    other: NDArray[np.float32],
    row: NDArray[np.intp],
    beams: BeamTable,
    evidence: NDArray[np.float32] | None,
    tau: float,
    cell_variance: tuple[float, float],
) -> Agreement:
    """Compare scans with their partners as `ambinav.ambiguity.kernel` compares lattice poses.

    Args:
        own: The first scans, float32, shape (U, 5, P), as `Returns.data`.
        other: The partners, each in its first scan's directions, float32, shape (N, 5, P).
        row: Which of `own` each is the partner of, shape (N,).
        beams: Limits and caps.
        evidence: Table of evidence, or None where all bins are fine.
        tau: Beams per independent piece of evidence.
        cell_variance: Variance of the offset in x and y, square metres, and in theta, square
            radians: how well the partner's pose is known.
    """
    pool = np.concatenate([own, other])
    first = np.concatenate([np.arange(len(own)), row]).astype(np.uint64)
    out = np.empty((len(pool), 6))
    run_rows(
        _compare, len(pool), pool, first, beams.limit, beams.inverse_cap, beams.use, evidence, tau,
        *cell_variance, out, least=256,
    )  # fmt: skip
    mine, pairs = out[: len(own)], out[len(own) :]
    return Agreement(pairs[:, 0], pairs[:, 1:3], pairs[:, 3:], mine, cell_variance[0])


def pose_figures(pairs: ScanPairs, agreement: Agreement) -> dict[str, Floats]:
    """Return the model's figures of each scan; its neighbours are the partners and itself.

    Returns:
        `ambiguity` (mean of I over the partners, the scan itself left out), and `major_radius`,
        `minor_radius`, `direction`, `major`, `minor`, `level` as `relative_radii` says, each of
        shape (U,), in the order of the scans that are first in a pair.
    """
    _, row = np.unique(pairs.first, return_inverse=True)
    size = len(agreement.own)

    def total(values: Floats) -> Floats:
        return np.bincount(row, values, minlength=size).astype(np.float64)

    count = total(np.ones(len(row)))
    c0 = agreement.cell_variance
    x, y = pairs.apart.T
    to_x, to_y = (pairs.apart + agreement.offset).T
    alike, (xx, xy, yy) = agreement.alike, agreement.spread.T
    self_alike, ox, oy, sxx, sxy, syy = agreement.own.T
    weight = total(alike) + self_alike
    sums = np.column_stack(
        [
            total(alike) / count,
            (total(alike * (to_x * to_x + xx)) + self_alike * (ox * ox + sxx)) / weight,
            (total(alike * (to_x * to_y + xy)) + self_alike * (ox * oy + sxy)) / weight,
            (total(alike * (to_y * to_y + yy)) + self_alike * (oy * oy + syy)) / weight,
            total(x * x) / (count + 1.0) + c0,
            total(x * y) / (count + 1.0),
            total(y * y) / (count + 1.0) + c0,
        ]
    )
    return relative_radii(sums)


@kernel(fastmath=FAST)
def _compare(low, high, data, first, limit, icap, use, evidence, tau, c0, c2, out):
    for k in range(low, high):
        alike, ox, oy, _, sxx, sxy, syy, _ = compare(
            data, first[k], k, limit, icap, use, evidence, tau, c0, c2
        )
        out[k, 0], out[k, 1], out[k, 2] = alike, ox, oy
        out[k, 3], out[k, 4], out[k, 5] = sxx, sxy, syy
