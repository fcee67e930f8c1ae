"""Particle filter that relies on odometry where the scan has no information: an `mcl` kernel.

The idea of the localizability-based particle filter (Qian, Ma, Dai & Fang 2016; Wang, Chen, Wang &
Wang 2014; we could read their abstracts, not their formulas) is to correct what odometry predicts,
with covariance P, only along directions of which the scan tells something, by the localizability
matrix F. We take the gain of a linear estimator,

    x = x_odometry + K (x_scan - x_odometry),    K = P (P + F^-1)^-1 = (P^-1 + F)^-1 F

so that along directions of which the scan tells nothing (F small) odometry is kept. On particles it
acts so: a particle
x_i, predicted by odometry with all others about their mean m, gets the likelihood of the scan not
at x_i but at

    x_i' = m + K (x_i - m)

so that along such directions all particles look alike, and the scan cannot choose among them.
Likelihoods of particle filters are not calibrated (AMCL's are sums of cubes), so that they choose
by chance matches too: unmapped furniture that looks like a mapped corner. Where the filter goes
without the scan, P grows until F P is about 1, and the scan counts again: the price is at most
about the deviation F^(-1/2) that one scan has.

F is taken at m, its readings weighed with P in their variance (`dynamic_objects.share_of_map`): a
filter that is off by what it expects to be off by does not distrust the scans that would bring it
back.
Readings that are rather not of the map than of it count neither in F nor in the likelihood, as
Qian et al. leave out those that hit people; missing echoes count as ever.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.localization.casting import work_space
from ambinav.localization.dynamic_objects import weighted_information
from ambinav.localization.ekf_update import posterior
from ambinav.localization.odometry import wrapped
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel

# Beyond these deviations of the particles (metres along any direction, radians) one linear model
# at their mean stands for none of them: the scan is then taken as it is.
MOST_PLACE, MOST_HEADING = 1.0, 0.5
# A reading counts if its probability of being explained by the map exceeds one half.
LIKELY = 0.5
# With a smaller share of the expected echoes than this it is rather the pose that is wrong than
# the map, and a filter that used nothing else would never find that out.
LEAST_EXPLAINED = 0.2


@kernel
def cloud(particles, count, mean, spread):
    """Return mean and covariance of particles not just injected, and whether any are left.

    Args:
        particles: x, y, theta, weight and whether it was put anywhere, shape (M, 5).
        count: How many there are.
        mean: Written, shape (3,).
        spread: Written, shape (3, 3).
    """
    total = x = y = co = si = 0.0
    for i in range(count):
        w = particles[i, 3] * (1.0 - particles[i, 4])
        total += w
        x += w * particles[i, 0]
        y += w * particles[i, 1]
        co += w * math.cos(particles[i, 2])
        si += w * math.sin(particles[i, 2])
    if not total > 0.0:
        return False
    mean[0], mean[1], mean[2] = x / total, y / total, math.atan2(si, co)
    spread[:] = 0.0
    off = np.empty(3)
    for i in range(count):
        w = particles[i, 3] * (1.0 - particles[i, 4]) / total
        off[0], off[1] = particles[i, 0] - mean[0], particles[i, 1] - mean[1]
        off[2] = wrapped(particles[i, 2] - mean[2])
        for j in range(3):
            for k in range(3):
                spread[j, k] += w * off[j] * off[k]
    return True


@kernel
def localizability_filtered(particles, count, ranges, model, cast, out, inliers):
    """Write to `out` the poses at which the particles are weighed, and their weights.

    Args:
        particles: As for `cloud`; not written.
        count: How many there are.
        ranges: Readings of all beams of the scanner.
        model: See `FilterModel`; its `trust` blends between K (1) and none of this (0).
        cast: See `casting.CastTables`.
        out: Written, shape (M, 5).
        inliers: Written, as `ranges`: nan where a reading is not of the map.

    Returns:
        Whether it was done: not where the particles are no single cloud (`MOST_PLACE`), nor where
        hardly a reading fits it (`LEAST_EXPLAINED`).
    """
    mean, spread = np.empty(3), np.empty((3, 3))
    if not cloud(particles, count, mean, spread):
        return False
    half = (spread[0, 0] - spread[1, 1]) / 2.0
    largest = (spread[0, 0] + spread[1, 1]) / 2.0 + math.hypot(half, spread[0, 1])
    if largest > MOST_PLACE * MOST_PLACE or spread[2, 2] > MOST_HEADING * MOST_HEADING:
        return False
    beams = model.beam.size
    reading, weight = np.empty(beams), np.empty(beams)
    for b in range(beams):
        z = ranges[model.beam[b]]
        reading[b] = math.inf if z >= model.far[b] else (z if z > model.near[b] else -math.inf)
        if math.isnan(z):
            reading[b] = math.nan
    information, line = np.empty((3, 3)), np.empty((beams, 5))
    ray, edge = np.empty(beams, dtype=np.int32), np.empty(beams, dtype=np.int32)
    weighted_information(
        mean[0], mean[1], mean[2], reading, spread, model.z_hit, model.z_short, model.z_rand,
        model.lambda_short, LIKELY, cast, model.noise, work_space(cast.cosine.size),
        np.empty(beams), ray, edge, line, weight, information,
    )  # fmt: skip
    copy_into(inliers, ranges)
    expected = explained = 0
    for b in range(beams):
        expected += not math.isnan(weight[b])
        explained += weight[b] >= LIKELY
        if weight[b] < LIKELY and reading[b] < model.noise.far[b]:
            inliers[model.beam[b]] = math.nan
    if explained < LEAST_EXPLAINED * expected:
        return False
    posterior(spread, information)
    gain = model.trust * (spread @ information)
    for k in range(3):
        gain[k, k] += 1.0 - model.trust
    for i in range(count):
        copy_into(out[i], particles[i])
        if particles[i, 4] == 0.0:
            dx, dy = particles[i, 0] - mean[0], particles[i, 1] - mean[1]
            dt = wrapped(particles[i, 2] - mean[2])
            for k in range(3):
                out[i, k] = mean[k] + gain[k, 0] * dx + gain[k, 1] * dy + gain[k, 2] * dt
    return True
