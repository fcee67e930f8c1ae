"""Update of one run's particle filter, as in AMCL: the kernels of Monte Carlo localization.

For other kernels: the whole filter of run r is one call without Python,

    updated = update_run(r, x, y, theta, ranges, model, cast, state)

with the odometry pose (x, y, theta) (metres, radians, any fixed frame), the readings `ranges`
(float32 or float64, shape (B,), in the scanner's order of beams, inf no echo, -inf too near, nan no
reading), and `localizer.model` and `localizer.cast` (named tuples, read only, shared by all runs;
without rays the latter is None, see `filter_tables`) and `localizer.state` (arrays with one row
each a run, written in place). It returns whether the filter took the scan in. Estimate and
covariance are then in state.mean[r] (3,) and state.covariance[r] (3, 3), whether it did or not:
between two updates they move along with odometry. Runs share nothing, so calls for different r may
run at the same time. A filter starts with `localizer.start(...)` or, in a kernel, `start_run` and
`start_run_globally`.

What follows AMCL is named in `MclParameters`. Four things are done otherwise, on purpose: the
averages of augmented recovery are of the mean likelihood of the particles that were not just put
anywhere (AMCL takes all, and divides by their number once more, so that the averages jump when KLD
changes that number); the covariance couples heading and position; between two updates the
covariance grows with odometry; and recovery goes on until the likelihood is back
(`MclParameters.recovery_reset`).
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.localization.beam_model import beam_factors
from ambinav.localization.bins import estimate, fill_bins
from ambinav.localization.filter_state import BEAM_PRODUCT, BEAM_SUM, FIELD_PRODUCT
from ambinav.localization.intensity import surface_fits
from ambinav.localization.likelihood_field import field_factors
from ambinav.localization.localizability_filter import localizability_filtered
from ambinav.localization.odometry import (
    apply_motion,
    apply_motions,
    deviations,
    motion_between,
    spread_motion,
    wrapped,
)
from ambinav.localization.random import normal_columns
from ambinav.localization.resampling import random_pose, resample
from ambinav.runtime.kernels import kernel

# Largest share of the particles that recovery puts anywhere at once. Likelihoods that are sums
# differ by a factor of five at most: with more of them, those that were right would be swamped.
MOST_ANEW = 0.25
# Particles moved at once: their errors stay in the first cache.
BLOCK = 256


@kernel
def start_run(r, mean, root, model, state):
    """Spread run r's particles: normal about `mean` (3,), with covariance root root^T (3, 3)."""
    particles, error = state.particles[r], np.empty((4, model.most))
    normal_columns(state.random[r], error)
    for i in range(model.most):
        a, b, c = error[0, i], error[1, i], error[2, i]
        for k in range(3):
            particles[i, k] = mean[k] + root[k, 0] * a + root[k, 1] * b + root[k, 2] * c
        particles[i, 2] = wrapped(particles[i, 2])
        particles[i, 3] = 1.0 / model.most
        particles[i, 4] = 0.0
    begin(r, model, state)


@kernel
def start_run_globally(r, model, state):
    """Spread run r's particles over the free space."""
    particles = state.particles[r]
    for i in range(model.most):
        particles[i, 0], particles[i, 1], particles[i, 2] = random_pose(
            model.areas, model.corner, state.random[r]
        )
        particles[i, 3] = 1.0 / model.most
        particles[i, 4] = 0.0
    begin(r, model, state)


@kernel(_nrt=False)
def begin(r, model, state):
    """Reset run r's history, as its particles are new."""
    state.number[r] = model.most
    state.averages[r, 0] = state.averages[r, 1] = 0.0
    state.ticks[r, 0] = state.ticks[r, 1] = 0
    bins = fill_bins(
        state.particles[r], model.most, state.keys[r], state.entry[r], state.places[r],
        state.found[r],
    )  # fmt: skip
    update_estimate(r, bins, model, state)


@kernel(_nrt=False)
def update_estimate(r, bins, model, state):
    """Compute run r's estimate from its particles, which are already sorted into bins."""
    estimate(
        state.particles[r], state.number[r], model.mean_of_all, state.keys[r],
        state.entry[r, :bins], state.places[r], state.label[r], state.stack[r], state.headings[r],
        state.sums[r], state.base[r], state.base_covariance[r],
    )  # fmt: skip
    for i in range(3):
        state.mean[r, i] = state.base[r, i]
        for j in range(3):
            state.covariance[r, i, j] = state.base_covariance[r, i, j]


