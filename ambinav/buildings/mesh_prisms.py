"""Conversion of a triangle mesh to vertical prisms: sections between two heights."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.mesh_section import GRAIN, section
from ambinav.buildings.section_floor import opened
from ambinav.runtime.array_types import Bools, Floats, Ints

SLICE: Final = 0.04
"""Metres; a part whose sides slope is cut into slices of this height, so that no side is further
than half of it from where it is."""
SHEET: Final = 1e-3
"""Metres; how thick a level face that bounds no body becomes."""
# Metres. Heights that differ by less are one; a face that is lower is level.
_LEVEL: Final = 1e-4
# Metres. A face that leans by less between its lowest and its highest corner is upright.
_UPRIGHT: Final = 1e-3
# Metres. A triangle that is narrower has no direction.
_SLIVER: Final = 1e-5
# Square metres. Less of a level face beside a body is rounding.
_SCRAP: Final = 1e-3


class Slab(NamedTuple):
    """Section of a building that is the same at all heights between two limits.

    Attributes:
        area: The section of bodies, a (Multi)Polygon, metres; may be empty.
        lines: Section of faces that enclose no area, a (Multi)LineString, metres; may be empty.
        low: z, metres.
        high: z, metres.
        exact: Whether the sides are upright in the mesh too.
    """

    area: BaseGeometry
    lines: BaseGeometry
    low: float
    high: float
    exact: bool


def slabs_of(vertices: Floats, faces: Ints, low: float, high: float, at: float) -> list[Slab]:
    """Cut a body horizontally wherever its section changes.

    Between two heights with no sloping face the section is taken once and is exact. Elsewhere the
    body is cut into slices of `SLICE`, each with the section at its middle.

    Args:
        vertices: Shape (V, 3), metres.
        faces: Shape (F, 3), all seen from outside in the same sense.
        low: What is below this z is left out, metres.
        high: What is above this z is left out, metres.
        at: z at the middle of a slice, metres: there the section is that of the mesh.

    Returns:
        From the lowest on; level faces without thickness as slabs of `SHEET`.
    """
    corners = vertices[faces]
    level, sloping = _level_and_sloping(corners)
    z = corners[..., 2]
    stops = _heights(np.append(z[~sloping].ravel(), (z.min(), z.max())))
    slopes = np.stack([z[sloping].min(axis=1), z[sloping].max(axis=1)], axis=1)
    slabs: list[Slab] = []
    for bottom, top, exact in _intervals(stops, slopes, low, high, at):
        # The very section of the plan where that is within, and not one beside it.
        middle = at if bottom < at < top else 0.5 * (bottom + top)
        area, lines = section(vertices, faces, middle)
        if area.is_empty and lines.is_empty:
            continue
        last = slabs[-1] if slabs else None
        if last is not None and last.high == bottom and exact and last.exact and (
            _same(last.area, area) and _same(last.lines, lines)
        ):  # fmt: skip
            slabs[-1] = last._replace(high=top)
        else:
            slabs.append(Slab(area, lines, bottom, top, exact))
    sheets = list(_sheets(corners[level], slabs, low, high))
    return sorted([*slabs, *sheets], key=lambda slab: slab.low)


def _level_and_sloping(corners: Floats) -> tuple[Bools, Bools]:
    """Return which triangles, shape (F, 3, 3), are level, and which neither level nor upright."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(cross, axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    rise = np.ptp(corners[..., 2], axis=1)
    level: Bools = rise <= _LEVEL
    across = np.hypot(cross[:, 0], cross[:, 1])
    upright = rise * np.abs(cross[:, 2]) <= _UPRIGHT * across
    return level, ~level & ~upright & (twice > _SLIVER * longest)


def _heights(z: Floats) -> Floats:
    """Merge ascending heights within `_LEVEL` of the one before, keeping the lowest."""
    z = np.unique(z)
    rising: Floats = z[np.append(True, np.diff(z) > _LEVEL)]
    return rising


def _intervals(
    stops: Floats, slopes: Floats, low: float, high: float, at: float
) -> Iterator[tuple[float, float, bool]]:
    """Yield low and high z of each piece within [low, high], and whether no face slopes in it."""
    for bottom, top in itertools.pairwise(stops.tolist()):
        sloping = bool(((slopes[:, 0] < top - _LEVEL) & (slopes[:, 1] > bottom + _LEVEL)).any())
        below, above = max(bottom, low), min(top, high)
        if above - below <= _LEVEL:
            continue
        inner: list[float] = []
        if sloping:
            # Slices begin half of one from `at`.
            first = math.floor((below - at) / SLICE + 0.5) + 1
            last = math.ceil((above - at) / SLICE + 0.5) - 1
            cuts = (at + (k - 0.5) * SLICE for k in range(first, last + 1))
            inner = [cut for cut in cuts if below + _LEVEL < cut < above - _LEVEL]
        edges = [below, *inner, above]
        for lower, upper in itertools.pairwise(edges):
            yield lower, upper, not sloping


def _sheets(level: Floats, slabs: list[Slab], low: float, high: float) -> Iterator[Slab]:
    """Yield level faces, (N, 3, 3), that are neither top nor bottom of a slab, nor within one."""
    if not len(level):
        return
    heights = _heights(level[:, 0, 2])
    heights = heights[(heights >= low) & (heights + SHEET <= high)]
    layer = np.searchsorted(heights, level[:, 0, 2] + 0.5 * GRAIN, side="right") - 1
    for k, z in enumerate(heights.tolist()):
        mine = level[(layer == k) & (level[:, 0, 2] - z <= _LEVEL)][..., :2]
        touching = [
            slab.area for slab in slabs if slab.low - 2 * _LEVEL <= z <= slab.high + 2 * _LEVEL
        ]
        triangles = shapely.polygons(mine)
        seen = shapely.union_all(triangles[shapely.area(triangles) > 0.0], grid_size=GRAIN)
        bare = shapely.difference(seen, shapely.union_all(touching), grid_size=GRAIN)
        sheet = opened(bare, 2.0 * _UPRIGHT)
        if sheet.area > _SCRAP:
            yield Slab(sheet, shapely.MultiLineString(), z, z + SHEET, exact=True)


def _same(first: BaseGeometry, second: BaseGeometry) -> bool:
    if first.is_empty or second.is_empty:
        return bool(first.is_empty and second.is_empty)
    return bool(shapely.equals_exact(first.normalize(), second.normalize(), 2.0 * GRAIN))
