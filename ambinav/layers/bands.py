"""Bands of rows of a map's lattice, for layers that compare poses with their neighbours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ambinav.layers.context import WHOLE, LayerContext

# Bytes of beam returns that are held at a time.
BAND_BYTES = 256_000_000


@dataclass(frozen=True)
class Band:
    """Indices of the free poses of some rows, and of the poses within reach of them.

    Attributes:
        begin: First pose of the rows.
        end: One past the last.
        first: First pose of all that are within reach.
        last: One past the last.
        part: These as a slice.
    """

    begin: int
    end: int
    first: int
    last: int
    part: slice


def bands(context: LayerContext, reach: int, scans: int = 1) -> Iterator[Band]:
    """Yield bands such that the returns of one and its neighbours take about `BAND_BYTES`.

    It is exceeded only where a single row and its neighbours are more.

    Args:
        context: The map's lattice and beams.
        reach: How many rows a neighbour may be off.
        scans: How many scans are held of each pose.
    """
    poses = len(context.points[0])
    most = BAND_BYTES // (scans * 5 * 4 * len(context.table.limit))
    if poses <= most:
        yield Band(0, poses, 0, poses, WHOLE)
        return
    before = np.concatenate([[0], np.cumsum(context.free.sum(axis=1))])
    rows, row = len(before) - 1, 0
    while row < rows:
        first, until = int(before[max(row - reach, 0)]), row + 1
        while until < rows and before[min(until + 1 + reach, rows)] - first <= most:
            until += 1
        last = int(before[min(until + reach, rows)])
        if before[until] > before[row]:
            yield Band(int(before[row]), int(before[until]), first, last, slice(first, last))
        row = until
