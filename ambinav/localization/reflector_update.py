"""Update of a pose by the reflectors of a scan: matching, and the Kalman filter.

Beams are a step s apart, so the direction is off by a deviation of s / sqrt(12); if a cluster
misses more than two steps of the reflector's width w, part of it is hidden, and the direction is
off by that of (w - extent) / sqrt(12). On a slanted strip the range errs along with it.

The extended Kalman filter with landmarks is that of Thrun, Burgard and Fox 2005, "Probabilistic
Robotics", section 7.4 (table 7.2, with unknown correspondences 7.5). A detection may be of a
reflector if the squared Mahalanobis distance of range and bearing is below a quantile of chi-square
with two degrees of freedom (individual compatibility: Neira and Tardos 2001, "Data association in
stochastic mapping using the joint compatibility test", IEEE Transactions on Robotics and Automation
17, section II). What may be several is not used, until others have made the pose more precise.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ambinav.localization.ekf_update import posterior
from ambinav.localization.odometry import wrapped
from ambinav.localization.reflector_detection import (
    BEARING,
    COLUMNS,
    EXTENT,
    RANGE,
    SIZE,
    VARIANCE,
    detect_reflectors,
)
from ambinav.localization.reflector_view import (
    BB,
    BEARING_BY,
    BR,
    DISTANCE,
    MIDDLE,
    RANGE_BY,
    ROUGH,
    RR,
    SLOPE,
    VIEW,
    WIDTH,
    expect,
    times,
)
from ambinav.runtime.kernels import kernel

WIDER: Final = 1.1
"""A cluster is of a reflector if it is no wider than this multiple of it, and half a step,"""
LEAST: Final = 0.3
"""and if its beams cover at least this share of it."""
PASSES: Final = 3
"""Number of times that matches are looked for, each time from a better pose."""


@kernel
def update_by_reflectors(mean, cov, ranges, intensities, seen, reflectors, used):
    """Update the poses of R robots with a scan each, in place.

    Args:
        mean: Poses, shape (R, 3), metres and radians, map frame.
        cov: Their covariances, shape (R, 3, 3).
        ranges: Readings, shape (R, B), metres.
        intensities: Beside them, shape (R, B); nan for none.
        seen: Which reflectors may be in view from each pose, shape (R, L).
        reflectors: See `reflector_view.ReflectorMap`.
        used: Written, int64, shape (R,): how many reflectors were used.
    """
    beams = reflectors.beams
    detections = np.empty((beams.beam.size, COLUMNS))
    views = np.empty((seen.shape[1], VIEW))
    for r in range(mean.shape[0]):
        used[r] = 0
        for h in range(beams.step.size):
            count = detect_reflectors(
                h, ranges[r], intensities[r], beams, reflectors.noise, detections
            )
            used[r] += _match_and_update(
                mean[r], cov[r], h, detections[:count], seen[r], views, reflectors
            )


@kernel
def _match_and_update(mean, cov, h, detections, seen, views, reflectors):
    """Update with one head's detections; return how many reflectors were used."""
    left, free = seen.copy(), np.ones(len(detections), dtype=np.bool_)
    match, rivals = np.empty(seen.size, dtype=np.int64), np.empty(seen.size, dtype=np.int64)
    claims = np.empty(len(detections), dtype=np.int64)
    used = 0
    for _ in range(PASSES):
        rivals[:] = 0
        claims[:] = 0
        for k in range(seen.size):
            if left[k] and expect(mean, cov, h, k, reflectors, views[k]):
                for d in range(claims.size):
                    if free[d] and _residual(views[k], detections[d], h, reflectors)[0]:
                        match[k] = d
                        rivals[k] += 1
                        claims[d] += 1
        before = used
        for k in range(seen.size):
            if rivals[k] != 1 or claims[match[k]] != 1:
                continue
            d = match[k]
            # From the pose after the matches so far, so that they are compatible jointly.
            if not expect(mean, cov, h, k, reflectors, views[k]):
                continue
            fits, off, away, bb, br, rr = _residual(views[k], detections[d], h, reflectors)
            if fits:
                _update(mean, cov, views[k], off, away, bb, br, rr)
                left[k] = free[d] = False
                used += 1
        if used == before:
            break
    return used


@kernel
def _residual(view, detection, h, reflectors):
    """Return whether a detection may be of a reflector, its residuals, and their noise.

    Returns:
        The answer; residual of the bearing (radians) and of the range (metres); their variances,
        the covariance in between, without those by the pose.
    """
    step = reflectors.beams.step[h]
    off = wrapped(detection[BEARING] - view[MIDDLE])
    away = detection[RANGE] - view[DISTANCE]
    missing = view[WIDTH] - detection[EXTENT]
    comb = max(step, missing if missing > 2.0 * step else 0.0) ** 2 / 12.0
    place, slope = reflectors.place, view[SLOPE]
    bb, br = comb + place / (view[DISTANCE] * view[DISTANCE]), slope * comb
    rr = slope * slope * comb + detection[VARIANCE] + view[ROUGH] / detection[SIZE] + place
    sb, sc, sr = view[BB] + bb, view[BR] + br, view[RR] + rr
    square = (off * off * sr - 2.0 * off * away * sc + away * away * sb) / (sb * sr - sc * sc)
    fits = detection[EXTENT] <= WIDER * view[WIDTH] + 0.5 * step
    fits &= detection[SIZE] * step >= LEAST * view[WIDTH]
    return fits and square <= reflectors.gate, off, away, bb, br, rr


@kernel
def _update(mean, cov, view, off, away, bb, br, rr):
    """Update a pose and its covariance with a range and a bearing, in place."""
    scale = bb * rr - br * br
    # Inverse of the noise times the derivatives, and the sum that is the information.
    weighted, information = np.empty((2, 3)), np.empty((3, 3))
    for i in range(3):
        b, r = view[BEARING_BY + i], view[RANGE_BY + i]
        weighted[0, i], weighted[1, i] = (rr * b - br * r) / scale, (bb * r - br * b) / scale
    for i in range(3):
        for j in range(3):
            information[i, j] = view[BEARING_BY + i] * weighted[0, j]
            information[i, j] += view[RANGE_BY + i] * weighted[1, j]
    posterior(cov, information)
    gx, gy, gt = weighted[0] * off + weighted[1] * away
    dx, dy, dt = times(cov, gx, gy, gt)
    mean[0], mean[1], mean[2] = mean[0] + dx, mean[1] + dy, wrapped(mean[2] + dt)
