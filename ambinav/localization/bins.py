"""Histogram bins of particles, to find the number of particles needed, and clusters.

The bins are AMCL's: half a metre by half a metre by ten degrees. Headings are counted round the
circle, so that a cluster that looks along -x is one and not two.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel

# Bins per metre and per turn.
PER_METRE = 2.0
HEADINGS = 36
# Bins in x and in y. After so many, a million metres, they begin again.
SIDE = 1 << 21


def table_size(particles: int) -> int:
    """Return a hash table's size for the particles' bins: a power of two, half empty."""
    return 1 << math.ceil(math.log2(2 * particles + 1))


@kernel(inline="always")
def bin_of(x, y, theta):
    """Return the bin of a pose as one number."""
    # Never negative, as an empty entry is, in whatever national grid the coordinates are.
    column = int(math.floor(x * PER_METRE)) & (SIDE - 1)
    row = int(math.floor(y * PER_METRE)) & (SIDE - 1)
    turn = theta / (2.0 * math.pi)
    heading = min(int((turn - math.floor(turn)) * HEADINGS), HEADINGS - 1)
    return (row * SIDE + column) * HEADINGS + heading


@kernel(inline="always")
def place_of(key, keys):
    """Return where the bin stands in the table, or the empty entry where it belongs."""
    mask = keys.size - 1
    mixed = key ^ (key >> 29)
    k = (mixed * 0x1E3779B97F4A7C15) >> 20 & mask
    while keys[k] >= 0 and keys[k] != key:
        k = (k + 1) & mask
    return k


@kernel(_nrt=False)
def kld_count(bins, error, quantile, least, most):
    """Compute the number of particles that this many occupied bins need.

    Fox (2003), "Adapting the sample size in particle filters through KLD-sampling", IJRR 22(12),
    eq. 7: with the Wilson-Hilferty approximation of the chi-square quantile. As in AMCL, a
    single bin asks for the most.
    """
    if bins <= 1:
        return most
    a = 2.0 / (9.0 * (bins - 1))
    x = 1.0 - a + math.sqrt(a) * quantile
    wanted = math.ceil((bins - 1) / (2.0 * error) * x * x * x)
    return int(min(max(wanted, least), most))


@kernel(_nrt=False)
def fill_bins(particles, count, keys, entry):
    """Sort particles into bins.

    Args:
        particles: x, y, theta and more, shape (M, ...).
        count: How many of them.
        keys: Hash table, int64, written: the bin in each entry, -1 for none.
        entry: Written, int32, shape (M,): the entries in use, in order of first use.

    Returns:
        How many bins are occupied.
    """
    keys[:] = -1
    bins = 0
    for i in range(count):
        key = bin_of(particles[i, 0], particles[i, 1], particles[i, 2])
        k = place_of(key, keys)
        if keys[k] < 0:
            keys[k] = key
            entry[bins] = k
            bins += 1
    return bins


@kernel(_nrt=False)
def label_clusters(bins, keys, entry, label, stack):
    """Join neighbouring bins (3 x 3 x 3) into clusters, as AMCL does.

    Args:
        bins: How many bins are occupied.
        keys: See `fill_bins`.
        entry: See `fill_bins`.
        label: Written, int32, as long as `keys`: cluster of each entry in use.
        stack: Work space, int32, shape (M,).

    Returns:
        How many clusters there are; they are numbered by their first particle.
    """
    for j in range(bins):
        label[entry[j]] = -1
    clusters = 0
    for j in range(bins):
        if label[entry[j]] >= 0:
            continue
        label[entry[j]] = clusters
        stack[0] = entry[j]
        depth = 1
        while depth > 0:
            depth -= 1
            key = keys[stack[depth]]
            heading, cell = key % HEADINGS, key // HEADINGS
            north, east = cell // SIDE, cell % SIDE
            for turn in range(-1, 2):
                other = (heading + turn + HEADINGS) % HEADINGS
                for row in range(-1, 2):
                    for column in range(-1, 2):
                        place = ((north + row) & (SIDE - 1)) * SIDE + ((east + column) & (SIDE - 1))
                        beside = place * HEADINGS + other
                        k = place_of(beside, keys)
                        if keys[k] >= 0 and label[k] < 0:
                            label[k] = clusters
                            stack[depth] = k
                            depth += 1
        clusters += 1
    return clusters


@kernel(_nrt=False)
def estimate(particles, count, all_particles, keys, entry, label, stack, sums, mean, cov):
    """Compute the heaviest cluster's mean pose, and the covariance of all particles about it.

    Args:
        particles: x, y, theta, weight, shape (M, ...); the weights need not sum to 1.
        count: How many of them.
        all_particles: Take the mean of all particles instead.
        keys: Filled by `fill_bins` from the same particles, with `entry`.
        entry: (bins,) entries in use, see `fill_bins`.
        label: Work space, int32, as long as `keys`.
        stack: Work space, int32, shape (M,).
        sums: Work space, float64, shape (M,).
        mean: Written, shape (3,): metres and radians.
        cov: Written, shape (3, 3): second moment of all particles about `mean`, heading
            differences wrapped. AMCL too reports the spread of all particles beside the mean of
            one cluster, but without the terms that couple the heading with the position.
    """
    best = -1
    if not all_particles:
        clusters = label_clusters(entry.size, keys, entry, label, stack)
        sums[:clusters] = 0.0
        for i in range(count):
            key = bin_of(particles[i, 0], particles[i, 1], particles[i, 2])
            stack[i] = label[place_of(key, keys)]
            sums[stack[i]] += particles[i, 3]
        best = int(np.argmax(sums[:clusters]))
    total = x = y = c = s = 0.0
    for i in range(count):
        if all_particles or stack[i] == best:
            w = particles[i, 3]
            total += w
            x += w * particles[i, 0]
            y += w * particles[i, 1]
            c += w * math.cos(particles[i, 2])
            s += w * math.sin(particles[i, 2])
    mean[0], mean[1], mean[2] = x / total, y / total, math.atan2(s, c)
    cov[:] = 0.0
    total = 0.0
    for i in range(count):
        w = particles[i, 3]
        dx, dy = particles[i, 0] - mean[0], particles[i, 1] - mean[1]
        turn = (particles[i, 2] - mean[2] + math.pi) / (2.0 * math.pi)
        dt = (turn - math.floor(turn)) * 2.0 * math.pi - math.pi
        total += w
        cov[0, 0] += w * dx * dx
        cov[0, 1] += w * dx * dy
        cov[0, 2] += w * dx * dt
        cov[1, 1] += w * dy * dy
        cov[1, 2] += w * dy * dt
        cov[2, 2] += w * dt * dt
    cov /= total
    cov[1, 0], cov[2, 0], cov[2, 1] = cov[0, 1], cov[0, 2], cov[1, 2]