@kernel
def weigh(particles, count, ranges, model, cast, scratch, channel, intensities):
    """Multiply the weights by the likelihood of a scan; `channel` as in `update_run`.

    Returns the logarithm that they were divided by, nan if no beam says anything.
    """
    beams = model.beam.size
    far = model.far
    fits = np.empty((0 if channel is None else beams, 2))
    if channel is not None:
        surface_fits(ranges, intensities, model.beam, channel, fits)
    if cast is not None and model.kind >= BEAM_SUM:
        reading, least, has_reading = np.empty(beams), np.zeros(beams), False
        for b in range(beams):
            z = ranges[model.beam[b]]
            if model.kind == BEAM_PRODUCT:
                least[b] = max(model.near[b], 0.0)
            elif z <= model.near[b]:
                # AMCL knows no smallest range: what is too near counts as out of range.
                z = far[b]
            reading[b] = min(max(z, least[b]), far[b])
            if math.isnan(z):
                reading[b] = math.nan
            has_reading |= not math.isnan(z)
        base = beam_factors(
            particles, count, reading, least, far, model.z_hit, model.z_short, model.z_max,
            model.z_rand, model.sigma_hit, model.lambda_short, cast, model.table,
            model.kind == BEAM_PRODUCT, model.power, scratch, channel, fits,
        )  # fmt: skip
        return base if has_reading else math.nan
    end, floor = np.empty((beams, 2)), np.empty(beams)
    used = 0
    for b in range(beams):
        z = ranges[model.beam[b]]
        if z > model.near[b] and z < far[b]:
            end[used, 0] = model.mount[b, 0] + z * model.mount[b, 2]
            end[used, 1] = model.mount[b, 1] + z * model.mount[b, 3]
            floor[used] = model.z_rand / far[b]
            if channel is not None:
                fits[used, 0], fits[used, 1] = fits[b, 0], fits[b, 1]
            used += 1
    if used == 0:
        return math.nan
    return field_factors(
        particles, count, end, floor, used, model.z_hit, model.hits, model.field_x, model.field_y,
        model.inverse, model.smooth, model.kind == FIELD_PRODUCT, model.power, scratch, channel,
        fits,
    )  # fmt: skip


@kernel
def update_run(r, x, y, theta, ranges, model, cast, state, channel=None, intensities=None):
    """Update the filter of run r with one odometry pose and one scan; see the module.

    `cast` may be None where no rays are cast: with a likelihood field and without `trust`.
    `channel` is the localizer's own, with `intensities` beside the ranges, shape (B,), nan where
    there are none; or None.

    Returns whether the scan was used, see `is_due`.
    """
    if not is_due(r, x, y, theta, model, state):
        carry_along(r, x, y, theta, model, state)
        return False
    move_particles(r, x, y, theta, model, state)
    particles, count = state.particles[r], state.number[r]
    prior = kept_weight(particles, count)
    # `spare` is free until the particles are drawn anew.
    places, inliers, filtered = particles, ranges, False
    if cast is not None and model.trust > 0.0:
        inliers = np.empty_like(ranges)
        filtered = localizability_filtered(
            particles, count, ranges, model, cast, state.spare[r], inliers
        )
        places, inliers = (state.spare[r], inliers) if filtered else (particles, ranges)
    scale = weigh(places, count, inliers, model, cast, state.sums[r], channel, intensities)
    if filtered:
        for i in range(count):
            particles[i, 3] = places[i, 3]
    take_in(r, prior, scale, model, state)
    return True


@kernel(_nrt=False)
def is_due(r, x, y, theta, model, state):
    """Return whether run r takes in a scan at an odometry pose.

    The first after a start always is taken in, a later one if the robot has moved far enough since
    the last.
    """
    if state.ticks[r, 0] == 0:
        return True
    anchor = state.anchor[r]
    # As in AMCL, along each axis of the odometry frame by itself.
    moved = max(abs(x - anchor[0]), abs(y - anchor[1])) > model.update_d
    return moved or abs(wrapped(theta - anchor[2])) > model.update_a


