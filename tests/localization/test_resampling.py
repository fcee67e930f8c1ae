"""Resampling: expected numbers of copies, how much they scatter, KLD's count, random poses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.localization.bins import bin_of, kld_count, table_size
from ambinav.localization.random import states
from ambinav.localization.resampling import (
    CODES,
    LOW_VARIANCE,
    MULTINOMIAL,
    SYSTEMATIC,
    fill_guide,
    guided_first_above,
    random_pose,
    resample,
    van_der_corput,
)
from tests.localization import worlds

methods = pytest.mark.parametrize("method", CODES.values(), ids=CODES.keys())
ROOM = worlds.room()


def drawn(
    particles: np.ndarray, method: int, seed: int, *, share: float = 0.0, least: int, most: int
) -> tuple[np.ndarray, int]:
    """The new set and how many bins it fills."""
    size = max(most, len(particles))
    out = np.zeros((size, 5))
    keys, places = np.empty(table_size(size), dtype=np.int64), np.empty(size, dtype=np.int32)
    triangles = ROOM.triangulation.corner.reshape(-1, 3, 2)
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = np.cumsum(np.abs(np.linalg.det(edges)) / 2)
    count, bins = resample(
        particles, len(particles), out, method, share, 0.05, 0.99, least, most, areas,
        ROOM.triangulation.corner, states(np.random.default_rng(seed), 1)[0], np.empty(size),
        np.empty(size, dtype=np.int32), keys, np.empty(size, dtype=np.int32), places,
        np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int64),
    )  # fmt: skip
    # Copies share a bin's entry, and what was put anywhere has one of its own.
    assert [keys[k] for k in places[:count]] == [bin_of.py_func(*row[:3]) for row in out[:count]]
    return out[:count], bins


def particles_in(count: int, spread: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    particles = np.zeros((count, 5))
    particles[:, :2] = rng.normal(0.0, spread, (count, 2))
    # The heading names the particle.
    particles[:, 2] = np.linspace(-3.0, 3.0, count)
    particles[:, 3] = rng.exponential(1.0, count)
    return particles


def copies(particles: np.ndarray, out: np.ndarray) -> np.ndarray:
    return (out[:, np.newaxis, 2] == particles[:, 2]).sum(axis=0)


@pytest.mark.parametrize("power", [0.0, 1.0, 20.0])
def test_a_guided_search_finds_what_bisection_finds(power: float) -> None:
    """Also where few particles have all of the weight, and at the steps themselves."""
    rng = np.random.default_rng(4)
    for count in (1, 2, 7, 500):
        weights = rng.random(count) ** power
        weights[rng.random(count) < 0.3] = 0.0
        weights[-1] = 1e-3
        cumulated = np.cumsum(weights)
        guide = np.empty(count, dtype=np.int32)
        fill_guide(cumulated, count, guide)
        values = np.concatenate([rng.random(300) * cumulated[-1], cumulated, [0.0]])
        expected = np.minimum(np.searchsorted(cumulated, values, side="right"), count - 1)
        found = [guided_first_above.py_func(value, cumulated, count, guide) for value in values]
        np.testing.assert_array_equal(found, expected)


@methods
def test_copies_are_as_many_as_the_weights_ask(method: int) -> None:
    particles = particles_in(40, 0.1, seed=1)
    expected = 400 * particles[:, 3] / particles[:, 3].sum()
    counts = np.array(
        [copies(particles, drawn(particles, method, s, least=400, most=400)[0]) for s in range(200)]
    )
    assert (counts.sum(axis=1) == 400).all()
    assert np.abs(counts.mean(axis=0) - expected).max() < 0.35 * math.sqrt(expected.max())
    off = np.abs(counts - expected).max()
    if method == LOW_VARIANCE:
        assert off < 1.0 + 1e-9
    if method == SYSTEMATIC:
        # Van der Corput's sequence: log2(n) / 3 + 1 by theory.
        assert off < math.log2(400) / 3 + 1
    if method == MULTINOMIAL:
        assert counts.var(axis=0) == pytest.approx(expected * (1 - expected / 400), rel=0.5)


@methods
def test_count_is_klds(method: int) -> None:
    particles = particles_in(3000, 0.4, seed=2)
    particles[:, 2] *= 0.1
    out, bins = drawn(particles, method, 3, least=100, most=3000)
    at = np.column_stack((np.floor(out[:, :2] / 0.5), np.floor(np.mod(out[:, 2], 2 * math.pi)
                          / math.radians(10.0))))  # fmt: skip
    assert bins == len(np.unique(at, axis=0))
    if method != LOW_VARIANCE:
        assert len(out) == kld_count(bins, 0.05, 0.99, 100, 3000)
    assert 500 < len(out) < 3000
    assert out[:, 3] == pytest.approx(1.0 / len(out))


@methods
def test_weightless_particles_are_not_drawn(method: int) -> None:
    particles = particles_in(50, 0.1, seed=4)
    particles[::2, 3] = 0.0
    for seed in range(20):
        counts = copies(particles, drawn(particles, method, seed, least=100, most=100)[0])
        assert counts[::2].sum() == 0 and counts.sum() == 100


@methods
def test_a_share_is_put_anywhere(method: int) -> None:
    particles = particles_in(500, 0.1, seed=5)
    particles[:, :2] -= 50.0
    out, _ = drawn(particles, method, 6, share=0.3, least=4000, most=4000)
    fresh = out[out[:, 0] > -20.0]
    assert abs(len(fresh) / 4000 - 0.3) < 0.03
    assert np.asarray(ROOM.is_free(fresh[:, 0], fresh[:, 1])).all()


def test_random_poses_are_even() -> None:
    triangles = ROOM.triangulation.corner.reshape(-1, 3, 2)
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = np.cumsum(np.abs(np.linalg.det(edges)) / 2)
    assert areas[-1] == pytest.approx(ROOM.free.area)
    state = states(np.random.default_rng(7), 1)[0]
    poses = np.array([random_pose(areas, ROOM.triangulation.corner, state) for _ in range(20_000)])
    assert np.asarray(ROOM.is_free(poses[:, 0], poses[:, 1])).all()
    # The right arm of the L.
    inside = poses[:, 0] > 5.0
    assert inside.mean() == pytest.approx(16.0 / ROOM.free.area, abs=0.01)
    assert poses[inside, 0].mean() == pytest.approx(7.0, abs=0.05)
    assert abs(poses[:, 2].mean()) < 0.05
    assert poses[:, 2].std() == pytest.approx(math.pi / math.sqrt(3), rel=0.02)


def test_van_der_corput() -> None:
    first = [van_der_corput(m) for m in range(8)]
    assert first == [0.0, 0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875]
    # Later terms have the bits of their number in reverse after the point.
    for m in (1000, 0b1011_0000_0000_0000_0000_0111, 2**32 - 1):
        assert van_der_corput(m) == int(f"{m:032b}"[::-1], 2) / 2**32
