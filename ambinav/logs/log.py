"""Robot log: scans, odometry and, where known, the poses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from ambinav.config import as_positive, check_kind
from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import compose, wrap_angles
from ambinav.runtime.array_types import Bools, Floats, Floats32, Indices
from ambinav.runtime.errors import InputError
from ambinav.sensing.mounting import CENTRE, Mount
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

# Metres and radians: beams of a log and of a scanner this near to each other are the same.
SAME_PLACE: Final = 1e-3
SAME_ANGLE: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Log:
    """Scans of a planar laser with odometry and poses; metres, radians, seconds.

    Attributes:
        name: Name in reports.
        angles: float64, shape (B,): direction of each beam in the laser's frame,
            counter-clockwise from straight ahead.
        max_range: Farthest range that is read.
        ranges: float32, shape (S, B): readings; inf for no return, -inf for too near (as in ROS
            REP 117), else below `max_range`.
        time: float64, shape (S,), seconds; nan throughout if the log's time stamps are useless.
        odometry: float64, shape (S, 3): pose of the robot at each scan in the odometry's own
            frame; only its increments mean something.
        poses: float64, shape (S, 3): pose of the robot at each scan in the map frame, corrected
            or surveyed; None if the log has none.
        mount: x, y, yaw of the laser in the robot's frame.
        source: The file that it came from.
        skipped: Number of damaged lines that were left out when it was read.

    Raises:
        InputError: there is no scan, shapes do not fit, or a value is out of its range.
    """

    name: str
    angles: Floats
    max_range: float
    ranges: Floats32
    time: Floats
    odometry: Floats
    poses: Floats | None = None
    mount: Mount = CENTRE
    source: Path | None = None
    skipped: int = 0

    def __post_init__(self) -> None:
        """Convert every field to its type and check it."""
        for key in ("angles", "time", "odometry", "poses"):
            if getattr(self, key) is not None:
                object.__setattr__(self, key, np.array(getattr(self, key), dtype=np.float64))
        object.__setattr__(self, "ranges", np.array(self.ranges, dtype=np.float32))
        x, y, yaw = self.mount
        object.__setattr__(self, "mount", (float(x), float(y), float(yaw)))
        where = self.source or f"log {self.name!r}"
        if self.angles.ndim != 1 or self.angles.size == 0 or self.ranges.ndim != 2:
            raise InputError(
                f"{where}: angles have the shape {self.angles.shape} and ranges "
                f"{self.ranges.shape}; give (beams,) and (scans, beams)."
            )
        scans = len(self.ranges)
        if scans == 0:
            raise InputError(f"{where}: there is no scan in it; give at least one.")
        shapes = {"ranges": (scans, len(self.angles)), "time": (scans,), "odometry": (scans, 3)}
        if self.poses is not None:
            shapes["poses"] = (scans, 3)
        for key, shape in shapes.items():
            if getattr(self, key).shape != shape:
                raise InputError(
                    f"{where}: {key} have the shape {getattr(self, key).shape}; {scans} scans of "
                    f"{len(self.angles)} beams need {shape}."
                )
        for key in ("angles", "odometry", "poses"):
            values = getattr(self, key)
            if values is not None and not np.isfinite(values).all():
                raise InputError(f"{where}: {key} hold a value that is not finite; leave it out.")
        max_range = as_positive(self.max_range, f"{where}: max_range", "metres")
        object.__setattr__(self, "max_range", max_range)
        usable = (self.ranges >= 0.0) & (self.ranges < self.max_range) | np.isinf(self.ranges)
        if not usable.all():
            raise InputError(
                f"{where}: a range is {self.ranges[~usable][0]:g}; give metres from 0 to below "
                f"max_range ({self.max_range:g}), inf for no return, -inf for too near."
            )

    def __repr__(self) -> str:
        """Return name and counts as text."""
        poses_text = "no poses" if self.poses is None else "poses"
        return f"Log({self.name!r}, {self.scans} scans x {self.beams} beams, {poses_text})"

    @property
    def scans(self) -> int:
        """Number of scans S."""
        return len(self.ranges)

    @property
    def beams(self) -> int:
        """Number of beams B of a scan."""
        return len(self.angles)

    @property
    def laser_poses(self) -> Floats:
        """Pose of the laser at each scan in the map frame, shape (S, 3).

        Raises:
            InputError: the log has no poses.
        """
        return compose(self.required_poses(), self.mount)

    def required_poses(self) -> Floats:
        """Return the poses, shape (S, 3).

        Raises:
            InputError: the log has none.
        """
        if self.poses is None:
            raise InputError(
                f"{self.source or self.name}: the log has no poses besides its odometry; give a "
                "log with corrected poses."
            )
        return self.poses

    def thinned(self, every: int) -> Log:
        """Return the log of the scans 0, every, 2 every, ..."""
        return self.every(every)[0]

    def every(self, nth: int) -> tuple[Log, Log]:
        """Return two logs: of the scans 0, nth, 2 nth, ..., and of the others.

        The first is to make a map from and the second to replay in it. With `nth` 1 the second
        is the whole log, too: then nothing is independent.

        Raises:
            InputError: `nth` is below 1, or leaves no scan to one of the two.
        """
        check_kind(nth, (int, np.integer), "every", "give a whole number from 1 on")
        if nth < 1 or (nth > 1 and self.scans < 2):
            raise InputError(
                f"{self.source or self.name}: every is {nth} and the log has {self.scans} scans; "
                "give 1 or more, and above 1 a log with at least two scans."
            )
        first = np.arange(self.scans) % nth == 0
        return self.chosen(first), self.chosen(~first if nth > 1 else first)

    def chosen(self, scans: Bools | Indices | slice) -> Log:
        """Return the log of the scans that a mask, indices or a slice chooses."""
        return replace(
            self,
            ranges=self.ranges[scans],
            time=self.time[scans],
            odometry=self.odometry[scans],
            poses=None if self.poses is None else self.poses[scans],
        )

    @property
    def spacing(self) -> float | None:
        """Angle from one beam to the next, radians; None if they are not evenly spread.

        A single beam counts as evenly spread, with a spacing of 0.
        """
        if self.beams == 1:
            return 0.0
        steps = np.diff(self.angles)
        even = float(self.angles[-1] - self.angles[0]) / (self.beams - 1)
        return even if even > 0.0 and float(np.abs(steps - even).max()) < 1e-6 else None

    def scanner(
        self, std: float = 0.02, resolution: float = 0.01, *, max_range: float | None = None
    ) -> RangeScanner:
        """Return a scanner with the beams of the log.

        Args:
            std: Standard deviation of a reading, metres.
            resolution: Step of the discretized value, metres.
            max_range: Farthest range, metres; that of the log if None.

        Raises:
            InputError: a value is out of its range.
        """
        limit = self.max_range if max_range is None else max_range
        sensor = RangeSensor(
            name=self.name, max_range=limit, resolution=resolution, std=std, random_share=0.01
        )
        x, y, yaw = self.mount
        span = float(self.angles[-1] - self.angles[0])
        if self.spacing is None or span >= 2.0 * math.pi - SAME_ANGLE:
            return RangeScanner.from_mounts(sensor, self._mounts(), name=self.name)
        middle = yaw + 0.5 * float(self.angles[0] + self.angles[-1])
        return RangeScanner.planar(sensor, self.beams, span, (x, y, middle), name=self.name)

    def check_scanner(self, scanner: RangeScanner) -> None:
        """Check that the log's beams are those of a scanner, in the same order.

        Raises:
            InputError: their number differs, or a beam starts or looks elsewhere, up or down.
        """
        where = self.source or f"log {self.name!r}"
        if scanner.beams != self.beams:
            raise InputError(
                f"{where}: its scans have {self.beams} beams and scanner {scanner.name!r} has "
                f"{scanner.beams}; make the scanner with the log's own scanner()."
            )
        if not scanner.level:
            raise InputError(
                f"{where}: its beams are level, and those of scanner {scanner.name!r} look up or "
                "down; make the scanner with the log's own scanner()."
            )
        mine = self._mounts()
        apart = np.hypot(*(scanner.mounts[:, :2] - mine[:, :2]).T)
        turned = np.abs(wrap_angles(scanner.mounts[:, 2] - mine[:, 2]))
        bad = np.flatnonzero((apart > SAME_PLACE) | (turned > SAME_ANGLE))
        if len(bad):
            k = int(bad[0])
            raise InputError(
                f"{where}: beam {k} looks to {math.degrees(mine[k, 2]):.2f} degrees from "
                f"({mine[k, 0]:g}, {mine[k, 1]:g}) m and that of scanner {scanner.name!r} to "
                f"{math.degrees(scanner.mounts[k, 2]):.2f} degrees from ({scanner.mounts[k, 0]:g}, "
                f"{scanner.mounts[k, 1]:g}) m; make the scanner with the log's own scanner()."
            )

    def check_environment(self, environment: Environment) -> None:
        """Check that the log fits a map: half of its poses lie in the free space.

        Corrected poses may lie a little within the walls of a map that others made, so not every
        pose must.

        Raises:
            InputError: the log has no poses, or too few of them lie there.
        """
        x, y, _ = self.required_poses().T
        free = np.asarray(environment.is_free(x, y))
        if 2 * int(free.sum()) >= self.scans:
            return
        k = int(np.argmin(free))
        xmin, ymin, xmax, ymax = environment.bounds
        raise InputError(
            f"{self.source or f'log {self.name!r}'}: {int(free.sum())} of its {self.scans} poses "
            f"lie in the free space of environment {environment.name!r}, which reaches from "
            f"({xmin:.1f}, {ymin:.1f}) to ({xmax:.1f}, {ymax:.1f}) m; pose {k}, ({x[k]:.2f}, "
            f"{y[k]:.2f}) m, does not: give the map that belongs to the log."
        )

    def _mounts(self) -> Floats:
        """Return x, y, yaw of each beam in the robot's frame, shape (B, 3)."""
        x, y, yaw = self.mount
        return np.column_stack([np.full(self.beams, x), np.full(self.beams, y), yaw + self.angles])
