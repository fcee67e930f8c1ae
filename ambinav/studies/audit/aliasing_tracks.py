"""Tracking of aliased poses from pose to pose: it finds those missed by a coarse search."""

from __future__ import annotations

import numpy as np

from ambinav.layers.aliasing.settle import settle_at
from ambinav.layers.context import LayerContext
from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav.studies.audit.aliasing_groups import STEPS, neighbours, same, stepped

LEAST_LIKENESS = 0.3
"""Least likeness of two aliased poses."""
CHUNK = 1 << 16
"""Poses compared at a time, which bounds the memory."""


def follow(context: LayerContext, aliased: Floats) -> Floats:
    """Scan at the aliased poses that the neighbours of each pose predict, and add the matches.

    Args:
        context: Context with the poses.
        aliased: What `settle` returns, shape (P, K, count, 4).

    Returns:
        The same without what is less alike than `LEAST_LIKENESS`, and with up to `count`
        aliased poses of each pose, in no order.
    """
    full = np.where(aliased[..., 3:] >= LEAST_LIKENESS, aliased, np.nan)
    # Where the scanner looks all around, one heading stands for all.
    for k in range(1 if context.turns_in_place else aliased.shape[1]):
        _complete_heading(context, k, full[:, k])
    if context.turns_in_place:
        full[:] = full[:, :1]
    return full


def _complete_heading(context: LayerContext, heading: int, entries: Floats) -> None:
    """Complete the aliased poses of all poses at one heading, shape (P, count, 4), in place."""
    spacing = context.spacing
    cell, rank = np.nonzero(np.isfinite(entries[..., 3]))
    to, alike = _predict(context, cell, entries[cell, rank])
    while to.size:
        missing = _missing(spacing, entries, to, alike)
        to, alike = to[missing], alike[missing]
        # One for each pose at a time, since the next may predict the same one.
        _, now = np.unique(to, return_index=True)
        settled = settle_at(context, heading, to[now], alike[now])
        good = (settled[:, 3] >= LEAST_LIKENESS) & same(spacing, settled, alike[now])
        cell, settled = to[now][good], settled[good]
        entries[cell, np.isnan(entries[cell, :, 3]).argmax(axis=1)] = settled
        predicted = _predict(context, cell, settled)
        to = np.concatenate([np.delete(to, now), predicted[0]])
        alike = np.concatenate([np.delete(alike, now, axis=0), predicted[1]])


def _missing(spacing: float, entries: Floats, to: Indices, alike: Floats) -> Bools:
    """Return which poses lack the predicted aliased pose and have room for one more."""
    missing = np.empty(len(to), dtype=np.bool_)
    for first in range(0, len(to), CHUNK):
        rows = slice(first, first + CHUNK)
        present = entries[to[rows]]
        missing[rows] = ~same(spacing, present, alike[rows, np.newaxis]).any(axis=1)
        missing[rows] &= np.isnan(present[..., 3]).any(axis=1)
    return missing


def _predict(context: LayerContext, cell: Indices, alike: Floats) -> tuple[Indices, Floats]:
    """Return the neighbours of cells and their predicted aliased poses, shape (M, 3)."""
    to = np.stack([neighbours(context, cell, step) for step in STEPS], axis=1)
    predicted = np.stack([stepped(context.spacing, alike, step) for step in STEPS], axis=1)
    return to[to >= 0], predicted[to >= 0]
