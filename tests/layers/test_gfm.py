"""Ranks of hit-point Jacobians: closed forms, and bits counted one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.layers import gfm as module
from ambinav.layers.context import LayerContext
from ambinav.layers.gfm import DIRECTIONS, LAYER, TURN, gfm, rank_masks, share
from ambinav.layers.registry import chosen_layers
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

Floats = NDArray[np.float64]

NEAR = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
FAR = RangeSensor(max_range=12.0, std=0.03, resolution=0.001)
SONAR = RangeSensor(max_range=4.0, std=0.03, resolution=0.01, aperture=0.4)
LASER = RangeScanner.planar(NEAR, 60, 2 * math.pi)


def context_of(env: Environment, scanner: RangeScanner = LASER) -> LayerContext:
    return LayerContext.of(build_map(env, scanner, spacing=0.2, max_beams=66), env)


def test_between_straight_walls_no_ray_sees_more_than_its_wall() -> None:
    context = context_of(scenes.room(20.0, 2.0).transformed(0.3))
    layer = gfm(context, step=0.2)["gfm"][context.free]
    x, y = context.points
    along = math.cos(0.3) * x + math.sin(0.3) * y
    assert (layer[np.abs(along - 10.0) < 5.0] == 1.0).all()
    assert layer[along < 1.5].max() < 1.0


def test_rays_about_the_corners_of_a_room_have_full_rank() -> None:
    context = context_of(scenes.room(4.0, 4.0))
    x, y = context.points
    p = int(np.argmin(np.hypot(x - 1.3, y - 1.7)))
    mask = int(rank_masks(context, 4.0)[p])
    good = {k for k in range(DIRECTIONS) if not mask >> k & 1}
    corners = np.arctan2([4 - y[p], 4 - y[p], -y[p], -y[p]], [4 - x[p], -x[p], -x[p], 4 - x[p]])
    apart = np.subtract.outer([k * TURN for k in good], corners) + math.pi
    apart = np.abs(np.mod(apart, 2 * math.pi) - math.pi) / TURN
    assert (apart.min(axis=0) < 1.5).all()
    assert (apart.min(axis=1) < 2.5).all()


def test_out_of_range_and_frontier_tell_nothing() -> None:
    assert (gfm(context_of(scenes.room(12.0, 12.0)))["gfm"] == 1.0).any()
    ring = shapely.box(0, 0, 3, 3)
    open_side = Environment(
        Segments(scenes.rings(ring), np.full(4, FRONTIER, dtype=np.uint8)), ring, name="unknown"
    )
    layer = gfm(context_of(open_side))["gfm"]
    assert (layer[~np.isnan(layer)] == 1.0).all()


@settings(max_examples=60, deadline=None)
@given(
    mask=st.integers(0, 2**64 - 1),
    heading=st.floats(-10.0, 10.0),
    aperture=st.floats(0.0, 2 * math.pi),
)
def test_share_counts_the_bits_in_view(mask: int, heading: float, aperture: float) -> None:
    apart = [abs(math.remainder(k * TURN - heading, 2 * math.pi)) for k in range(DIRECTIONS)]
    view = [k for k in range(DIRECTIONS) if apart[k] <= aperture / 2]
    if min((abs(a - aperture / 2) for a in apart), default=1.0) < 1e-6:
        return
    view = view or [int(np.argmin(apart))]
    expected = sum(mask >> k & 1 for k in view) / len(view)
    found = share(np.array([mask], dtype=np.uint64), heading, aperture)
    if aperture > TURN:
        assert float(found[0]) == pytest.approx(expected)
    assert 0.0 <= float(found[0]) <= 1.0
    # A turn of the building by a step turns the bits by one.
    turned = ((mask << 1) | (mask >> 63)) & (2**64 - 1)
    again = share(np.array([turned], dtype=np.uint64), heading + TURN, aperture)
    assert float(again[0]) == pytest.approx(float(found[0]), abs=1.0 if aperture < TURN else 0.0)


def test_headings_of_a_fan_are_windows_of_the_mask() -> None:
    fan = RangeScanner.planar(NEAR, 33, 32 * TURN)
    context = context_of(scenes.room(5.0, 3.0), fan)
    layer = gfm(context)["gfm"]
    assert layer.shape == (*context.free.shape, 8)
    masks = rank_masks(context, 4.0)
    for h, heading in enumerate(context.headings):
        np.testing.assert_allclose(layer[context.free, h], share(masks, heading, 32 * TURN))


def test_each_ray_sees_as_far_as_its_beam() -> None:
    front = RangeScanner.planar(FAR, 16, 15 * TURN)
    rear = RangeScanner.planar(NEAR, 16, 15 * TURN, (0.0, 0.0, math.pi))
    context = context_of(scenes.room(14.0, 3.0), RangeScanner.mixed(front, rear))
    layer = gfm(context)["gfm"]
    x, y = context.points
    p = int(np.argmin(np.hypot(x - 7.1, y - 1.5)))
    # Ahead the end of the room is in range, behind it is not.
    ahead = share(rank_masks(context, 12.0), 0.0, 15 * TURN)[p]
    behind = share(rank_masks(context, 4.0), math.pi, 15 * TURN)[p]
    assert ahead < behind == 1.0
    assert layer[context.free, 0][p] < layer[context.free, 4][p] + 1e-6


def test_batches_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    context = context_of(scenes.scene(4, size=12.0, blocks=9, thin=4))
    whole = rank_masks(context, 4.0)
    monkeypatch.setattr(module, "BATCH", 700)
    np.testing.assert_array_equal(rank_masks(context, 4.0), whole)


@pytest.mark.slow
def test_the_spacing_of_the_map_changes_nothing(demo: Environment) -> None:
    """The poses of a lattice are among those of one three times as fine."""
    fine, coarse = (
        LayerContext.of(build_map(demo, LASER, spacing=spacing, radius=0.8), demo)
        for spacing in (0.25, 0.75)
    )
    here, there = gfm(fine)["gfm"], gfm(coarse)["gfm"]
    x, y = coarse.points
    column = np.rint((x - fine.lattice.x[0]) / 0.25).astype(int)
    row = np.rint((y - fine.lattice.y[0]) / 0.25).astype(int)
    np.testing.assert_array_equal(there[coarse.free], here[row, column])
    # It is the step that counts.
    assert (gfm(coarse, step=0.3)["gfm"] != there)[coarse.free].mean() > 0.3


def test_a_wider_step_meets_more_features() -> None:
    context = context_of(scenes.room(4.0, 4.0))
    wide = rank_masks(context, 4.0, 1.0)
    narrow = rank_masks(context, 4.0, 0.01)
    assert np.bitwise_count(wide).mean() < np.bitwise_count(narrow).mean()


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan, math.inf])
def test_bad_step(step: float) -> None:
    with pytest.raises(InputError, match="step"):
        gfm(context_of(scenes.room(1.0, 1.0)), step=step)


def test_a_scanner_of_cones_cannot_have_it() -> None:
    with pytest.raises(InputError, match=r"cannot have gfm: all its beams are cones, of 22.9"):
        chosen_layers("gfm", RangeScanner.ring(SONAR, 16, 0.2))
    assert LAYER.why_not(RangeScanner.mixed(LASER, RangeScanner.ring(SONAR, 16, 0.2))) is None
