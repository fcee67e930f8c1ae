"""Segments: types, order, bounds, turning and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.geometry.segments import FRONTIER, WALL, Segments


def test_arrays_get_their_type_and_lengths_are_right() -> None:
    segments = Segments(np.array([[0, 0, 3, 4], [1, 1, 1, 3]]), np.array([WALL, FRONTIER]))
    assert segments.xy.dtype == np.float64 and segments.xy.flags.c_contiguous
    assert segments.kind.dtype == np.uint8
    assert segments.lengths.tolist() == [5.0, 2.0]
    assert segments.walls.tolist() == [True, False]
    assert segments.bounds == (0.0, 0.0, 3.0, 4.0)
    assert len(segments) == 2


def test_segments_of_no_length_are_dropped_with_their_kind() -> None:
    segments = Segments(
        np.array([[1.0, 1, 1, 1], [0, 0, 1, 0], [2, 2, 2, 2]]), np.array([WALL, FRONTIER, WALL])
    )
    assert segments.xy.tolist() == [[0, 0, 1, 0]]
    assert segments.kind.tolist() == [FRONTIER]


def test_no_segments() -> None:
    assert len(Segments(np.empty((0, 4)), np.empty(0))) == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_ends_must_be_finite(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        Segments(np.array([[0.0, 0, bad, 1]]), np.zeros(1))


def test_every_segment_needs_a_kind() -> None:
    with pytest.raises(ValueError, match="2 segments but 1 kinds"):
        Segments(np.array([[0.0, 0, 1, 1], [0, 0, 2, 2]]), np.zeros(1))


def test_turned_then_shifted() -> None:
    segments = Segments(np.array([[1.0, 0, 2, 0]]), np.array([FRONTIER]))
    turned = segments.transformed(math.pi / 2, 10.0, 20.0)
    assert turned.xy == pytest.approx(np.array([[10.0, 21, 10, 22]]))
    assert turned.kind.tolist() == [FRONTIER]


def test_there_and_back_and_lengths_kept() -> None:
    rng = np.random.default_rng(1)
    segments = Segments(rng.uniform(-50, 50, (100, 4)), np.zeros(100))
    turned = segments.transformed(0.7, 0.0, 0.0)
    assert turned.lengths == pytest.approx(segments.lengths)
    assert turned.transformed(-0.7, 0.0, 0.0).xy == pytest.approx(segments.xy, abs=1e-12)
