"""Localizer interface of a drive, and the simplest localizer: dead reckoning."""

from __future__ import annotations

from typing import Protocol, cast

import numpy as np

from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints


class Localizer(Protocol):
    """Estimator of the poses of R runs at once.

    After each call of `update` its mean and covariance are of that moment: between the scans that
    it takes in they move along with odometry.
    """

    @property
    def mean(self) -> Floats:
        """Estimated poses of the robots, shape (R, 3), metres and radians, map frame."""

    @property
    def covariance(self) -> Floats:
        """Covariance of the estimated poses, shape (R, 3, 3)."""

    def start(self, poses: Floats, covariance: Floats) -> object:
        """Start at poses, shape (R, 3), with a covariance, shape (3, 3)."""

    def update(self, odometry: Floats, ranges: Floats32) -> Bools | Ints:
        """Update with odometry poses, (R, 3), odometry frame, and readings, (R, B).

        Returns:
            Which runs took readings in, or how many of them, shape (R,).
        """


class IntensityLocalizer(Localizer, Protocol):
    """Localizer that may use intensities beside the ranges."""

    @property
    def reads_intensities(self) -> bool:
        """True if it uses intensities; if not, it is never given any."""

    def update(
        self, odometry: Floats, ranges: Floats32, intensities: Floats32 | None = None
    ) -> Bools | Ints:
        """Update as a `Localizer` does, with intensities of the readings, (R, B), nan for none."""


def reads_intensities(localizer: Localizer) -> bool:
    """Return whether a localizer uses intensities: an `IntensityLocalizer` that declares it."""
    return bool(getattr(localizer, "reads_intensities", False))


def updated(
    localizer: Localizer, odometry: Floats, ranges: Floats32, intensities: Floats32 | None
) -> Bools:
    """Update a localizer; return which runs used the readings, (R,).

    Intensities are passed where there are any.
    """
    if intensities is None:
        return np.asarray(localizer.update(odometry, ranges), dtype=np.bool_)
    reader = cast("IntensityLocalizer", localizer)
    return np.asarray(reader.update(odometry, ranges, intensities), dtype=np.bool_)


class DeadReckoning:
    """Localizer without sensors: its estimate is the start moved along with odometry.

    Args:
        noise: What is known of the odometry's errors; biases are not known.
        runs: R.
    """

    def __init__(self, noise: OdometryNoise, runs: int) -> None:
        self._noise = noise
        self._odometry: Floats | None = None
        self._mean = np.zeros((runs, 3))
        self._covariance = np.zeros((runs, 3, 3))

    @property
    def mean(self) -> Floats:
        """Estimated poses of the robots, shape (R, 3)."""
        return self._mean

    @property
    def covariance(self) -> Floats:
        """Covariance of the estimated poses, shape (R, 3, 3)."""
        return self._covariance

    def start(self, poses: Floats, covariance: Floats) -> None:
        """Start at poses, shape (R, 3), with a covariance, shape (3, 3)."""
        self._odometry = None
        self._mean = np.array(poses)
        self._covariance = np.tile(covariance, (len(poses), 1, 1))

    def update(self, odometry: Floats, ranges: Floats32) -> Bools:
        """Move along with odometry poses, shape (R, 3); the readings are ignored.

        Returns:
            True for each run, bool, shape (R,).
        """
        if self._odometry is not None:
            before = self._odometry
            self._covariance = self._noise.spread(self._mean, self._covariance, before, odometry)
            self._mean = compose_motion(self._mean, before, odometry)
        self._odometry = odometry.copy()
        return np.ones(len(odometry), dtype=np.bool_)


def compose_motion(poses: Floats, before: Floats, after: Floats) -> Floats:
    """Move poses as odometry moved from before to after; all of shape (R, 3)."""
    turn = poses[:, 2] - before[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    dx, dy = (after - before)[:, :2].T
    heading = poses[:, 2] + after[:, 2] - before[:, 2]
    return np.column_stack(
        [poses[:, 0] + c * dx - s * dy, poses[:, 1] + s * dx + c * dy, wrap_angles(heading)]
    )
