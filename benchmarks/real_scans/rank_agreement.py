"""Rank correlations of predicted with measured values, with intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from ambinav.runtime.array_types import Floats

DRAWS: Final = 1000
# Classes of equal displacement are filled with this many pairs, about.
CLASS_SIZE: Final = 40
# Each further quantity parts a class into so many.
PARTS: Final = 3


@dataclass(frozen=True)
class RankAgreement:
    """A rank correlation (Spearman) with its interval of 95 % by the bootstrap.

    Attributes:
        value: In [-1, 1]; nan where nothing varies or there are fewer than three values.
        low: 2.5th percentile.
        high: 97.5th percentile.
        count: Number of values.
        blocks: Number of blocks that were drawn from.
    """

    value: float
    low: float
    high: float
    count: int
    blocks: int

    def __str__(self) -> str:
        """Format value and interval, as "0.71 (0.62 to 0.80)"."""
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


def spearman(first: Floats, second: Floats) -> float:
    """Return the rank correlation, ties at their mean rank; nan where a side is constant."""
    if len(first) < 3:
        return float("nan")
    a, b = (rankdata(values) - 0.5 * (len(values) + 1) for values in (first, second))
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else float("nan")


def rank_agreement(
    predicted: Floats,
    measured: Floats,
    block: NDArray[np.intp],
    rng: np.random.Generator,
    *,
    draws: int = DRAWS,
) -> RankAgreement:
    """Return the rank correlation, with an interval that respects correlation of neighbours.

    Whole blocks are drawn with replacement (Kuensch 1989), and all values of a block with it.
    Values that are not finite on either side are left out.

    Args:
        predicted: Shape (N,).
        measured: Shape (N,).
        block: Which block each belongs to, shape (N,).
        rng: For the draws.
        draws: Number of draws.
    """
    good = np.isfinite(predicted) & np.isfinite(measured)
    predicted, measured, block = predicted[good], measured[good], block[good]
    labels, block = np.unique(block, return_inverse=True)
    members = [np.flatnonzero(block == k) for k in range(len(labels))]
    drawn = []
    for _ in range(draws if members else 0):
        index = np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])
        drawn.append(spearman(predicted[index], measured[index]))
    finite = np.array(drawn)[np.isfinite(drawn)] if drawn else np.empty(0)
    low, high = np.percentile(finite, [2.5, 97.5]) if finite.size else (np.nan, np.nan)
    return RankAgreement(
        spearman(predicted, measured), float(low), float(high), len(predicted), len(labels)
    )


def rank_at_equal(values: Floats, *quantities: Floats) -> Floats:
    """Return the rank of each value among those alike in another value, from 0 to 1.

    What is left of `values` when what the given quantities say of them is taken away, whatever
    the law.

    Args:
        values: Shape (N,).
        quantities: Each of shape (N,). By the first the values are parted into classes of equal
            size, each of these by the second into three, and so on.
    """
    out = np.empty(len(values))
    classes = [np.arange(len(values))]
    for k, quantity in enumerate(quantities):
        inner = PARTS ** (len(quantities) - 1 - k)
        parts = max(len(values) // (CLASS_SIZE * inner), 1) if k == 0 else PARTS
        classes = [
            part
            for members in classes
            for part in np.array_split(members[np.argsort(quantity[members], kind="stable")], parts)
        ]
    for members in classes:
        if len(members):
            out[members] = (rankdata(values[members]) - 0.5) / len(members)
    return out


def floor_squares(x: Floats, y: Floats, side: float) -> NDArray[np.intp]:
    """Return the index of the floor square of each point, shape (N,)."""
    column, row = np.floor(x / side).astype(np.int64), np.floor(y / side).astype(np.int64)
    _, block = np.unique(np.column_stack([column, row]), axis=0, return_inverse=True)
    return np.asarray(block.ravel(), dtype=np.intp)
