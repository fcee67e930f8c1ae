"""Conversion of second moments to radii, direction, level and zone (docs/model.md)."""

from __future__ import annotations

import numpy as np

from ambinav.geometry.principal_axes import principal_axes
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, NOT_FREE, OPEN, TRANSITION, ZONES
from ambinav.runtime.array_types import Bytes, Floats


def relative_radii(sums: Floats) -> dict[str, Floats]:
    """Compute the layers of the ambiguity tensor.

    Args:
        sums: shape (..., 7): see `ambinav.ambiguity.kernel.neighbourhood_sums`.

    Returns:
        ambiguity; major_radius and minor_radius (metres); direction (radians, [0, pi));
        major and minor: the radii over the free neighbourhood's along the same axes, in [0, 1];
        level, their mean. Each of shape (...).
    """
    ambiguity, mxx, mxy, myy, fxx, fxy, fyy = np.moveaxis(sums, -1, 0)
    major_radius, minor_radius, direction = principal_axes(mxx, mxy, myy)
    c, s = np.cos(direction), np.sin(direction)
    free_along = np.sqrt(c * c * fxx + 2 * c * s * fxy + s * s * fyy)
    free_across = np.sqrt(s * s * fxx - 2 * c * s * fxy + c * c * fyy)
    major = np.minimum(major_radius / free_along, 1.0)
    minor = np.minimum(minor_radius / free_across, 1.0)
    return {
        "ambiguity": np.minimum(ambiguity, 1.0),
        "major_radius": major_radius,
        "minor_radius": minor_radius,
        "direction": direction,
        "major": major,
        "minor": minor,
        "level": (major + minor) / 2,
    }


def classify(major: Floats, minor: Floats, low: float, high: float) -> Bytes:
    """Return the zone of each pose, uint8.

    Open if both ratios are large, corridor if one is and the other small, localizable if both are
    small, transition in between; not free where they are nan, for no robot can stand there.
    """
    zone = np.full(major.shape, TRANSITION, dtype=np.uint8)
    zone[np.maximum(major, minor) <= low] = LOCALIZABLE
    zone[(np.maximum(major, minor) >= high) & (np.minimum(major, minor) <= low)] = CORRIDOR
    zone[np.minimum(major, minor) >= high] = OPEN
    zone[np.isnan(major)] = NOT_FREE
    return zone


def classify_over_headings(zone: Bytes) -> Bytes:
    """Return the zone of a place from those of its headings, shape (..., H) -> (...).

    Bad (corridor or open) if half or more of the possible headings are; of the two bad zones, and
    of the two others, the one of more headings; ties go to the worse. Not free without a possible
    heading.
    """
    localizable, transition, corridor, open_ = (
        (zone == code).sum(axis=-1) for code in range(len(ZONES))
    )
    worse = np.where(open_ >= corridor, OPEN, CORRIDOR)
    better = np.where(transition >= localizable, TRANSITION, LOCALIZABLE)
    out = np.where(corridor + open_ >= localizable + transition, worse, better)
    return np.asarray(np.where((zone == NOT_FREE).all(axis=-1), NOT_FREE, out), dtype=np.uint8)
