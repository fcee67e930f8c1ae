"""A Kalman filter on the ranges themselves: what a drive knows of its pose, and what it will know.

For other kernels: `odometry.spread_motion` and `apply_motion`, then `update_pose`, are one step of
the filter.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables, cast_tables, work_space
from ambinav.localization.information import (
    BeamNoise,
    as_map_std,
    as_poses,
    beam_lines,
    beam_noise,
    informations,
)
from ambinav.localization.odometry import (
    OdometryModel,
    apply_motion,
    motion_between,
    spread_motion,
    wrapped,
)
from ambinav.sensing.fields import as_count, as_number
from ambinav.sensing.scanner import RangeScanner

Floats = NDArray[np.float64]

# Steps of the iterated update.
ROUNDS = 4


class ExtendedKalmanFilter:
    """Pose tracking by an extended Kalman filter on the ranges, for any number of runs at once.

    It needs to know about where it starts, and holds one place for true: a reference for what a
    localizer can know, and a prediction of it, rather than a localizer for lost robots.

    Args:
        environment: The map that the robot has.
        scanner: Its scanner.
        odometry: How odometry errs; None: AMCL's defaults.
        runs: How many robots are localized side by side.
        map_std: As in `information.scan_information`.
        gate: Beams that are off by more than so many standard deviations of what is expected
            (pose uncertainty included) are left out: people, open doors.

    Raises:
        InputError: an argument cannot be used.
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        odometry: OdometryModel | None = None,
        *,
        runs: int = 1,
        map_std: float | None = None,
        gate: float = 3.0,
    ) -> None:
        self.scanner = scanner
        self.odometry = OdometryModel() if odometry is None else odometry
        self.runs = as_count(runs, "runs")
        self.gate = as_number(gate, "gate")
        if self.gate <= 0.0:
            raise InputError(f"gate is {gate}; give standard deviations above 0.")
        self.cast: CastTables = cast_tables(environment, scanner, np.arange(scanner.beams))
        self.noise: BeamNoise = beam_noise(environment, scanner, as_map_std(environment, map_std))
        self._mean = np.full((self.runs, 3), np.nan)
        self._covariance = np.full((self.runs, 3, 3), np.nan)
        self._odometry: Floats | None = None

    def start(self, poses: ArrayLike, covariance: ArrayLike) -> None:
        """Begin at poses (R, 3) or (3,), known up to a covariance (3, 3) or (R, 3, 3)."""
        mean, cov = np.asarray(poses, dtype=float), np.asarray(covariance, dtype=float)
        for values, name, shape in ((mean, "poses", (3,)), (cov, "covariance", (3, 3))):
            if values.shape not in (shape, (self.runs, *shape)) or not np.isfinite(values).all():
                raise InputError(
                    f"{name}: the shape is {values.shape}; give finite numbers of shape "
                    f"{(self.runs, *shape)} for {self.runs} runs."
                )
        self._mean[:] = mean
        self._covariance[:] = cov
        self._odometry = None

    def update(self, odometry: ArrayLike, ranges: ArrayLike) -> NDArray[np.int64]:
        """Move on to an odometry pose and take in the scan made there.

        Args:
            odometry: Poses in the odometry frame, shape (R, 3), or (3,) for one run.
            ranges: Readings, shape (R, B), or (B,) for one run: inf no echo, -inf too near, nan
                no reading.

        Returns:
            How many beams each run has used, shape (R,).

        Raises:
            InputError: a shape does not fit, a pose is not finite, or the filter is not started.
        """
        if np.isnan(self._mean).any():
            raise InputError("the filter has no pose; call start first.")
        now = as_poses(odometry, "odometry")
        readings = np.atleast_2d(np.asarray(ranges, dtype=np.float64))
        if now.shape != (self.runs, 3) or readings.shape != (self.runs, self.scanner.beams):
            raise InputError(
                f"odometry and ranges have the shapes {now.shape} and {readings.shape}; give "
                f"{(self.runs, 3)} and {(self.runs, self.scanner.beams)}."
            )
        before = now if self._odometry is None else self._odometry
        used = np.empty(self.runs, dtype=np.int64)
        _steps(
            self._mean, self._covariance, before, now, np.ascontiguousarray(readings),
            self.odometry.array, self.gate, self.cast, self.noise, used,
        )  # fmt: skip
        self._odometry = now.copy()
        return used

    @property
    def mean(self) -> Floats:
        """Estimated pose of each run, shape (R, 3), metres and radians, map frame."""
        return self._mean.copy()

    @property
    def covariance(self) -> Floats:
        """Its covariance, shape (R, 3, 3)."""
        return self._covariance.copy()

    def predicted_covariances(
        self, poses: ArrayLike, covariance: ArrayLike, seen: ArrayLike | None = None
    ) -> Floats:
        """Covariances along a route, before it is driven.

        Args:
            poses: Along the route, shape (N, 3), as far apart as the scans.
            covariance: At the first of them, before its scan, shape (3, 3).
            seen: At which poses a scan is made, bool, shape (N,); None: at all.

        Returns:
            Shape (N, 3, 3), after the scan of each pose; the runs play no part in it.

        Raises:
            InputError: a shape does not fit, or a pose is not finite.
        """
        rows = as_poses(poses, "poses")
        first = np.asarray(covariance, dtype=np.float64)
        looks = np.ones(len(rows), dtype=np.bool_) if seen is None else np.asarray(seen, dtype=bool)
        if first.shape != (3, 3) or looks.shape != (len(rows),):
            raise InputError(
                f"covariance and seen have the shapes {first.shape} and {looks.shape}; give (3, 3) "
                f"and ({len(rows)},)."
            )
        told = np.empty((len(rows), 3, 3))
        informations(rows, self.cast, self.noise, told)
        told[~looks] = 0.0
        out = np.empty_like(told)
        _foretell(rows, first, told, self.odometry.array, out)
        return out


