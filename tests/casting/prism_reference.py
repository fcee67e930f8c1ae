"""Rays against prisms one by one, in NumPy and shapely: shares no code with the caster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.casting.prisms.prisms import Solid

Array = NDArray[Any]


def cast_slowly(
    solids: Sequence[Solid],
    sheets: Sequence[tuple[float, float, float, float, float, float]],
    floor: float | None,
    ceiling: float | None,
    origin: Array,
    direction: Array,
) -> Array:
    """Distance of each ray, shape (N,); inf for none. Sheets: ax, ay, bx, by, low, high."""
    best = np.full(len(origin), math.inf)

    def upright(ax: float, ay: float, bx: float, by: float, low: float, high: float) -> None:
        """A rectangle: its plane by its normal, then how far along and how high."""
        a, along = np.array([ax, ay]), np.array([bx - ax, by - ay])
        normal = np.array([along[1], -along[0]])
        t = ((a - origin[:, :2]) @ normal) / (direction[:, :2] @ normal)
        hit = origin + t[:, None] * direction
        share = (hit[:, :2] - a) @ along / (along @ along)
        on = (t >= 0) & (share >= 0) & (share <= 1) & (hit[:, 2] >= low) & (hit[:, 2] <= high)
        best[on] = np.minimum(best[on], t[on])

    def flat(outline: shapely.Geometry | None, z: float) -> None:
        t = (z - origin[:, 2]) / direction[:, 2]
        hit = origin + t[:, None] * direction
        on = t >= 0
        if outline is not None:
            on[on] = shapely.contains_xy(outline, hit[on, 0], hit[on, 1])
        best[on] = np.minimum(best[on], t[on])

    with np.errstate(all="ignore"):
        for sheet in sheets:
            upright(*sheet)
        for solid in solids:
            for ring in (solid.outline.exterior, *solid.outline.interiors):
                for (ax, ay), (bx, by) in pairwise(ring.coords):
                    upright(ax, ay, bx, by, solid.bottom, solid.top)
            flat(solid.outline, solid.bottom)
            flat(solid.outline, solid.top)
        for plane in (floor, ceiling):
            if plane is not None:
                flat(None, plane)
    return best
