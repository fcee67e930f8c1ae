"""Bodies cut into vertical prisms: volumes, heights, slices, sheets."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from ambinav.buildings.mesh_prisms import SHEET, SLICE, Slab, slabs_of

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]


def hull(
    ring: Sequence[tuple[float, float]], low: float, high: float, scale: float = 1.0
) -> Floats:
    """Corners of a body between a convex outline and the same, scaled about the origin, above."""
    flat = np.array(ring)
    lower = np.column_stack([flat, np.full(len(flat), low)])
    upper = np.column_stack([flat * scale, np.full(len(flat), high)])
    return np.vstack([lower, upper])


def closed(count: int) -> Faces:
    """The faces of such a body, seen from outside counter-clockwise."""
    k = np.arange(count)
    after = (k + 1) % count
    sides = [np.stack([k, after, after + count], 1), np.stack([k, after + count, k + count], 1)]
    fan = np.arange(1, count - 1)
    zero = np.zeros_like(fan)
    ends = [np.stack([zero, fan + 1, fan], 1), np.stack([zero, fan, fan + 1], 1) + count]
    return np.vstack([*sides, *ends])


SQUARE = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]


def volume(slabs: Sequence[Slab]) -> float:
    return sum(slab.area.area * (slab.high - slab.low) for slab in slabs)


def test_an_upright_body_is_one_slab_and_is_clipped() -> None:
    body = hull(SQUARE, 0.2, 3.0)
    (whole,) = slabs_of(body, closed(4), -1.0, 9.0, 0.3)
    assert (whole.low, whole.high, whole.exact) == (0.2, 3.0, True)
    assert shapely.symmetric_difference(whole.area, shapely.box(-1, -1, 1, 1)).area < 1e-9
    (part,) = slabs_of(body, closed(4), 1.0, 2.0, 0.3)
    assert (part.low, part.high) == (1.0, 2.0)
    assert slabs_of(body, closed(4), 3.5, 9.0, 0.3) == []


def test_a_step_changes_the_section_where_it_is() -> None:
    broad, narrow = hull(SQUARE, 0.0, 0.5), hull(SQUARE, 0.5, 2.0)
    narrow[:, :2] *= 0.5
    # Both shells as one body, the joint between them a face twice.
    body, faces = np.vstack([broad, narrow]), np.vstack([closed(4), closed(4) + 8])
    low, high = slabs_of(body, faces, -1.0, 9.0, 0.3)
    assert (low.low, low.high, low.area.area) == pytest.approx((0.0, 0.5, 4.0))
    assert (high.low, high.high, high.area.area) == pytest.approx((0.5, 2.0, 1.0))


def test_a_frustum_in_slices() -> None:
    """The midpoint rule: its volume to a part of SLICE squared, its section at `at` exactly."""
    at = 0.3
    slabs = slabs_of(hull(SQUARE, 0.0, 1.0, 0.5), closed(4), -1.0, 9.0, at)
    slices = [slab for slab in slabs if not slab.exact]
    assert volume(slices) == pytest.approx(4.0 * (1.0 + 0.5 + 0.25) / 3.0, abs=SLICE**2)
    assert max(slab.high - slab.low for slab in slices) <= SLICE + 1e-12
    (mine,) = (slab for slab in slices if slab.low < at < slab.high)
    assert mine.area.area == pytest.approx((2.0 * (1.0 - 0.5 * at)) ** 2, abs=1e-5)
    assert 0.5 * (mine.low + mine.high) == pytest.approx(at)
    edges = [(slab.low, slab.high) for slab in slices]
    assert all(one[1] == other[0] for one, other in itertools.pairwise(edges))


def test_walls_that_lean_by_less_than_a_millimetre_are_upright() -> None:
    (slab,) = slabs_of(hull(SQUARE, 0.0, 3.0, 1.0 + 5e-4), closed(4), -1.0, 9.0, 0.3)
    assert slab.exact


def test_a_level_face_alone_is_a_sheet() -> None:
    corners = np.array([(0.0, 0.0, 0.7), (1.0, 0.0, 0.7), (1.0, 1.0, 0.7), (0.0, 1.0, 0.7)])
    (sheet,) = slabs_of(corners, np.array([(0, 1, 2), (0, 2, 3)]), 0.0, 2.0, 0.3)
    assert (sheet.low, sheet.high) == pytest.approx((0.7, 0.7 + SHEET))
    assert sheet.area.area == pytest.approx(1.0)


def test_faces_that_enclose_nothing_are_lines() -> None:
    corners = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 2.0), (0.0, 0.0, 2.0)])
    (slab,) = slabs_of(corners, np.array([(0, 1, 2), (0, 2, 3)]), -1.0, 9.0, 0.3)
    assert slab.area.is_empty
    assert slab.lines.length == pytest.approx(1.0)
    assert (slab.low, slab.high) == (0.0, 2.0)


def test_a_round_column_is_one_slab() -> None:
    turn = np.linspace(0.0, math.tau, 48, endpoint=False)
    ring = list(zip(np.cos(turn).tolist(), np.sin(turn).tolist(), strict=True))
    (slab,) = slabs_of(hull(ring, 0.0, 2.5), closed(48), 0.0, 3.0, 0.3)
    assert slab.area.area == pytest.approx(24.0 * math.sin(math.tau / 48), abs=1e-5)
