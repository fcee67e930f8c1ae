"""Thinning of the beams of a scanner that has several parts."""

from __future__ import annotations

from collections.abc import Sequence

from ambinav.sensing.layout import Part


def thinned_parts(parts: Sequence[Part], most: int) -> tuple[Part, ...]:
    """Return the parts with at most `most` beams in total, at least one each.

    Each gets an equal share, and what a small one leaves over goes to the others.

    Args:
        parts: P of them.
        most: How many beams, P at least.
    """
    thinned, left = list(parts), most
    sizes = [len(part.layout.mounts()) for part in parts]
    for done, i in enumerate(sorted(range(len(parts)), key=sizes.__getitem__)):
        layout = thinned[i].layout.thinned(left // (len(parts) - done))
        thinned[i] = Part(thinned[i].sensor, layout)
        left -= len(layout.mounts())
    return tuple(thinned)
