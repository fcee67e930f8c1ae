"""Loss of a map when the scanner keeps only a subset of its beams."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ambinav.maps.zones import ZONES
from ambinav.reports.fields import rounded
from ambinav.runtime.array_types import Bytes, Floats

POINTS = 100.0
"""Percentage points: shares of the floor, and `level`, which runs from 0 to 1 too."""

Points = Annotated[float, rounded(3)]


@dataclass(frozen=True)
class Loss:
    """Difference of a map from that of the full scanner, on the same poses.

    Attributes:
        zones: Largest change of a zone's share of the floor, percentage points. Poses that change
            into a zone cancel poses that change out of it.
        level: Mean absolute difference of `level`, in points too (100 times it): nothing cancels.
    """

    zones: float
    level: float

    @property
    def points(self) -> float:
        """The larger of the two losses, to which a stated limit applies."""
        return max(self.zones, self.level)

    @classmethod
    def between(
        cls, level: Floats, zone: Bytes, full_level: Floats, full_zone: Bytes, weight: Floats
    ) -> Loss:
        """Compute the loss on M poses, each array of shape (M,); `weight` sums to 1."""
        shares = [
            np.bincount(codes, weights=weight, minlength=len(ZONES)) for codes in (zone, full_zone)
        ]
        return cls(
            POINTS * float(np.abs(shares[0] - shares[1]).max()),
            POINTS * float(weight @ np.abs(level - full_level)),
        )

    @classmethod
    def worst(cls, losses: Iterable[Loss]) -> Loss:
        """Return the largest of several losses, each part by itself."""
        each = tuple(losses)
        return cls(max(loss.zones for loss in each), max(loss.level for loss in each))