@kernel(_nrt=False)
def carry_along(r, x, y, theta, model, state):
    """Move run r's estimate along with odometry, from where the last scan was taken in."""
    anchor, base, mean = state.anchor[r], state.base[r], state.mean[r]
    rot1, trans, rot2 = motion_between(anchor[0], anchor[1], anchor[2], x, y, theta)
    mean[0], mean[1], mean[2] = apply_motion(base[0], base[1], base[2], rot1, trans, rot2)
    for i in range(3):
        for j in range(3):
            state.covariance[r, i, j] = state.base_covariance[r, i, j]
    spread_motion(state.covariance[r], base[2], rot1, trans, rot2, model.alpha)


@kernel
def move_particles(r, x, y, theta, model, state):
    """Move run r's particles, each with its own errors, to an odometry pose that is due."""
    particles, anchor = state.particles[r], state.anchor[r]
    if state.ticks[r, 0] == 0:
        state.ticks[r, 0] = 1
    else:
        rot1, trans, rot2 = motion_between(anchor[0], anchor[1], anchor[2], x, y, theta)
        sd1, sd_trans, sd2 = deviations(rot1, trans, rot2, model.alpha)
        errors = np.empty((4, BLOCK))
        for first in range(0, state.number[r], BLOCK):
            last = min(first + BLOCK, state.number[r])
            error = errors[:, : last - first]
            normal_columns(state.random[r], error)
            for i in range(last - first):
                error[0, i] *= sd1
                error[1, i] *= sd_trans
                error[2, i] *= sd2
            apply_motions(particles[first:last], rot1, trans, rot2, error[0], error[1], error[2])
    anchor[0], anchor[1], anchor[2] = x, y, theta


@kernel(_nrt=False)
def kept_weight(particles, count):
    """Return the weight of the particles that were not just put anywhere.

    Those that were put anywhere by the last resampling are unlikely by nature: they would hold the
    averages down, and so call for more of themselves.
    """
    kept = 0.0
    for i in range(count):
        kept += particles[i, 3] * (1.0 - particles[i, 4])
    return kept


@kernel(_nrt=False)
def take_in(r, prior, scale, model, state):
    """Finish an update of run r, whose particles have just been weighed.

    Args:
        r: Which run.
        prior: `kept_weight` before.
        scale: What the weighing returned, see `weigh`.
        model: See the module.
        state: See there.
    """
    particles, count = state.particles[r], state.number[r]
    total = kept = 0.0
    for i in range(count):
        total += particles[i, 3]
        kept += particles[i, 3] * (1.0 - particles[i, 4])
    # Without any likelihood left, all particles are alike (as in AMCL).
    usable = total > 0.0 and total < math.inf
    for i in range(count):
        particles[i, 3] = particles[i, 3] / total if usable else 1.0 / count
    if usable and prior > 0.0 and not math.isnan(scale):
        likelihood = kept / prior * math.exp(scale)
        average = state.averages[r]
        if average[0] == 0.0:
            average[0] = average[1] = likelihood
        else:
            average[0] += model.slow * (likelihood - average[0])
            average[1] += model.fast * (likelihood - average[1])
    state.ticks[r, 1] += 1
    if state.ticks[r, 1] % model.interval == 0:
        bins = renew(r, model, state)
    else:
        bins = fill_bins(
            particles, count, state.keys[r], state.entry[r], state.places[r], state.found[r]
        )
    update_estimate(r, bins, model, state)


@kernel(_nrt=False)
def renew(r, model, state):
    """Resample run r, partly at random if the likelihood has fallen; return its number of bins.

    Augmented MCL: Probabilistic Robotics, table 8.3.
    """
    average = state.averages[r]
    share = 0.0
    if average[0] > 0.0:
        share = max(0.0, 1.0 - average[1] / average[0])
    if not model.reset:
        share = min(share, MOST_ANEW)
    drawn, bins = resample(
        state.particles[r], state.number[r], state.spare[r], model.method, share, model.error,
        model.quantile, model.least, model.most, model.areas, model.corner, state.random[r],
        state.sums[r], state.stack[r], state.keys[r], state.entry[r], state.places[r],
        state.label[r], state.found[r],
    )  # fmt: skip
    if share > 0.0 and model.reset:
        average[0] = average[1] = 0.0
    # Not as whole arrays, here and elsewhere: the message for shapes that differ takes seconds to
    # compile.
    for i in range(drawn):
        for k in range(5):
            state.particles[r, i, k] = state.spare[r, i, k]
    state.number[r] = drawn
    return bins
