"""Bins, KLD's count, clusters and the estimate: against NumPy and scipy."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage, stats

from ambinav.localization.bins import (
    WINDOW,
    bin_of,
    estimate,
    fill_bins,
    kld_count,
    label_clusters,
    table_size,
)
from tests.localization.worlds import turned

HEADINGS = np.empty((2, WINDOW**2), dtype=np.int64)


def cloud(seed: int, count: int = 1500) -> np.ndarray:
    """Clusters of particles, one across the cut of the heading, and a few loners."""
    rng = np.random.default_rng(seed)
    centres = np.array([[2.0, 3.0, math.pi], [8.0, -3.0, 0.4], [-5.0, 6.0, -2.0]])
    which = rng.choice(3, count, p=(0.5, 0.3, 0.2))
    out = np.zeros((count, 5))
    out[:, :3] = centres[which] + rng.normal(0.0, (0.5, 0.4, 0.15), (count, 3))
    out[-30:, :3] = rng.uniform((-20, -20, -math.pi), (20, 20, math.pi), (30, 3))
    out[:, 2] = turned(out[:, 2])
    out[:, 3] = rng.uniform(0.1, 1.0, count)
    return out


def tables(count: int) -> tuple[np.ndarray, ...]:
    size = table_size(count)
    small = (np.empty(n, dtype=np.int32) for n in (count, size, count))
    return np.empty(size, dtype=np.int64), *small


def filled(particles: np.ndarray, keys: np.ndarray, entry: np.ndarray) -> tuple[int, np.ndarray]:
    """How many bins `fill_bins` fills, and the entry of each particle's."""
    count = len(particles)
    places, found = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int64)
    return fill_bins(particles, count, keys, entry, places, found), places


def keys_of(particles: np.ndarray) -> np.ndarray:
    """Column, row and heading of each particle's bin, (N, 3)."""
    place = np.floor(particles[:, :2] / 0.5)
    heading = np.floor(np.mod(particles[:, 2], 2 * math.pi) / math.radians(10.0)) % 36
    return np.column_stack((place, heading)).astype(int)


def clusters_slowly(particles: np.ndarray) -> np.ndarray:
    """Cluster of each particle by connected components, headings round the circle, (N,)."""
    keys = keys_of(particles)
    keys[:, :2] -= keys[:, :2].min(axis=0)
    grid = np.zeros((*(keys[:, :2].max(axis=0) + 1), 3 * 36), dtype=bool)
    for turn in range(3):
        grid[keys[:, 0], keys[:, 1], keys[:, 2] + 36 * turn] = True
    label, count = ndimage.label(grid, structure=np.ones((3, 3, 3)))
    # The circle, unrolled three times: what is one in some of the copies is one.
    joined = list(range(count + 1))

    def root(k: int) -> int:
        while joined[k] != k:
            k = joined[k]
        return k

    for turn in range(2):
        pairs = zip(
            label[keys[:, 0], keys[:, 1], keys[:, 2] + 36 * turn],
            label[keys[:, 0], keys[:, 1], keys[:, 2] + 36 * (turn + 1)],
            strict=True,
        )
        for a, b in pairs:
            joined[root(int(a))] = root(int(b))
    return np.array([root(int(k)) for k in label[keys[:, 0], keys[:, 1], keys[:, 2]]])


def test_bins_are_counted() -> None:
    particles = cloud(1)
    keys, entry, _, _ = tables(len(particles))
    bins, places = filled(particles[:1000], keys, entry)
    assert bins == len(np.unique(keys_of(particles[:1000]), axis=0))
    assert len(np.unique(keys[entry[:bins]])) == bins == (keys >= 0).sum()
    assert [keys[k] for k in places] == [bin_of.py_func(*row[:3]) for row in particles[:1000]]


def test_kld_count_is_foxs() -> None:
    # n = chi2_{k-1, 1-delta} / (2 error), with the quantile's normal approximation.
    for k in (2, 10, 60, 500):
        quantile = float(stats.norm.ppf(0.95))
        exact = stats.chi2.ppf(0.95, k - 1) / (2 * 0.05)
        assert abs(kld_count(k, 0.05, quantile, 1, 10**6) / exact - 1.0) < 0.05
    assert kld_count(1, 0.05, 0.99, 500, 2000) == 2000
    assert kld_count(3, 0.05, 0.99, 500, 2000) == 500
    assert kld_count(400, 0.05, 0.99, 500, 2000) == 2000
    a = 2 / (9 * 49)
    expected = math.ceil(49 / 0.1 * (1 - a + math.sqrt(a) * 0.99) ** 3)
    assert kld_count(50, 0.05, 0.99, 500, 2000) == expected