@njit(cache=True, nogil=True, error_model="numpy")
def posterior(cov, told):
    """Replace a covariance P by (P^-1 + told)^-1 = P (I + told P)^-1; P may be singular."""
    new = cov @ np.linalg.inv(np.eye(3) + told @ cov)
    cov[:] = (new + new.T) / 2.0


@njit(cache=True, nogil=True, error_model="numpy")
def update_pose(mean, cov, reading, gate, cast, noise):
    """Take one scan into an estimate (3,) and its covariance (3, 3), in place.

    The update is iterated (Bell & Cathey 1993, "The iterated Kalman filter update as a
    Gauss-Newton method"): ranges to slanted walls and past corners are not linear over a few
    centimetres, and one step would be surer of itself than it may be.

    Args:
        mean: x, y, theta, written.
        cov: Written.
        reading: Of each beam, shape (B,), metres; inf no echo, -inf too near, nan none.
        gate: Standard deviations of the residual beyond which a beam is left out.
        cast: See `casting.CastTables`.
        noise: See `BeamNoise`.

    Returns:
        How many beams were used.
    """
    beams = noise.far.size
    ranges = np.empty(beams)
    ray = np.empty(beams, dtype=np.int32)
    edge = np.empty(beams, dtype=np.int32)
    line = np.empty((beams, 5))
    work = work_space(cast.cosine.size)
    told, pull = np.empty((3, 3)), np.empty(3)
    prior, spread, at = mean.copy(), cov.copy(), mean.copy()
    used = 0
    for _ in range(ROUNDS):
        beam_lines(at[0], at[1], at[2], cast, noise, work, ranges, ray, edge, line)
        told[:] = 0.0
        pull[:] = 0.0
        used = 0
        bx, by, bt = at[0] - prior[0], at[1] - prior[1], wrapped(at[2] - prior[2])
        for b in range(beams):
            z = reading[b]
            if not (math.isfinite(z) and line[b, 4] < math.inf):
                continue
            off = z - line[b, 0]
            expected = line[b, 4]
            for i in range(3):
                for j in range(3):
                    expected += line[b, 1 + i] * spread[i, j] * line[b, 1 + j]
            if off * off > gate * gate * expected:
                continue
            used += 1
            # The residual that the prior would have were the range linear from here on.
            off += line[b, 1] * bx + line[b, 2] * by + line[b, 3] * bt
            for i in range(3):
                pull[i] += line[b, 1 + i] * off / line[b, 4]
                for j in range(3):
                    told[i, j] += line[b, 1 + i] * line[b, 1 + j] / line[b, 4]
        spread[:] = cov
        posterior(spread, told)
        for i in range(3):
            at[i] = prior[i] + spread[i, 0] * pull[0] + spread[i, 1] * pull[1]
            at[i] += spread[i, 2] * pull[2]
        at[2] = wrapped(at[2])
    mean[:] = at
    cov[:] = spread
    return used


@njit(cache=True, nogil=True, error_model="numpy")
def _steps(mean, cov, before, now, readings, alpha, gate, cast, noise, used):
    for r in range(mean.shape[0]):
        rot1, trans, rot2 = motion_between(
            before[r, 0], before[r, 1], before[r, 2], now[r, 0], now[r, 1], now[r, 2]
        )
        spread_motion(cov[r], mean[r, 2], rot1, trans, rot2, alpha)
        mean[r, 0], mean[r, 1], mean[r, 2] = apply_motion(
            mean[r, 0], mean[r, 1], mean[r, 2], rot1, trans, rot2
        )
        used[r] = update_pose(mean[r], cov[r], readings[r], gate, cast, noise)


@njit(cache=True, nogil=True, error_model="numpy")
def _foretell(poses, first, told, alpha, out):
    cov = first.copy()
    for k in range(poses.shape[0]):
        if k > 0:
            rot1, trans, rot2 = motion_between(
                poses[k - 1, 0], poses[k - 1, 1], poses[k - 1, 2],
                poses[k, 0], poses[k, 1], poses[k, 2],
            )  # fmt: skip
            spread_motion(cov, poses[k - 1, 2], rot1, trans, rot2, alpha)
        posterior(cov, told[k])
        out[k] = cov
