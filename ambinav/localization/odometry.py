"""Error model of odometry: the differential drive model of AMCL.

Between two odometry poses the robot turns by `rot1`, drives `trans` and turns by `rot2`, and each
of the three is off by a normal deviation (Thrun, Burgard & Fox 2005, "Probabilistic Robotics",
tables 5.5 and 5.6):

    var rot1  = alpha1 rot1^2 + alpha2 trans^2
    var trans = alpha3 trans^2 + alpha4 (rot1^2 + rot2^2)
    var rot2  = alpha1 rot2^2 + alpha2 trans^2

With two amendments of nav2 (nav2_amcl, differential_motion_model.cpp): a motion of less than a
centimetre has no direction, so that all of its turn is rot2; and in the variances a turn counts
by how far it is from 0 or from half a turn, whichever is nearer, so that driving backward is as
exact as driving forward.

This is what a localizer believes of odometry, under AMCL's names for it. How the simulated robot's
odometry truly errs, and what planners predict with, is `ambinav.drive.noise.OdometryNoise`; its
`modelled` gives the model here of a localizer that knows the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import NonNegative, as_array, as_arrays, check_fields
from ambinav.localization.random import normals
from ambinav.localization.sine_cosine import sine_cosine
from ambinav.runtime.array_types import Floats, UInts
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel

# Below this distance in metres a motion counts as turning on the spot.
ON_THE_SPOT = 0.01


@dataclass(frozen=True, kw_only=True)
class OdometryModel:
    """Error shares of AMCL's differential model, as a localizer assumes them.

    Attributes:
        alpha1: Variance of a turn by the square of that turn.
        alpha2: Variance of a turn by the square of the distance, 1 / m^2.
        alpha3: Variance of the distance by the square of the distance.
        alpha4: Variance of the distance by the square of the turns, m^2.
        alpha5: Variance of a sideways slip; as in AMCL, a differential drive has none and it
            stays unused.

    Raises:
        InputError: one of them is negative or not a number.
    """

    alpha1: NonNegative = 0.2
    alpha2: NonNegative = 0.2
    alpha3: NonNegative = 0.2
    alpha4: NonNegative = 0.2
    alpha5: NonNegative = 0.2

    def __post_init__(self) -> None:
        """Check that each value is a valid share."""
        check_fields(self)

    @property
    def array(self) -> Floats:
        """Parameters for the kernels: alpha1 to alpha4."""
        return np.array([self.alpha1, self.alpha2, self.alpha3, self.alpha4])

    def moved(self, poses: ArrayLike, before: ArrayLike, after: ArrayLike) -> Floats:
        """Move poses by the exact motion that odometry reports, shape (N, 3).

        Args:
            poses: Where the robots are, shape (N, 3), map frame.
            before: Odometry pose at that time, shape (3,) or (N, 3), odometry frame.
            after: Odometry pose now, likewise.

        Raises:
            InputError: the shapes do not match, as for the other two.
        """
        now, *odometry = _broadcast(poses, before, after)
        _moved(now, *odometry)
        return now

    def sampled(
        self, poses: ArrayLike, before: ArrayLike, after: ArrayLike, state: UInts
    ) -> Floats:
        """Move poses as `moved` does, each with its own errors, sampled with `state` (one row)."""
        now, *odometry = _broadcast(poses, before, after)
        _sampled(now, *odometry, self.array, state)
        return now

    def covariances(
        self, poses: ArrayLike, covariances: ArrayLike, before: ArrayLike, after: ArrayLike
    ) -> Floats:
        """Propagate covariances through the motion, to first order, shape (N, 3, 3).

        Args:
            poses: Before the motion, shape (N, 3).
            covariances: Before the motion, shape (N, 3, 3) or (3, 3).
            before: As in `moved`.
            after: As in `moved`.
        """
        now, *odometry = _broadcast(poses, before, after)
        shape = (len(now), 3, 3)
        out = as_array(covariances, "covariances", "(N, 3, 3)")
        if out.shape not in (shape, shape[1:]):
            raise InputError(f"covariances have the shape {out.shape}; give (3, 3) or {shape}.")
        out = np.array(np.broadcast_to(out, shape))
        _spread_all(now, out, *odometry, self.array)
        return out


def _broadcast(poses: ArrayLike, before: ArrayLike, after: ArrayLike) -> list[Floats]:
    shape, parts = as_arrays(poses=poses, before=before, after=after)
    if len(shape) > 2 or shape[-1:] != (3,):
        raise InputError(
            f"poses, before and after have the shape {shape}; give x, y, theta, (N, 3)."
        )
    return [np.array(np.broadcast_to(part, shape)).reshape(-1, 3) for part in parts]


@kernel(inline="always")
def wrapped(angle):
    """Wrap an angle to [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def motion_between(x0, y0, t0, x1, y1, t1):
    """Return turn, distance and turn (rot1, trans, rot2) from one pose to another.

    A motion that is too short to have a direction is one ahead, or, below 0, back.
    """
    dx, dy = x1 - x0, y1 - y0
    trans = math.sqrt(dx * dx + dy * dy)
    if trans < ON_THE_SPOT:
        ahead = dx * math.cos(t0) + dy * math.sin(t0)
        return 0.0, math.copysign(trans, ahead), wrapped(t1 - t0)
    rot1 = wrapped(math.atan2(dy, dx) - t0)
    return rot1, trans, wrapped(t1 - t0 - rot1)


@kernel
def deviations(rot1, trans, rot2, alpha):
    """Return deviations of rot1 (rad), trans (m), rot2 (rad); `alpha` holds alpha1 to 4."""
    turn1 = min(abs(rot1), math.pi - abs(rot1))
    turn2 = min(abs(rot2), math.pi - abs(rot2))
    square = trans * trans
    return (
        math.sqrt(alpha[0] * turn1 * turn1 + alpha[1] * square),
        math.sqrt(alpha[2] * square + alpha[3] * (turn1 * turn1 + turn2 * turn2)),
        math.sqrt(alpha[0] * turn2 * turn2 + alpha[1] * square),
    )


@kernel
def apply_motion(x, y, t, rot1, trans, rot2):
    """Return the pose after a turn, a straight piece and a turn; heading in [-pi, pi)."""
    bearing = t + rot1
    return x + trans * math.cos(bearing), y + trans * math.sin(bearing), wrapped(bearing + rot2)


@kernel
def sample_motion(x, y, t, rot1, trans, rot2, sd1, sd_trans, sd2, state):
    """Apply a motion as `apply_motion` does, each part with a sampled error."""
    a, b = normals(state)
    c, _ = normals(state)
    return apply_motion(x, y, t, rot1 + sd1 * a, trans + sd_trans * b, rot2 + sd2 * c)


@kernel
def apply_motions(particles, rot1, trans, rot2, turn1, straight, turn2):
    """Apply a motion as `apply_motion` does to n poses, each with errors of its own, in place.

    Args:
        particles: x, y, theta and more, shape (n, ...), written.
        rot1: Of the motion, as the next two.
        trans: See there.
        rot2: See there.
        turn1: Error of rot1 of each, shape (n,); overwritten, as the next two.
        straight: Error of trans.
        turn2: Error of rot2.
    """
    n = particles.shape[0]
    for i in range(n):
        turn1[i] = particles[i, 2] + (rot1 + turn1[i])
        turn2[i] = wrapped(turn1[i] + (rot2 + turn2[i]))
    for i in range(n):
        length = trans + straight[i]
        s, c = sine_cosine(turn1[i])
        straight[i], turn1[i] = length * s, length * c
    for i in range(n):
        particles[i, 0] += turn1[i]
        particles[i, 1] += straight[i]
        particles[i, 2] = turn2[i]


@kernel
def spread_motion(cov, t, rot1, trans, rot2, alpha):
    """Propagate a covariance (3, 3) along a motion from heading t, in place.

    P' = G P G^T + V M V^T with G and V the derivatives of the motion by the pose and by
    (rot1, trans, rot2), M the variances of those three (Probabilistic Robotics, section 7.4).
    """
    sd1, sd_trans, sd2 = deviations(rot1, trans, rot2, alpha)
    c, s = math.cos(t + rot1), math.sin(t + rot1)
    gx, gy = -trans * s, trans * c
    # G P, row by row, then (G P) G^T, column by column: G adds the heading's row to x and y.
    for j in range(3):
        cov[0, j] += gx * cov[2, j]
        cov[1, j] += gy * cov[2, j]
    for i in range(3):
        cov[i, 0] += gx * cov[i, 2]
        cov[i, 1] += gy * cov[i, 2]
    v1, vt, v2 = sd1 * sd1, sd_trans * sd_trans, sd2 * sd2
    cov[0, 0] += v1 * gx * gx + vt * c * c
    cov[1, 1] += v1 * gy * gy + vt * s * s
    cov[2, 2] += v1 + v2
    xy, xt, yt = v1 * gx * gy + vt * c * s, v1 * gx, v1 * gy
    cov[0, 1] += xy
    cov[1, 0] += xy
    cov[0, 2] += xt
    cov[2, 0] += xt
    cov[1, 2] += yt
    cov[2, 1] += yt


@kernel
def _moved(poses, before, after):
    for i in range(poses.shape[0]):
        rot1, trans, rot2 = motion_between(
            before[i, 0], before[i, 1], before[i, 2], after[i, 0], after[i, 1], after[i, 2]
        )
        poses[i, 0], poses[i, 1], poses[i, 2] = apply_motion(
            poses[i, 0], poses[i, 1], poses[i, 2], rot1, trans, rot2
        )


@kernel
def _sampled(poses, before, after, alpha, state):
    for i in range(poses.shape[0]):
        rot1, trans, rot2 = motion_between(
            before[i, 0], before[i, 1], before[i, 2], after[i, 0], after[i, 1], after[i, 2]
        )
        sd1, sd_trans, sd2 = deviations(rot1, trans, rot2, alpha)
        poses[i, 0], poses[i, 1], poses[i, 2] = sample_motion(
            poses[i, 0], poses[i, 1], poses[i, 2], rot1, trans, rot2, sd1, sd_trans, sd2, state
        )


@kernel
def _spread_all(poses, covariances, before, after, alpha):
    for i in range(poses.shape[0]):
        rot1, trans, rot2 = motion_between(
            before[i, 0], before[i, 1], before[i, 2], after[i, 0], after[i, 1], after[i, 2]
        )
        spread_motion(covariances[i], poses[i, 2], rot1, trans, rot2, alpha)
