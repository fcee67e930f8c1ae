"""Simulated odometry: the motion, and errors that grow with the distance.

AMCL's model (`ambinav.localization.odometry`) gives the errors of one update: their deviation is
proportional to the motion, so it depends on how often one looks. A simulated robot moves in many
small steps, and its errors must not depend on their size: here the variances grow with the distance
(a Wiener process), such that after one update of the localizer, `distance` metres straight on or
`angle` radians on the spot, they are those of AMCL's model times the square of `scale`:

    var rot1 = var rot2 = scale^2 (alpha1 |turn| angle / 2 + alpha2 |trans| distance)
    var trans           = scale^2 (alpha3 |trans| distance + alpha4 |turn| angle)

and on the spot, where all of the turn is rot2, scale^2 alpha1 |turn| angle for that alone. Driving
straight on for L metres the heading's variance is 2 scale^2 alpha2 distance L, that of the
position along the path scale^2 alpha3 distance L, and across it 2/3 scale^2 alpha2 distance L^3.

This is the one model of how odometry errs. The belief planners predict with it; a localizer gets
the alphas of AMCL's own model, an `OdometryModel`, which `modelled` makes of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ambinav.config import NonNegative, Number, as_positive, check_fields
from ambinav.geometry.frames import wrap_angles
from ambinav.localization.odometry import OdometryModel, wrapped
from ambinav.localization.random import normals
from ambinav.runtime.array_types import Floats
from ambinav.runtime.kernels import kernel


class PackedNoise(NamedTuple):
    """Variances and biases for the kernels.

    Attributes:
        turn_turn: Variance of a turn per radian, radians.
        turn_trans: Variance of one of the two turns of a motion per metre, square radians a
            metre.
        trans_trans: Variance of the distance per metre, metres.
        trans_turn: Variance of the distance per radian, square metres a radian.
        bias_distance: As `OdometryNoise`.
        bias_turn: As `OdometryNoise`.
    """

    turn_turn: float
    turn_trans: float
    trans_trans: float
    trans_turn: float
    bias_distance: float
    bias_turn: float


@dataclass(frozen=True, kw_only=True)
class OdometryNoise:
    """Errors of a robot's odometry.

    Attributes:
        alpha1: As in AMCL: error of turns by turning.
        alpha2: Error of turns by driving, 1 / m^2.
        alpha3: Error of the distance by driving.
        alpha4: Error of the distance by turning, m^2.
        scale: Factor on the deviations given by the alphas. AMCL's defaults are
            meant to be wide: at a scale of 1 the heading wanders by 18 degrees in one metre. The
            default, 0.25, gives 4.5 degrees and 6 cm in a metre, a mediocre odometry.
        distance: Metres after which the variances are those of the alphas: AMCL's
            update_min_d.
        angle: The same for turns on the spot, radians: AMCL's update_min_a.
        bias_distance: Relative systematic error of every reported distance (worn wheels).
        bias_turn: Systematic drift of the heading to the left, radians per metre (unequal wheels).

    Raises:
        InputError: a number is not finite; or negative, the biases aside.
    """

    alpha1: NonNegative = 0.2
    alpha2: NonNegative = 0.2
    alpha3: NonNegative = 0.2
    alpha4: NonNegative = 0.2
    scale: NonNegative = 0.25
    distance: NonNegative = 0.25
    angle: NonNegative = 0.2
    bias_distance: Number = 0.0
    bias_turn: Number = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "odometry")

    @property
    def packed(self) -> PackedNoise:
        """Noise parameters for the kernels."""
        square = self.scale * self.scale
        return PackedNoise(
            square * self.alpha1 * self.angle,
            square * self.alpha2 * self.distance,
            square * self.alpha3 * self.distance,
            square * self.alpha4 * self.angle,
            self.bias_distance,
            self.bias_turn,
        )

    @property
    def modelled(self) -> OdometryModel:
        """Error model of a localizer with the true variances, in AMCL's form.

        They agree for updates every `distance` metres straight on, or `angle` radians on the spot;
        AMCL's alone depends on how often the localizer updates.
        """
        square = self.scale * self.scale
        return OdometryModel(
            alpha1=square * self.alpha1,
            alpha2=square * self.alpha2,
            alpha3=square * self.alpha3,
            alpha4=square * self.alpha4,
        )

    def modelled_every(self, distance: float, angle: float) -> OdometryModel:
        """Return `modelled` for a localizer that updates at other intervals.

        The variances here grow with the distance, those of AMCL's model with its square: a
        localizer that updates every 5 cm and is given the alphas of 25 cm assumes variances a
        fifth of the true ones.

        Args:
            distance: From one update to the next, straight on, metres, above 0.
            angle: The same on the spot, radians, above 0.

        Raises:
            InputError: one of them is not above 0.
        """
        model = self.modelled
        driving = self.distance / as_positive(distance, "distance", "metres")
        turning = self.angle / as_positive(angle, "angle", "radians")
        return OdometryModel(
            alpha1=turning * model.alpha1,
            alpha2=driving * model.alpha2,
            alpha3=driving * model.alpha3,
            alpha4=turning * model.alpha4,
        )

    def growth(self, distance: float) -> float:
        """Return the variance per metre of the position's worse direction, over metres ahead.

        For planners with a single deviation: straight ahead from a known pose, the larger of the
        variances that accumulate along the path and across it, m^2 / m.
        """
        noise = self.packed
        return max(noise.trans_trans, 2.0 / 3.0 * noise.turn_trans * distance * distance)

    def spread(self, poses: Floats, covariances: Floats, before: Floats, after: Floats) -> Floats:
        """Propagate dead-reckoning covariances by a motion, to first order, (N, 3, 3).

        Args:
            poses: Before the motion, shape (N, 3), map frame.
            covariances: Before the motion, shape (N, 3, 3).
            before: Odometry pose then, shape (N, 3).
            after: Odometry pose now, shape (N, 3).
        """
        noise = self.packed
        move = after - before
        trans = np.hypot(move[:, 0], move[:, 1])
        turn = np.abs(wrap_angles(move[:, 2]))
        moving = trans > 0.0
        # Turning on the spot it slips along its heading, as `sample_odometry` has it.
        turned = np.where(moving, np.arctan2(move[:, 1], move[:, 0]) - before[:, 2], 0.0)
        bearing = poses[:, 2] + turned
        c, s = np.cos(bearing), np.sin(bearing)
        first_variance = (
            noise.turn_turn * turn * np.where(moving, 0.5, 0.0) + noise.turn_trans * trans
        )
        both = noise.turn_turn * turn + 2.0 * noise.turn_trans * trans
        along = noise.trans_trans * trans + noise.trans_turn * turn
        # Derivatives of the pose after by the pose before, by the first turn and the distance.
        G = np.tile(np.eye(3), (len(move), 1, 1))
        G[:, 0, 2], G[:, 1, 2] = -trans * s, trans * c
        first = np.stack([-trans * s, trans * c, np.ones_like(trans)], axis=-1)
        straight = np.stack([c, s, np.zeros_like(trans)], axis=-1)
        out = G @ covariances @ G.transpose(0, 2, 1)
        out += first_variance[:, None, None] * first[:, :, None] * first[:, None, :]
        out += along[:, None, None] * straight[:, :, None] * straight[:, None, :]
        out[:, 2, 2] += both - first_variance
        return out


@kernel
def sample_odometry(ox, oy, ot, x0, y0, t0, x1, y1, t1, noise, state):
    """Sample the odometry pose after a true motion.

    Args:
        ox: Odometry pose before, metres, odometry frame.
        oy: The same.
        ot: The same, radians.
        x0: True pose before, metres, map frame.
        y0: The same.
        t0: The same, radians.
        x1: True pose after.
        y1: The same.
        t1: The same.
        noise: `OdometryNoise.packed`.
        state: State of the random numbers, one row; advanced by the same draws whatever the motion.
    """
    a, b = normals(state)
    c, _ = normals(state)
    dx, dy, turn = x1 - x0, y1 - y0, wrapped(t1 - t0)
    trans = math.sqrt(dx * dx + dy * dy)
    # Standing still is no motion, and turning on the spot has no first turn.
    first_variance = (
        noise.turn_turn * abs(turn) * (0.5 if trans > 0.0 else 0.0) + noise.turn_trans * trans
    )
    both = noise.turn_turn * abs(turn) + 2.0 * noise.turn_trans * trans
    first, second = math.sqrt(first_variance) * a, math.sqrt(both - first_variance) * b
    along = math.sqrt(noise.trans_trans * trans + noise.trans_turn * abs(turn)) * c
    bearing = ot + (math.atan2(dy, dx) - t0 if trans > 0.0 else 0.0) + first
    gone = trans * (1.0 + noise.bias_distance) + along
    turned = turn + first + second + noise.bias_turn * trans
    return ox + gone * math.cos(bearing), oy + gone * math.sin(bearing), wrapped(ot + turned)


@kernel
def sample_ground(speed, rate, dt, noise, state):
    """Sample the ground speed and turn rate of a robot whose wheels turn exactly as measured.

    The mirror of `sample_odometry`: odometry is exact about the wheels and the motion errs, with
    the same variances and biases of what odometry reports from the true motion. A step is one arc,
    so half of its turn precedes its translation.

    Args:
        speed: That of the wheels, metres per second.
        rate: The same, radians per second.
        dt: The time step, seconds.
        noise: `OdometryNoise.packed`.
        state: State of the random numbers, one row; advanced by the same draws whatever the motion.
    """
    a, b = normals(state)
    trans, turn = abs(speed) * dt, abs(rate) * dt
    along = math.sqrt(noise.trans_trans * trans + noise.trans_turn * turn) * a
    turned = math.sqrt(noise.turn_turn * turn + 2.0 * noise.turn_trans * trans) * b
    ground = speed / (1.0 + noise.bias_distance)
    return ground + along / dt, rate - noise.bias_turn * abs(ground) + turned / dt


@kernel
def propagate_covariance(mean, cov, ox0, oy0, ot0, ox1, oy1, ot1, noise):
    """Propagate an estimate (3,) and its covariance (3, 3) by odometry, in place.

    `OdometryNoise.spread` for one pose; biases are unknown to it.

    Args:
        mean: x, y, theta, written.
        cov: Written.
        ox0: Odometry pose before, metres, odometry frame.
        oy0: The same.
        ot0: The same, radians.
        ox1: Odometry pose now.
        oy1: The same.
        ot1: The same.
        noise: `OdometryNoise.packed`.
    """
    dx, dy, turned = ox1 - ox0, oy1 - oy0, wrapped(ot1 - ot0)
    trans, turn = math.sqrt(dx * dx + dy * dy), abs(turned)
    bearing = mean[2] + (math.atan2(dy, dx) - ot0 if trans > 0.0 else 0.0)
    c, s = math.cos(bearing), math.sin(bearing)
    first_variance = (
        noise.turn_turn * turn * (0.5 if trans > 0.0 else 0.0) + noise.turn_trans * trans
    )
    both = noise.turn_turn * turn + 2.0 * noise.turn_trans * trans
    along = noise.trans_trans * trans + noise.trans_turn * turn
    # How the position moves with the heading; G adds the heading's row to x and y.
    gx, gy = -trans * s, trans * c
    xt, yt, tt = cov[0, 2], cov[1, 2], cov[2, 2]
    cov[0, 0] += 2.0 * gx * xt + gx * gx * (tt + first_variance) + along * c * c
    cov[1, 1] += 2.0 * gy * yt + gy * gy * (tt + first_variance) + along * s * s
    cov[0, 1] += gx * yt + gy * xt + gx * gy * (tt + first_variance) + along * c * s
    cov[0, 2] = xt + gx * (tt + first_variance)
    cov[1, 2] = yt + gy * (tt + first_variance)
    cov[2, 2] = tt + both
    cov[1, 0], cov[2, 0], cov[2, 1] = cov[0, 1], cov[0, 2], cov[1, 2]
    mean[0] += trans * c
    mean[1] += trans * s
    mean[2] = wrapped(mean[2] + turned)
