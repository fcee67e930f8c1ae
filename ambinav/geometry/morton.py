"""Order lattice points so that neighbours are mostly near each other."""

from __future__ import annotations

import numpy as np

from ambinav.runtime.array_types import Ints32, UInts


def morton(rows_columns: Ints32) -> UInts:
    """Compute positions of lattice points on a Morton curve, where neighbours are mostly close.

    Args:
        rows_columns: Shape (N, 2), at least 0.

    Returns:
        uint64, shape (N,): the bits of row and column by turns (Morton 1966).
    """
    row, column = (_spread_bits(axis) for axis in rows_columns.T)
    return (row << np.uint64(1)) | column


def _spread_bits(values: Ints32) -> UInts:
    """Move bit k of each value to position 2 k."""
    spread = values.astype(np.uint64)
    for shift, mask in (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ):
        spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
    return spread
