"""The worst regions of an ambiguity map: connected cells, ranked by ambiguity times area."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely import MultiPoint, Polygon, minimum_rotated_rectangle

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.regions import GAP, LEAST_AREA, Labels, find_regions, passable
from ambinav.maps.zones import BAD, CORRIDOR, OPEN, TRANSITION, ZONES
from ambinav.runtime.array_types import Bools, Bytes, Floats

_PRONOUNCED = 0.3
"""Difference of major and minor from which a weak direction is reported."""


@dataclass(frozen=True)
class AmbiguousRegion:
    """A connected region where the robot may get lost.

    Attributes:
        number: Rank, from 1 for the worst.
        zone: "corridor" or "open".
        x: Metres; the most ambiguous point, deep inside the region.
        y: Metres.
        area: Square metres of the region.
        length: Metres; the region's smallest enclosing rectangle, its longer side.
        width: Metres; its shorter side.
        direction: Radians in [0, pi): along it the robot slides unseen; None if there is no one
            direction.
        level: Mean ambiguity level of the region, in [0, 1].
        major_radius: Metres at (x, y): how far the robot can slide unseen along the direction.
        minor_radius: Metres at (x, y): the same across it.
        by_heading: Heading in radians and level at (x, y), for each heading of the map; empty if
            the heading does not matter.
        outline: (xmin, ymin, xmax, ymax) of the region, metres.
    """

    number: int
    zone: str
    x: float
    y: float
    area: float
    length: float
    width: float
    direction: float | None
    level: float
    major_radius: float
    minor_radius: float
    by_heading: tuple[tuple[float, float], ...]
    outline: tuple[float, float, float, float]

    @property
    def severity(self) -> float:
        """Mean level times area, square metres: the ranking criterion."""
        return self.level * self.area

    @property
    def best_heading(self) -> float | None:
        """The least ambiguous heading at (x, y), radians; None if the heading does not matter."""
        return min(self.by_heading, key=lambda pair: pair[1])[0] if self.by_heading else None

    @property
    def worst_heading(self) -> float | None:
        """The most ambiguous heading at (x, y), radians; None if the heading does not matter."""
        return max(self.by_heading, key=lambda pair: pair[1])[0] if self.by_heading else None


def find_ambiguous_regions(
    amap: AmbiguityMap,
    count: int | None = None,
    heading: str | float = "mean",
    *,
    least_area: float = LEAST_AREA,
) -> tuple[AmbiguousRegion, ...]:
    """Find the connected regions of corridor and open zones, the worst first.

    Regions are of judged floor (`AmbiguityMap.judged`). Pieces of one may lie apart on what is
    reachable but unexplored.

    Args:
        amap: The map.
        count: How many at most; None: all.
        heading: "mean", "best", "worst" or radians, where the heading matters.
        least_area: Square metres, see `LEAST_AREA`.

    Returns:
        Places numbered from 1; empty if there are none.

    Raises:
        InputError: no such heading.
    """
    floor = {
        name: amap.floor(name, heading).values
        for name in ("level", "major", "minor", "direction", "major_radius", "minor_radius")
    }
    parts = amap.judged
    zone = np.where(parts.counted, amap.floor("zone", heading).values, TRANSITION)
    seen = np.nonzero((zone == CORRIDOR) | (zone == OPEN))
    axis = np.full(zone.shape, np.nan, dtype=floor["direction"].dtype)
    pronounced = (
        _zero_for_nan(floor["major"][seen]) - _zero_for_nan(floor["minor"][seen]) >= _PRONOUNCED
    )
    axis[seen] = np.where(pronounced, floor["direction"][seen], np.nan)
    labels = find_regions(
        zone,
        BAD,
        axis,
        passable(parts.reachable, amap.dataset["clearance"].values, amap.spacing),
        gap=round(GAP / amap.spacing),
        least=max(1, round(least_area / amap.spacing**2)),
    )
    within = np.nonzero(labels)
    severity = np.bincount(labels[within], weights=_zero_for_nan(floor["level"][within]))[1:]
    worst = 1 + np.argsort(-severity, kind="stable")[:count]
    boxes = ndimage.find_objects(labels)
    return tuple(
        _describe(amap, labels, boxes[label - 1], int(label), number, zone, floor, axis)
        for number, label in enumerate(worst.tolist(), start=1)
    )


def _zero_for_nan(values: NDArray[np.floating[Any]]) -> Floats:
    """Replace NaN by 0 in float64, faster than `np.nan_to_num` on large maps.

    Infinite values are rare; only then `np.nan_to_num` is called.
    """
    out = np.where(np.isnan(values), np.float32(0.0), values).astype(np.float64)
    return np.nan_to_num(out, copy=False) if np.isinf(values).any() else out


def _describe(
    amap: AmbiguityMap,
    labels: Labels,
    box: tuple[slice, slice],
    label: int,
    number: int,
    zone: Bytes,
    floor: dict[str, NDArray[np.floating[Any]]],
    axis: NDArray[np.floating[Any]],
) -> AmbiguousRegion:
    """Measure one region; `box` is the part of the lattice that contains it."""
    inside = labels[box] == label
    part = {name: values[box] for name, values in floor.items()}
    x = amap.dataset["x"].values[box[1]]
    y = amap.dataset["y"].values[box[0]]
    level = _zero_for_nan(part["level"])
    row, column = _representative(inside, level)
    # Rounded, so that all reports print the same: 20.95 and 20.950000001 differ in one decimal.
    px, py = round(float(x[column]), 6), round(float(y[row]), 6)
    rows, columns = np.nonzero(inside)
    length, width = _extent(x[columns], y[rows], amap.spacing)
    half = amap.spacing / 2
    counts = np.bincount(zone[box][inside], minlength=len(ZONES))
    spread = _zero_for_nan(part["major"][inside]) - _zero_for_nan(part["minor"][inside])
    radii = _zero_for_nan(
        np.array([part[name][row, column] for name in ("major_radius", "minor_radius")])
    )
    kind = ZONES[CORRIDOR] if counts[CORRIDOR] >= counts[OPEN] else ZONES[OPEN]
    return AmbiguousRegion(
        number=number,
        zone=kind,
        x=px,
        y=py,
        area=float(inside.sum() * amap.spacing**2),
        length=length,
        width=width,
        direction=_mean_axis(axis[box][inside].astype(np.float64), spread),
        level=float(level[inside].mean()),
        major_radius=float(radii[0]),
        minor_radius=float(radii[1]),
        by_heading=_by_heading(amap, box[0].start + row, box[1].start + column),
        outline=(
            float(x[0] - half), float(y[0] - half), float(x[-1] + half), float(y[-1] + half)
        ),
    )  # fmt: skip


def _representative(inside: Bools, level: Floats) -> tuple[int, int]:
    """Choose the representative cell of a region.

    Among about the worst tenth of its cells, take the deepest and then the most central one.
    """
    limit = np.quantile(level[inside], 0.9) - 0.03
    depth = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
    rows, columns = np.nonzero(inside & (level >= limit))
    all_rows, all_columns = np.nonzero(inside)
    off = np.hypot(rows - all_rows.mean(), columns - all_columns.mean())
    # A cell of depth counts for more than any distance from the centre of the region.
    best = int(np.lexsort((off, -np.round(depth[rows, columns], 6)))[0])
    return int(rows[best]), int(columns[best])


def _extent(x: Floats, y: Floats, spacing: float) -> tuple[float, float]:
    """Compute the sides of the smallest rectangle around the cells, the longer first, metres."""
    rectangle = minimum_rotated_rectangle(MultiPoint(np.column_stack([x, y])))
    if not isinstance(rectangle, Polygon):
        return float(rectangle.length) + spacing, spacing
    corners = np.asarray(rectangle.exterior.coords)
    first, second = np.hypot(*np.diff(corners[:3], axis=0).T) + spacing
    return float(max(first, second)), float(min(first, second))


def _mean_axis(axis: Floats, weight: Floats) -> float | None:
    """Compute the mean of axes (period pi); None if few cells have one or they disagree."""
    is_finite = np.isfinite(axis)
    if is_finite.sum() < 0.5 * axis.size:
        return None
    resultant = np.sum(weight[is_finite] * np.exp(2j * axis[is_finite])) / np.sum(weight[is_finite])
    if abs(resultant) < 0.5:
        return None
    angle = float(np.angle(resultant)) / 2.0
    return angle if angle >= 0.0 else (angle + math.pi) % math.pi


def _by_heading(amap: AmbiguityMap, row: int, column: int) -> tuple[tuple[float, float], ...]:
    """Return the possible headings in a cell and their levels; empty if headings do not matter."""
    if not amap.has_theta:
        return ()
    level = amap.dataset["level"].values[row, column]
    theta = amap.dataset["theta"].values
    is_finite = np.isfinite(level)
    return tuple(zip(theta[is_finite].tolist(), level[is_finite].tolist(), strict=True))
