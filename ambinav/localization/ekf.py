"""Extended Kalman filter on ranges, to track a pose and to predict its covariance.

It takes in directions of reflectors as well, where intensities tell them (`tag_bearings`);
`predicted_covariances` foresees ranges alone.

For other kernels: `odometry.spread_motion` and `apply_motion`, then `ekf_update.update_pose`, are
one step of the filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_count, as_positive
from ambinav.geometry.environment import Environment
from ambinav.localization.ekf_update import posterior, refine, scratch_for, tabulate, update_pose
from ambinav.localization.information import (
    BeamNoise,
    as_covariances,
    as_map_std,
    as_poses,
    beam_noise,
    informations,
    ray_caster,
)
from ambinav.localization.intensity import beside_ranges
from ambinav.localization.mesh_rays import MeshRays
from ambinav.localization.odometry import OdometryModel, apply_motion, motion_between, spread_motion
from ambinav.localization.tag_bearings import tag_model, take_in_tags
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner

# Steps of the iterated update.
ROUNDS = 4


class ExtendedKalmanFilter:
    """Extended Kalman filter on ranges that tracks the poses of any number of runs.

    It needs to know about where it starts, and holds one pose for true: a reference for what a
    localizer can know, and a prediction of it, rather than a localizer for lost robots.

    Args:
        environment: The map that the robot has.
        scanner: Its scanner.
        odometry: How odometry errs; None: AMCL's defaults.
        runs: How many robots are localized side by side.
        map_std: As in `information.scan_information`.
        gate: Beams that deviate by more than this number of standard deviations of what is expected
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
        self.gate = as_positive(gate, "gate", "standard deviations")
        self.cast = ray_caster(environment, scanner, np.arange(scanner.beams))
        deviation = as_map_std(environment, map_std)
        self.noise: BeamNoise = beam_noise(environment, scanner, deviation)
        self.tags = tag_model(environment, scanner, deviation)
        self._mean = np.full((self.runs, 3), np.nan)
        self._covariance = np.full((self.runs, 3, 3), np.nan)
        self._odometry: Floats | None = None

    def start(self, poses: ArrayLike, covariance: ArrayLike) -> None:
        """Start at poses (R, 3) or (3,), with a covariance (3, 3) or (R, 3, 3)."""
        mean = np.asarray(poses, dtype=np.float64)
        if mean.shape not in ((3,), (self.runs, 3)) or not np.isfinite(mean).all():
            raise InputError(
                f"poses: the shape is {mean.shape}; give finite numbers of shape "
                f"{(self.runs, 3)} for {self.runs} runs."
            )
        self._covariance[:] = as_covariances(covariance, "covariance", self.runs)
        self._mean[:] = mean
        self._odometry = None

    @property
    def reads_intensities(self) -> bool:
        """True if `update` uses intensities: it needs a channel, and reflectors on the map."""
        return self.tags is not None

    def update(
        self, odometry: ArrayLike, ranges: ArrayLike, intensities: ArrayLike | None = None
    ) -> Ints:
        """Move to an odometry pose and use the scan made there.

        Args:
            odometry: Poses in the odometry frame, shape (R, 3), or (3,) for one run.
            ranges: Readings, shape (R, B), or (B,) for one run: inf no echo, -inf too near, nan
                no reading.
            intensities: Beside them, of the same shape, nan for none; None: of no beam. They tell
                the directions of reflectors (`tag_bearings`).

        Returns:
            How many beams each run has used, and how many reflectors, together, shape (R,).

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
        tags = None if intensities is None else self.tags
        beside = beside_ranges(tags, intensities, readings)
        readings = np.ascontiguousarray(readings)
        if isinstance(self.cast, MeshRays):
            _move_runs(self._mean, self._covariance, before, now, self.odometry.array)
            self._update_in_mesh(self.cast, readings, used)
        else:
            update_runs(
                self._mean, self._covariance, before, now, readings, self.odometry.array,
                self.gate, self.cast, self.noise, used, tags, beside,
            )  # fmt: skip
        self._odometry = now.copy()
        return used

    def _update_in_mesh(self, cast: MeshRays, readings: Floats, used: Ints) -> None:
        """Use scans in a mesh, whose rays are cast between the steps of the iterated update."""
        about, spread = self._mean.copy(), self._covariance.copy()
        for _ in range(ROUNDS):
            distance, face = cast.cast(about)
            _refine_runs(
                self._mean, self._covariance, readings, self.gate, cast.tables, self.noise,
                distance, face, about, spread, used,
            )  # fmt: skip
        self._mean, self._covariance = about, spread

    @property
    def mean(self) -> Floats:
        """Estimated pose of each run, shape (R, 3), metres and radians, map frame."""
        return self._mean.copy()

    @property
    def covariance(self) -> Floats:
        """Covariance of the estimated pose, shape (R, 3, 3)."""
        return self._covariance.copy()

    def predicted_covariances(
        self, poses: ArrayLike, covariance: ArrayLike, seen: ArrayLike | None = None
    ) -> Floats:
        """Predict covariances along a route before it is driven.

        Args:
            poses: Along the route, shape (N, 3), as far apart as the scans.
            covariance: At the first of them, before its scan, shape (3, 3).
            seen: At which poses a scan is made, bool, shape (N,); None: at all.

        Returns:
            Shape (N, 3, 3), after the scan of each pose; the runs play no part in it.

        Raises:
            InputError: a shape does not fit, a pose is not finite, or the covariance is none.
        """
        rows = as_poses(poses, "poses")
        (first,) = as_covariances(covariance, "covariance", 1)
        looks = np.ones(len(rows), dtype=np.bool_) if seen is None else np.asarray(seen, dtype=bool)
        if looks.shape != (len(rows),):
            raise InputError(f"seen has the shape {looks.shape}; give {(len(rows),)}.")
        information = np.empty((len(rows), 3, 3))
        informations(rows, self.cast, self.noise, information)
        information[~looks] = 0.0
        return covariances_along(rows, first, information, self.odometry)


def covariances_along(
    poses: Floats, covariance: Floats, information: Floats, odometry: OdometryModel
) -> Floats:
    """Compute covariances along a route from the information of each of its scans.

    Args:
        poses: Where scans are made, shape (N, 3).
        covariance: At the first of them, before its scan, shape (3, 3).
        information: Information of each scan, shape (N, 3, 3); 0 where none is made.
        odometry: How odometry errs.

    Returns:
        Shape (N, 3, 3), after each scan.
    """
    out = np.empty_like(information)
    _predict_covariances(poses, covariance, information, odometry.array, out)
    return out


@kernel
def update_runs(
    mean, cov, before, now, readings, alpha, gate, cast, noise, used, tags, intensities
):  # fmt: skip
    """Update the filters of R runs, see `ExtendedKalmanFilter.update`.

    Args:
        mean: Estimates, shape (R, 3), written.
        cov: Their covariances, shape (R, 3, 3), written.
        before: Odometry poses at the last update, shape (R, 3).
        now: Those now.
        readings: Shape (R, B), metres.
        alpha: `OdometryModel.array`.
        gate: See `ekf_update.update_pose`.
        cast: See `casting.CastTables`.
        noise: See `information.BeamNoise`.
        used: Written, int64, shape (R,): how many beams and reflectors each has used.
        tags: See `tag_bearings`; None to use no intensities.
        intensities: Shape (R, B), or (R, 0).
    """
    scratch = scratch_for(noise.far.size, cast.cosine.size)
    _move_runs(mean, cov, before, now, alpha)
    for r in range(mean.shape[0]):
        seen = 0
        if tags is not None:
            # Reflectors first: the ranges are then linearized about a better pose.
            seen = take_in_tags(mean[r], cov[r], readings[r], intensities[r], gate, tags)
        used[r] = seen + update_pose(
            mean[r], cov[r], readings[r], gate, ROUNDS, True, cast, noise, scratch
        )


@kernel
def _move_runs(mean, cov, before, now, alpha):
    """Move the estimates of R runs along with odometry; arguments as of `update_runs`."""
    for r in range(mean.shape[0]):
        rot1, trans, rot2 = motion_between(
            before[r, 0], before[r, 1], before[r, 2], now[r, 0], now[r, 1], now[r, 2]
        )
        spread_motion(cov[r], mean[r, 2], rot1, trans, rot2, alpha)
        mean[r, 0], mean[r, 1], mean[r, 2] = apply_motion(
            mean[r, 0], mean[r, 1], mean[r, 2], rot1, trans, rot2
        )


@kernel
def _refine_runs(mean, cov, readings, gate, tables, noise, distance, hit, about, spread, used):
    """Make one step of the update of R runs from what all rays meet at the poses `about`, (R, 3).

    Distances and hits have the shape (R, rays); for the others see `ekf_update.refine`.
    """
    scratch = scratch_for(noise.far.size, tables.cosine.size)
    _, _, lengths, edges, _ = scratch.cast
    for j in range(lengths.size):
        scratch.picked[j] = j
    for r in range(mean.shape[0]):
        copy_into(lengths, distance[r])
        copy_into(edges, hit[r])
        count = tabulate(about[r], lengths.size, readings[r], tables, noise, scratch)
        used[r] = refine(mean[r], cov[r], about[r], spread[r], gate, True, count, scratch)


@kernel
def _predict_covariances(poses, first, information, alpha, out):
    cov = first.copy()
    for k in range(poses.shape[0]):
        if k > 0:
            rot1, trans, rot2 = motion_between(
                poses[k - 1, 0], poses[k - 1, 1], poses[k - 1, 2],
                poses[k, 0], poses[k, 1], poses[k, 2],
            )  # fmt: skip
            spread_motion(cov, poses[k - 1, 2], rot1, trans, rot2, alpha)
        posterior(cov, information[k])
        copy_into(out[k], cov)
