"""Buildings and ways to compare that the tests of the environments share."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

import ambinav as an
from ambinav.geometry.environment import Environment


def room() -> Environment:
    """A hall of 15 m by 12 m with a thick pillar, wider than the default scanner sees."""
    floor = shapely.box(0, 0, 15, 12).difference(shapely.box(5, 3, 6, 9))
    return an.environment_from_shapes([floor])


def equal(a: Any, b: Any, place: str = "") -> None:
    """Assert that two results are the same to the last bit: keys, types and numbers."""
    if isinstance(a, dict):
        assert a.keys() == b.keys(), (place, a.keys() ^ b.keys())
        for key in a:
            equal(a[key], b[key], f"{place}/{key}")
    elif isinstance(a, tuple | list) or (isinstance(a, np.ndarray) and a.dtype == object):
        assert len(a) == len(b), place
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            equal(x, y, f"{place}[{i}]")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.shape == b.shape, place
        assert np.array_equal(a, b), (place, a, b)
    else:
        assert type(a) is type(b) and a == b, (place, a, b)
