"""Replay of a log through a localizer, and errors of its estimates against the log's poses."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from ambinav.drive.localizers import Localizer
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION
from ambinav.geometry.frames import wrap_angles
from ambinav.logs.log import Log
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True)
class ReplayErrors:
    """Errors over all scans and runs: metres and radians.

    Attributes:
        position_median: Median distance from the log's pose.
        position_95: 95th percentile of it.
        position_max: Largest.
        heading_median: Median absolute difference of heading.
        heading_95: 95th percentile of it.
        heading_max: Largest.
    """

    position_median: float
    position_95: float
    position_max: float
    heading_median: float
    heading_95: float
    heading_max: float


@dataclass(frozen=True, eq=False)
class Replay:
    """Result of a localizer on a log.

    Attributes:
        log: The log.
        estimates: float64, shape (R, S, 3): estimated pose of the robot at each scan, map frame.
        updated: bool, shape (R, S): whether the localizer used the scan.
        seconds: Time that the localizer took for all.
    """

    log: Log
    estimates: Floats
    updated: Bools
    seconds: float

    @property
    def position_error(self) -> Floats:
        """Distance of each estimate from the log's pose, metres, shape (R, S).

        Raises:
            InputError: the log has no poses.
        """
        apart = self.estimates[..., :2] - self.log.required_poses()[:, :2]
        return np.asarray(np.hypot(apart[..., 0], apart[..., 1]), dtype=np.float64)

    @property
    def heading_error(self) -> Floats:
        """Estimated heading minus that of the log's pose, radians in [-pi, pi), shape (R, S).

        Raises:
            InputError: the log has no poses.
        """
        return wrap_angles(self.estimates[..., 2] - self.log.required_poses()[:, 2])

    @property
    def lost(self) -> Bools:
        """Mask of scans where the robot is lost, shape (R, S).

        It is off by 0.5 m or 30 degrees in two consecutive scans.

        As in `ambinav.drive.metrics`, but counted in scans, since time stamps may be useless: a
        single one is an outlier that the next scan has put right.

        Raises:
            InputError: the log has no poses.
        """
        off = self.position_error > LOST_POSITION
        off |= np.abs(self.heading_error) > LOST_HEADING
        lost = np.zeros_like(off)
        on_end = off[:, 1:] & off[:, :-1]
        lost[:, 1:] |= on_end
        lost[:, :-1] |= on_end
        return lost

    def aligned(self) -> Replay:
        """Return the replay with each run's estimates moved rigidly onto the log's poses.

        Turned and shifted (not scaled) so that the squared distances are smallest (Umeyama 1991),
        as `evo_ape --align` does: for poses whose frame is not quite that of the map. No such
        motion hides that a robot was lost in between.

        Raises:
            InputError: the log has no poses.
        """
        poses = self.log.required_poses()
        target = poses[:, :2] - poses[:, :2].mean(axis=0)
        moved = self.estimates.copy()
        for track in moved:
            x, y = (track[:, :2] - track[:, :2].mean(axis=0)).T
            cross = float((x * target[:, 1] - y * target[:, 0]).sum())
            turn = math.atan2(cross, float((x * target[:, 0] + y * target[:, 1]).sum()))
            c, s = math.cos(turn), math.sin(turn)
            track[:, 0] = c * x - s * y + poses[:, 0].mean()
            track[:, 1] = s * x + c * y + poses[:, 1].mean()
            track[:, 2] = wrap_angles(track[:, 2] + turn)
        return replace(self, estimates=moved)

    def errors(self, first: int = 0) -> ReplayErrors:
        """Sum up the errors from scan `first` on, over all runs.

        Raises:
            InputError: the log has no poses, or no scan that late.
        """
        if not 0 <= first < self.log.scans:
            raise InputError(
                f"first is {first}; the log {self.log.name!r} has the scans 0 to "
                f"{self.log.scans - 1}."
            )
        figures = []
        for error in (self.position_error, np.abs(self.heading_error)):
            late = error[:, first:]
            figures += [*np.quantile(late, (0.5, 0.95)).tolist(), float(late.max())]
        return ReplayErrors(*figures)


def replay(log: Log, localizer: Localizer, scanner: RangeScanner | None = None) -> Replay:
    """Feed the odometry and the scans of a log to all runs of a localizer.

    Args:
        log: The log; its poses are not shown to the localizer.
        localizer: Started by the caller where the log begins (`log.poses[0]`), or globally.
        scanner: The localizer's scanner; if given, its beams must be those of the log.

    Returns:
        The estimate at each scan.

    Raises:
        InputError: the beams do not match.
    """
    if scanner is not None:
        log.check_scanner(scanner)
    runs = len(localizer.mean)
    estimates = np.empty((runs, log.scans, 3))
    updated = np.empty((runs, log.scans), dtype=np.bool_)
    seconds = 0.0
    for k in range(log.scans):
        odometry = np.tile(log.odometry[k], (runs, 1))
        ranges = np.tile(log.ranges[k], (runs, 1))
        begin = time.perf_counter()
        updated[:, k] = localizer.update(odometry, ranges)
        seconds += time.perf_counter() - begin
        estimates[:, k] = localizer.mean
    estimates[..., 2] = wrap_angles(estimates[..., 2])
    return Replay(log, estimates, updated, seconds)
