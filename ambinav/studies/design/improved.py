"""The places where a change improves most floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from string import ascii_uppercase
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from pydantic import Field
from scipy.ndimage import distance_transform_edt, find_objects
from shapely.geometry.base import BaseGeometry

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.regions import GAP, LEAST_AREA, Labels, find_regions, passable
from ambinav.maps.zones import BAD, LOCALIZABLE, NOT_FREE, TRANSITION
from ambinav.reports.fields import Metres, Part, SquareMetres
from ambinav.runtime.array_types import Bools, Bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES: Final = ("before", "after")
"""Pictures of the floor before and after a change."""
MOST: Final = 3
"""Places that are named."""
_IMPROVED: Final = 1


class ImprovedPart(Part):
    """A connected place that is bad before a change and is not afterwards."""

    x_m: Metres = Field(description="its point farthest from its edge, map frame")
    y_m: Metres
    area_m2: SquareMetres


def most_improved(
    before: AmbiguityMap,
    after: AmbiguityMap,
    parts: JudgedFloor | None = None,
    within: BaseGeometry | None = None,
) -> tuple[ImprovedPart, ...]:
    """Return the largest places where bad floor becomes good, the largest first.

    Args:
        before: Map of the building as it is.
        after: Map with the change.
        parts: Masks of the floor that counts; None: those of `before`.
        within: Polygons that the floor must lie in; None: anywhere.
    """
    parts = parts or before.judged
    improved = improved_floor(before, after, parts)
    if within is not None:
        x, y = np.meshgrid(before.dataset["x"].values, before.dataset["y"].values)
        improved &= shapely.contains_xy(within, x, y)
    return largest_places(before, improved, parts)


def improved_floor(before: AmbiguityMap, after: AmbiguityMap, parts: JudgedFloor) -> Bools:
    """Return a mask, shape (ny, nx), of floor that counts and is bad only before a change.

    Args:
        before: Map of the building as it is.
        after: Map with the change, whose lattice may be larger or smaller.
        parts: Masks of the floor that counts.
    """
    was_bad = np.isin(before.floor("zone").values, BAD)
    # What an obstacle covers is not improved.
    good = np.isin(zones_after(before, after), (LOCALIZABLE, TRANSITION))
    return np.asarray(parts.counted & was_bad & good)


def zones_after(before: AmbiguityMap, after: AmbiguityMap) -> Bytes:
    """Return the zones of a changed map on the lattice of the map before, shape (ny, nx).

    An obstacle at the end of the floor makes the lattice smaller; there nothing is free.
    """
    lattice = before.dataset
    return np.asarray(
        after.floor("zone").reindex(
            x=lattice["x"], y=lattice["y"], method="nearest", tolerance=0.1 * before.spacing,
            fill_value=NOT_FREE,
        ).values
    )  # fmt: skip


def largest_places(amap: AmbiguityMap, mask: Bools, parts: JudgedFloor) -> tuple[ImprovedPart, ...]:
    """Return the largest connected places of a mask of the floor, the largest first.

    Pieces are one place as the bad places of an audit are (`find_regions`).

    Args:
        amap: The map.
        mask: The floor, shape (ny, nx).
        parts: Masks of the floor that counts.
    """
    labels = connected(amap, mask, parts)
    cells = np.bincount(labels.ravel())[1:]
    boxes = find_objects(labels)
    x, y = (amap.dataset[axis].values for axis in ("x", "y"))
    places = []
    for label in (1 + np.argsort(-cells, kind="stable")[:MOST]).tolist():
        # Around it, and beyond the lattice, there is no floor of it.
        rows, columns = boxes[label - 1]
        depth = distance_transform_edt(np.pad(labels[rows, columns] == label, 1))[1:-1, 1:-1]
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        area = float(cells[label - 1]) * amap.cell_area
        places.append(ImprovedPart(x_m=x[columns][column], y_m=y[rows][row], area_m2=area))
    return tuple(places)


def connected(amap: AmbiguityMap, mask: Bools, parts: JudgedFloor) -> Labels:
    """Label the connected places of a mask of the floor, shape (ny, nx); 0: none."""
    spacing = amap.spacing
    return find_regions(
        mask.astype(np.uint8),
        (_IMPROVED,),
        np.full(mask.shape, np.nan),
        passable(parts.reachable, amap.dataset["clearance"].values, spacing),
        gap=round(GAP / spacing),
        least=max(1, round(LEAST_AREA / spacing**2)),
    )


def improved_text(
    places: Sequence[ImprovedPart], intro: str = "Most floor becomes good", *, named: bool = True
) -> str:
    """List the places in a sentence, empty if there are none.

    Args:
        places: The places.
        intro: What happens there.
        named: Whether by the names that pictures give them.
    """
    names = ascii_uppercase if named else ("",) * len(places)
    listed = [
        f"{name} around ({place.x_m:.1f}, {place.y_m:.1f}), "
        f"{place.area_m2:,.{int(place.area_m2 < 10.0)}f} m²".strip()
        for name, place in zip(names, places, strict=False)
    ]
    return f"{intro}: {'; '.join(listed)}." if listed else ""


def state_figures(draw: Callable[[bool], Axes]) -> dict[str, Callable[[], Axes | Figure]]:
    """Return the pictures of a study's floor, which is drawn without the change and with it."""
    return {
        name: partial(draw, placed) for name, placed in zip(PICTURES, (False, True), strict=True)
    }
