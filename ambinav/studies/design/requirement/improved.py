"""The places where a change improves most floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, NOT_FREE, OPEN, TRANSITION
from ambinav.studies.audit.ambiguous_regions import GAP, LEAST_AREA
from ambinav.studies.audit.regions import find_regions, passable

_IMPROVED: Final = 1


@dataclass(frozen=True)
class ImprovedPlace:
    """A connected place that is bad before a change and is not afterwards.

    Attributes:
        x: Its point farthest from its edge, metres, map frame.
        y: The same.
        area: Square metres.
    """

    x: float
    y: float
    area: float


def most_improved(
    before: AmbiguityMap, after: AmbiguityMap, count: int = 3
) -> tuple[ImprovedPlace, ...]:
    """Return the largest improved places, the largest first.

    They are of the floor that counts before the change, in pieces that are one place as the bad
    places of an audit are (`find_regions`).

    Args:
        before: Map of the building as it is.
        after: Map with the change.
        count: How many at most.
    """
    parts, spacing, lattice = before.judged, before.spacing, before.dataset
    then = after.floor("zone").reindex(
        x=lattice["x"], y=lattice["y"], method="nearest", tolerance=0.1 * spacing,
        fill_value=NOT_FREE,
    )  # fmt: skip
    was_bad = np.isin(before.floor("zone").values, (CORRIDOR, OPEN))
    # What an obstacle covers is not improved.
    improved = parts.counted & was_bad & np.isin(then.values, (LOCALIZABLE, TRANSITION))
    labels = find_regions(
        improved.astype(np.uint8),
        (_IMPROVED,),
        np.full(improved.shape, np.nan),
        passable(parts.reachable, before.dataset["clearance"].values, spacing),
        gap=round(GAP / spacing),
        least=max(1, round(LEAST_AREA / spacing**2)),
    )
    cells = np.bincount(labels.ravel())[1:]
    x, y = (before.dataset[axis].values for axis in ("x", "y"))
    places = []
    for label in (1 + np.argsort(-cells, kind="stable")[:count]).tolist():
        # Beyond the lattice there is no floor.
        depth = distance_transform_edt(np.pad(labels == label, 1))[1:-1, 1:-1]
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        area = float(cells[label - 1]) * spacing**2
        places.append(ImprovedPlace(float(x[column]), float(y[row]), area))
    return tuple(places)
