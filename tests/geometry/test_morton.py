"""The order of points along Morton's curve."""

from __future__ import annotations

import numpy as np

from ambinav.geometry.morton import morton


def test_morton_keeps_bits_by_turns() -> None:
    points = np.array([[0, 0], [0, 1], [1, 0], [1, 1], [0, 2], [3, 5]], dtype=np.int32)
    assert morton(points).tolist() == [0, 1, 2, 3, 4, 0b11011]
