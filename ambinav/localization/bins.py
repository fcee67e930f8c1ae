"""Histogram bins of particles, to find the number of particles needed, and clusters.

The bins are AMCL's: half a metre by half a metre by ten degrees. Headings are counted round the
circle, so that a cluster that looks along -x is one and not two.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.localization.odometry import wrapped
from ambinav.localization.sine_cosine import sine_cosine
from ambinav.runtime.kernels import kernel

# Bins per metre and per turn.
PER_METRE = 2.0
HEADINGS = 36
# Bins in x and in y. After so many, a million metres, they begin again.
SIDE = 1 << 21
# Squares of half a metre along the side of a window, beyond which `label_clusters` notes which
# headings they have beside those of squares elsewhere: a power of two.
WINDOW = 16


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
    if bins <= 1 or least == most:
        return most
    a = 2.0 / (9.0 * (bins - 1))
    x = 1.0 - a + math.sqrt(a) * quantile
    wanted = math.ceil((bins - 1) / (2.0 * error) * x * x * x)
    return int(min(max(wanted, least), most))


@kernel(_nrt=False)
def find_bins(particles, count, found):
    """Write the bin of each particle: a loop of its own, many particles at a time."""
    for i in range(count):
        found[i] = bin_of(particles[i, 0], particles[i, 1], particles[i, 2])


@kernel(_nrt=False)
def fill_bins(particles, count, keys, entry, places, found):
    """Sort particles into bins.

    Args:
        particles: x, y, theta and more, shape (M, ...).
        count: How many of them.
        keys: Hash table, int64, written: the bin in each entry, -1 for none.
        entry: Written, int32, shape (M,): the entries in use, in order of first use.
        places: Written, int32, shape (M,): the entry of each particle's bin.
        found: Work space, int64, shape (M,).

    Returns:
        How many bins are occupied.
    """
    find_bins(particles, count, found)
    keys[:] = -1
    bins = 0
    for i in range(count):
        key = found[i]
        k = place_of(key, keys)
        places[i] = k
        if keys[k] < 0:
            keys[k] = key
            entry[bins] = k
            bins += 1
    return bins


@kernel(inline="always")
def _square(north, east):
    """Return the row of `headings` in `label_clusters` that a square has, with others far away."""
    return (north & (WINDOW - 1)) * WINDOW + (east & (WINDOW - 1))


@kernel(_nrt=False)
def label_clusters(bins, keys, entry, label, stack, headings):
    """Join neighbouring bins (3 x 3 x 3) into clusters, as AMCL does.

    Args:
        bins: How many bins are occupied.
        keys: See `fill_bins`.
        entry: See `fill_bins`.
        label: Written, int32, as long as `keys`: cluster of each entry in use.
        stack: Work space, int32, shape (M,).
        headings: Work space, int64, shape (2, WINDOW^2).

    Returns:
        How many clusters there are; they are numbered by their first particle.
    """
    # A bit for each heading of a square that has a bin without a label: few of the 27 need to be
    # searched. Where two squares share their bits, those stay when a bin is labelled.
    headings[:] = 0
    alone = True
    for j in range(bins):
        label[entry[j]] = -1
        heading, cell = keys[entry[j]] % HEADINGS, keys[entry[j]] // HEADINGS
        square = _square(cell // SIDE, cell % SIDE)
        alone &= headings[0, square] == 0 or headings[1, square] == cell
        headings[0, square] |= 1 << heading
        headings[1, square] = cell
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
            for row in range(-1, 2):
                for column in range(-1, 2):
                    square = _square(north + row, east + column)
                    there = headings[0, square]
                    place = ((north + row) & (SIDE - 1)) * SIDE + ((east + column) & (SIDE - 1))
                    if there == 0 or (alone and headings[1, square] != place):
                        continue
                    for turn in range(-1, 2):
                        other = (heading + turn + HEADINGS) % HEADINGS
                        if (there >> other) & 1 == 0:
                            continue
                        k = place_of(place * HEADINGS + other, keys)
                        if keys[k] >= 0 and label[k] < 0:
                            label[k] = clusters
                            stack[depth] = k
                            depth += 1
                        if alone:
                            headings[0, square] &= ~(1 << other)
        clusters += 1
    return clusters


@kernel(_nrt=False)
def estimate(
    particles, count, all_particles, keys, entry, places, label, stack, headings, sums, mean, cov
):  # fmt: skip
    """Compute the heaviest cluster's mean pose, and the covariance of all particles about it.

    Args:
        particles: x, y, theta, weight, shape (M, ...); the weights need not sum to 1.
        count: How many of them.
        all_particles: Take the mean of all particles instead.
        keys: Filled by `fill_bins` from the same particles, with `entry` and `places`.
        entry: (bins,) entries in use, see `fill_bins`.
        places: See `fill_bins`.
        label: Work space, int32, as long as `keys`.
        stack: Work space, int32, shape (M,).
        headings: Work space, see `label_clusters`.
        sums: Work space, float64, shape (M,).
        mean: Written, shape (3,): metres and radians.
        cov: Written, shape (3, 3): second moment of all particles about `mean`, heading
            differences wrapped. AMCL too reports the spread of all particles beside the mean of
            one cluster, but without the terms that couple the heading with the position.
    """
    best = 0
    if all_particles:
        stack[:count] = best
    else:
        clusters = label_clusters(entry.size, keys, entry, label, stack, headings)
        sums[:clusters] = 0.0
        for i in range(count):
            stack[i] = label[places[i]]
            sums[stack[i]] += particles[i, 3]
        best = int(np.argmax(sums[:clusters]))
    mean[0], mean[1], mean[2] = _mean(particles, count, stack, best)
    xx, xy, xt, yy, yt, tt = _moments(particles, count, mean[0], mean[1], mean[2])
    cov[0, 0], cov[1, 1], cov[2, 2] = xx, yy, tt
    cov[0, 1], cov[0, 2], cov[1, 2] = xy, xt, yt
    cov[1, 0], cov[2, 0], cov[2, 1] = xy, xt, yt


# The sums may be made in any order, so the compiler takes several particles at a time.
@kernel(_nrt=False, fastmath={"reassoc"})
def _mean(particles, count, cluster, which):
    """Return the weighted mean pose of the particles of one cluster."""
    total = x = y = c = s = 0.0
    for i in range(count):
        w = particles[i, 3] if cluster[i] == which else 0.0
        sine, cosine = sine_cosine(particles[i, 2])
        total += w
        x += w * particles[i, 0]
        y += w * particles[i, 1]
        c += w * cosine
        s += w * sine
    return x / total, y / total, math.atan2(s, c)


@kernel(_nrt=False, fastmath={"reassoc"})
def _moments(particles, count, x, y, theta):
    """Return the weighted second moments xx, xy, xt, yy, yt, tt of particles about a pose."""
    total = xx = xy = xt = yy = yt = tt = 0.0
    for i in range(count):
        w = particles[i, 3]
        dx, dy, dt = particles[i, 0] - x, particles[i, 1] - y, wrapped(particles[i, 2] - theta)
        total += w
        xx += w * dx * dx
        xy += w * dx * dy
        xt += w * dx * dt
        yy += w * dy * dy
        yt += w * dy * dt
        tt += w * dt * dt
    return xx / total, xy / total, xt / total, yy / total, yt / total, tt / total
