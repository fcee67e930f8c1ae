"""Ranks of hit-point Jacobians: against numpy's SVD, closed forms, and bits counted one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.ambiguity.build import build_map
from ambinav.ambiguity.layers import bands as banding
from ambinav.ambiguity.layers.gfm import DIRECTIONS, LAYER, STEP, gfm, rank_masks, share
from ambinav.ambiguity.layers.ground import Ground
from ambinav.ambiguity.layers.registry import chosen_layers
from ambinav.ambiguity.reference import cast
from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

Floats = NDArray[np.float64]

NEAR = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
FAR = RangeSensor(max_range=12.0, std=0.03, resolution=0.001)
SONAR = RangeSensor(max_range=4.0, std=0.03, resolution=0.01, aperture=0.4)
LASER = RangeScanner.planar(NEAR, 60, 2 * math.pi)


def ground_of(env: Environment, scanner: RangeScanner = LASER) -> Ground:
    return Ground.of(build_map(env, scanner, spacing=0.2, max_beams=66), env)


def hit(env: Environment, x: float, y: float, k: int, limit: float) -> Floats | None:
    """Hit point of the ray in direction k, or None where there is none."""
    angle = STEP * (k % DIRECTIONS)
    d, segment = cast(env, x, y, angle)
    if segment < 0 or d > limit or env.segments.kind[segment] == FRONTIER:
        return None
    return np.array([x + d * math.cos(angle), y + d * math.sin(angle)])


def bad(ground: Ground, x: float, y: float, k: int, limit: float) -> bool:
    """Whether the hit-point Jacobian of a ray has not the full rank, by the definition."""
    env, h = ground.environment, ground.spacing
    own = hit(env, x, y, k, limit)
    if own is None:
        return True

    def at(dx: float, dy: float, turn: int) -> Floats:
        angle, length = math.atan2(dy, dx), math.hypot(dx, dy)
        if length > 0.0 and (not env.is_free(x + dx, y + dy) or cast(env, x, y, angle)[0] < length):
            return own
        there = hit(env, x + dx, y + dy, k + turn, limit)
        return own if there is None else there

    rows = [at(h, 0, 0) - at(-h, 0, 0), at(0, h, 0) - at(0, -h, 0), at(0, 0, 1) - at(0, 0, -1)]
    return bool(np.linalg.matrix_rank(np.array(rows), tol=ground.map_std) < 2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bits_are_the_ranks_that_svd_gives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = ground_of(scenes.scene(seed, size=12.0, blocks=9, thin=4))
    masks = rank_masks(ground, 4.0)
    x, y = ground.points
    chosen = rng.choice(len(x), 25, replace=False)
    expected = [[bad(ground, x[p], y[p], k, 4.0) for k in range(DIRECTIONS)] for p in chosen]
    found = np.unpackbits(masks[chosen].view(np.uint8), bitorder="little").reshape(25, -1)
    # A ray that meets a corner exactly may take either side.
    assert (found != np.array(expected)).mean() < 0.002


def test_between_straight_walls_no_ray_sees_more_than_its_wall() -> None:
    ground = ground_of(scenes.room(20.0, 2.0).transformed(0.3))
    layer = gfm(ground)["gfm"][ground.free]
    x, y = ground.points
    along = math.cos(0.3) * x + math.sin(0.3) * y
    assert (layer[np.abs(along - 10.0) < 5.0] == 1.0).all()
    assert layer[along < 1.5].max() < 1.0


def test_rays_about_the_corners_of_a_room_have_full_rank() -> None:
    ground = ground_of(scenes.room(4.0, 4.0))
    x, y = ground.points
    p = int(np.argmin(np.hypot(x - 1.3, y - 1.7)))
    mask = int(rank_masks(ground, 4.0)[p])
    good = {k for k in range(DIRECTIONS) if not mask >> k & 1}
    corners = np.arctan2([4 - y[p], 4 - y[p], -y[p], -y[p]], [4 - x[p], -x[p], -x[p], 4 - x[p]])
    apart = np.subtract.outer([k * STEP for k in good], corners) + math.pi
    apart = np.abs(np.mod(apart, 2 * math.pi) - math.pi) / STEP
    assert (apart.min(axis=0) < 1.5).all()
    assert (apart.min(axis=1) < 2.5).all()


def test_out_of_range_and_frontier_tell_nothing() -> None:
    assert (gfm(ground_of(scenes.room(12.0, 12.0)))["gfm"] == 1.0).any()
    ring = shapely.box(0, 0, 3, 3)
    open_side = Environment(
        Segments(scenes.rings(ring), np.full(4, FRONTIER, dtype=np.uint8)), ring, name="unknown"
    )
    layer = gfm(ground_of(open_side))["gfm"]
    assert (layer[~np.isnan(layer)] == 1.0).all()


@settings(max_examples=60, deadline=None)
@given(
    mask=st.integers(0, 2**64 - 1),
    heading=st.floats(-10.0, 10.0),
    aperture=st.floats(0.0, 2 * math.pi),
)
def test_share_counts_the_bits_in_view(mask: int, heading: float, aperture: float) -> None:
    apart = [abs(math.remainder(k * STEP - heading, 2 * math.pi)) for k in range(DIRECTIONS)]
    view = [k for k in range(DIRECTIONS) if apart[k] <= aperture / 2]
    if min((abs(a - aperture / 2) for a in apart), default=1.0) < 1e-6:
        return
    view = view or [int(np.argmin(apart))]
    expected = sum(mask >> k & 1 for k in view) / len(view)
    found = share(np.array([mask], dtype=np.uint64), heading, aperture)
    if aperture > STEP:
        assert float(found[0]) == pytest.approx(expected)
    assert 0.0 <= float(found[0]) <= 1.0
    # A turn of the building by a step turns the bits by one.
    turned = ((mask << 1) | (mask >> 63)) & (2**64 - 1)
    again = share(np.array([turned], dtype=np.uint64), heading + STEP, aperture)
    assert float(again[0]) == pytest.approx(float(found[0]), abs=1.0 if aperture < STEP else 0.0)


def test_headings_of_a_fan_are_windows_of_the_mask() -> None:
    fan = RangeScanner.planar(NEAR, 33, 32 * STEP)
    ground = ground_of(scenes.room(5.0, 3.0), fan)
    layer = gfm(ground)["gfm"]
    assert layer.shape == (*ground.free.shape, 8)
    masks = rank_masks(ground, 4.0)
    for h, heading in enumerate(ground.headings):
        np.testing.assert_allclose(layer[ground.free, h], share(masks, heading, 32 * STEP))


def test_each_ray_sees_as_far_as_its_beam() -> None:
    front = RangeScanner.planar(FAR, 16, 15 * STEP)
    rear = RangeScanner.planar(NEAR, 16, 15 * STEP, (0.0, 0.0, math.pi))
    ground = ground_of(scenes.room(14.0, 3.0), RangeScanner.mixed(front, rear))
    layer = gfm(ground)["gfm"]
    x, y = ground.points
    p = int(np.argmin(np.hypot(x - 7.1, y - 1.5)))
    # Ahead the end of the room is in range, behind it is not.
    ahead = share(rank_masks(ground, 12.0), 0.0, 15 * STEP)[p]
    behind = share(rank_masks(ground, 4.0), math.pi, 15 * STEP)[p]
    assert ahead < behind == 1.0
    assert layer[ground.free, 0][p] < layer[ground.free, 4][p] + 1e-6


def test_bands_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    ground = ground_of(scenes.scene(4, size=12.0, blocks=9, thin=4))
    whole = rank_masks(ground, 4.0)
    monkeypatch.setattr(banding, "BAND_BYTES", 500_000)
    assert len(list(banding.bands(ground, 1))) > 2
    np.testing.assert_array_equal(rank_masks(ground, 4.0), whole)


def test_a_scanner_of_cones_cannot_have_it() -> None:
    with pytest.raises(InputError, match=r"cannot have gfm: all its beams are cones, of 22.9"):
        chosen_layers("gfm", RangeScanner.ring(SONAR, 16, 0.2))
    assert LAYER.why_not(RangeScanner.mixed(LASER, RangeScanner.ring(SONAR, 16, 0.2))) is None
