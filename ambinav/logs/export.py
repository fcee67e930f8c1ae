"""Export of logs and trajectories: TUM trajectories, CARMEN logs, CSV."""

from __future__ import annotations

import gzip
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.config import read_text
from ambinav.geometry.frames import compose
from ambinav.logs.log import Log
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing

TUM_COLUMNS: Final = 8
# In CARMEN's list of lasers (laser_messages.h): none of those known by name.
UNKNOWN_LASER: Final = 99


def save_tum(path: str | Path, time: ArrayLike, poses: ArrayLike) -> None:
    """Write a trajectory as `evo` reads it: lines of `time x y z qx qy qz qw`.

    Args:
        path: Where to.
        time: Seconds, shape (N,), ascending.
        poses: x, y, theta, shape (N, 3).

    Raises:
        InputError: shapes do not fit, a value is not finite, time does not go forward, or the
            place is not writable.
    """
    path = Path(path)
    stamps, track = np.asarray(time, dtype=np.float64), np.asarray(poses, dtype=np.float64)
    if stamps.ndim != 1 or len(stamps) == 0 or track.shape != (len(stamps), 3):
        raise InputError(
            f"{path}: time has the shape {stamps.shape} and poses {track.shape}; give (N,) and "
            "(N, 3), N at least 1."
        )
    bad = np.flatnonzero(~(np.isfinite(track).all(axis=1) & np.isfinite(stamps)))
    if len(bad):
        raise InputError(
            f"{path}: time or pose {bad[0]} is not finite; where a log's time stamps are useless, "
            "number its scans instead."
        )
    back = np.flatnonzero(np.diff(stamps) <= 0.0)
    if len(back):
        k = int(back[0])
        before, after = stamps[k : k + 2].tolist()
        raise InputError(
            f"{path}: time goes from {before!r} to {after!r} at pose {k + 1}; give ascending "
            "times, or number the poses."
        )
    half = 0.5 * track[:, 2]
    zero = np.zeros(len(stamps))
    columns = [stamps, track[:, 0], track[:, 1], zero, zero, zero, np.sin(half), np.cos(half)]
    lines = ["# time x y z qx qy qz qw: seconds, metres, unit quaternion"]
    lines += [" ".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    _write(path, lines)


def load_tum(path: str | Path) -> tuple[Floats, Floats]:
    """Read a TUM trajectory; lines that begin with # are comments.

    Returns:
        Time, shape (N,), seconds, and x, y, theta, shape (N, 3), theta in [-pi, pi]: what a
        trajectory in space is seen from above.

    Raises:
        InputError: there is no such file, no pose in it, or a line is no pose.
    """
    path = Path(path)
    rows = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != TUM_COLUMNS:
            raise InputError(
                f"{path}: line {number}: it has {len(words)} values; a pose has {TUM_COLUMNS}: "
                "time x y z qx qy qz qw."
            )
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = [math.nan]
        if not all(map(math.isfinite, row)):
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not 8 finite numbers.")
        if abs(math.hypot(*row[4:]) - 1.0) > 0.01:
            raise InputError(
                f"{path}: line {number}: the quaternion {' '.join(words[4:])} has the length "
                f"{math.hypot(*row[4:]):g}; it must be 1."
            )
        rows.append(row)
    if not rows:
        raise InputError(f"{path}: there is no pose in it; give lines of time x y z qx qy qz qw.")
    table = np.array(rows)
    qx, qy, qz, qw = table[:, 4:].T
    theta = np.arctan2(2.0 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    return table[:, 0].copy(), np.column_stack([table[:, 1:3], theta])


def save_carmen(path: str | Path, log: Log) -> None:
    """Write a CARMEN log of ROBOTLASER1 lines; with the ending .gz it is compressed.

    The pose of the laser is that of `poses`, or of the odometry if the log has none; the pose of
    the robot is the odometry. Reading it gives the same log again (useless time stamps are
    written as 0). A reading that is too near becomes 0, no return the maximum range.

    Raises:
        InputError: the beams are not evenly spread, counter-clockwise, or the place is not
            writable.
    """
    path = Path(path)
    step = log.spacing
    if step is None:
        raise InputError(
            f"{path}: the beams of {log.name!r} are not evenly spread counter-clockwise; save it "
            "as CSV."
        )
    lines = ["# CARMEN log written by ambinav; metres, radians, seconds"]
    names = ("offset", "side_offset", "angular_offset")
    for name, value in zip(names, log.mount, strict=True):
        lines.append(f"PARAM robot_frontlaser_{name} {value!r} nohost 0")
    robot_poses = log.odometry if log.poses is None else log.poses
    laser = compose(robot_poses, log.mount) if any(log.mount) else robot_poses
    start, top = float(log.angles[0]), float(log.max_range)
    # A single beam has no step, and 0 is no step that a reader accepts.
    step = step or math.pi
    head = f"ROBOTLASER1 {UNKNOWN_LASER} {start!r} {step * (log.beams - 1)!r} {step!r} {top!r}"
    readings = _words(log.ranges, repr(top))
    for k in range(log.scans):
        stamp = repr(float(log.time[k])) if math.isfinite(log.time[k]) else "0"
        poses = " ".join(map(repr, laser[k].tolist() + log.odometry[k].tolist()))
        lines.append(
            f"{head} 0 0 {log.beams} {' '.join(readings[k])} 0 {poses} 0 0 0 0 0 "
            f"{stamp} nohost {stamp}"
        )
    _write(path, lines)


def pose_columns(prefix: str, poses: Floats) -> dict[str, NDArray[np.generic]]:
    """Name the columns of poses (N, 3): <prefix>x, <prefix>y, <prefix>theta."""
    return dict(zip((f"{prefix}{axis}" for axis in ("x", "y", "theta")), poses.T, strict=True))


def save_table(path: str | Path, columns: Mapping[str, NDArray[np.generic]]) -> None:
    """Write columns of equal length, shape (N,), as CSV; numbers read back as they were.

    Raises:
        InputError: the place is not writable.
    """
    # Single precision as the shortest text that gives it again, the rest as Python writes it.
    words = [
        column.astype(str).tolist() if column.dtype == np.float32 else map(repr, column.tolist())
        for column in columns.values()
    ]
    _write(Path(path), [",".join(columns), *map(",".join, zip(*words, strict=True))])


def _words(ranges: Floats32, no_return: str) -> NDArray[np.str_]:
    """Format each range as the shortest text that reads back as the same float32, (S, B)."""
    words = np.where(np.isneginf(ranges), np.float32(0.0), ranges).astype(str).astype(object)
    words[np.isposinf(ranges)] = no_return
    return words.astype(str)


def _write(path: Path, lines: list[str]) -> None:
    data = ("\n".join(lines) + "\n").encode("utf-8")
    with replacing(path) as fresh:
        # No time in the header: the same log gives the same bytes.
        fresh.write_bytes(gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)