def test_clusters_are_connected_components() -> None:
    for seed in range(5):
        particles = cloud(seed)
        keys, entry, label, stack = tables(len(particles))
        bins, _ = filled(particles, keys, entry)
        count = label_clusters(bins, keys, entry, label, stack, HEADINGS)
        slow = clusters_slowly(particles)
        assert count == len(np.unique(slow))
        place = {int(keys[k]): int(label[k]) for k in entry[:bins]}
        mine = []
        for row in particles:
            one, at = tables(1)[:2]
            filled(row[np.newaxis], one, at)
            mine.append(place[int(one[at[0]])])
        assert len(set(zip(mine, slow.tolist(), strict=True))) == count


def test_estimate_is_the_mean_of_the_heaviest_cluster() -> None:
    particles = cloud(3)
    n = len(particles)
    keys, entry, label, stack = tables(n)
    bins, places = filled(particles, keys, entry)
    slow = clusters_slowly(particles)
    weight = particles[:, 3]
    best = max(np.unique(slow), key=lambda k: weight[slow == k].sum())
    for whole, chosen in ((False, slow == best), (True, np.ones(n, dtype=bool))):
        mean, cov = np.empty(3), np.empty((3, 3))
        estimate(
            particles, n, whole, keys, entry[:bins], places, label, stack, HEADINGS, np.empty(n),
            mean, cov,
        )  # fmt: skip
        w, p = weight[chosen], particles[chosen]
        assert np.allclose(mean[:2], np.average(p[:, :2], axis=0, weights=w))
        heading = np.angle(np.average(np.exp(1j * p[:, 2]), weights=w))
        assert abs(float(turned(mean[2] - heading))) < 1e-9
        off = particles[:, :3] - mean
        off[:, 2] = turned(off[:, 2])
        assert np.allclose(cov, (off * weight[:, np.newaxis]).T @ off / weight.sum())
    assert math.hypot(mean[0], mean[1]) > 0.0


def test_bins_are_alike_anywhere_on_earth() -> None:
    """National grids go beyond a million metres on either side of zero."""
    particles = cloud(4)
    results = []
    for offset in ((0.0, 0.0), (-740_000.0, -1_040_000.0), (500_000.0, 5_400_000.0)):
        moved = particles.copy()
        moved[:, :2] += offset
        keys, entry, label, stack = tables(len(moved))
        bins, places = filled(moved, keys, entry)
        clusters = label_clusters(bins, keys, entry, label, stack, HEADINGS)
        mean, cov = np.empty(3), np.empty((3, 3))
        sums = np.empty(len(moved))
        estimate(
            moved, len(moved), False, keys, entry[:bins], places, label, stack, HEADINGS, sums,
            mean, cov,
        )  # fmt: skip
        results.append((bins, clusters, *(mean[:2] - offset), mean[2], *cov.ravel()))
    np.testing.assert_allclose(results[1:], [results[0]] * 2, atol=1e-6)


def test_clusters_reach_across_the_end_of_the_bins() -> None:
    particles = np.zeros((2, 5))
    particles[:, 0] = 2.0**20 / 2.0 + np.array([-0.1, 0.1])
    particles[:, 1] = -(2.0**20) + np.array([-0.1, 0.1])
    keys, entry, label, stack = tables(2)
    assert filled(particles, keys, entry)[0] == 2
    assert label_clusters(2, keys, entry, label, stack, HEADINGS) == 1


def test_squares_far_apart_do_not_hide_each_other() -> None:
    """The neighbour of the first bin, where there is none, shares its bits with the last's."""
    particles = np.zeros((3, 5))
    particles[:, 0] = 0.25 + 0.5 * np.array([WINDOW - 1, 1, 0])
    particles[:, 1:3] = 0.1
    keys, entry, label, stack = tables(3)
    assert filled(particles, keys, entry)[0] == 3
    assert label_clusters(3, keys, entry, label, stack, HEADINGS) == 2
