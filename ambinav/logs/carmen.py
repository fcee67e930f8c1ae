"""Reader of CARMEN logs: a robot's laser and odometry as text."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_positive
from ambinav.geometry.frames import between, compose, inverse
from ambinav.logs.carmen_lines import Damage, Lines, Triple, read_lines
from ambinav.logs.log import Log
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.mounting import Mount

# Where nothing returns, a SICK writes its largest value or a code a little below it: 51.05 to
# 51.16 in one log, 81.87 and 81.89 in another.
NO_RETURN_SHARE: Final = 0.997
# Share of damaged lines above which a log is refused.
MOST_DAMAGED: Final = 0.01
# Metres and radians: what CARMEN's six digits leave of equality, 200 m from the origin.
SAME_POSE: Final = 2e-3
# Metres and radians by which a laser may sit elsewhere than the parameters say.
MISPLACED: Final = 0.5
# Share of steps forward in time below which the time stamps mean nothing.
FORWARD_SHARE: Final = 0.95
# Share of the scans after which odometry goes on from the corrected pose, in a log that does so.
REBASED_SHARE: Final = 0.9
# Headings are taken for degrees where most are beyond so many radians, two turns.
TURNED: Final = 4.0 * math.pi
# Number of readings of half a turn: with these the last beam looks to +90 degrees or one step less.
CLOSED: Final = (181, 361)
OPEN: Final = (180, 360)


def read_carmen(
    path: str | Path,
    *,
    max_range: float | None = None,
    angles: ArrayLike | None = None,
    mount: Mount | None = None,
) -> Log:
    """Read a CARMEN log, plain text or gzip.

    Scans come from ROBOTLASER1 lines, which say their beams' angles, or else from FLASER lines:
    180 or 360 readings look to -90 degrees + i 180/n, 181 or 361 to -90 degrees + i 180/(n-1).
    Each line gives the pose of the laser and the robot's odometry.

    - Where the two differ by more than where the laser sits, the first is a corrected or surveyed
      pose, and odometry is the second.
    - Where they are the same, but the ODOM line after each scan repeats the scan's pose, the log
      was written by a mapper (GMapping's `corrected.log`): the poses are corrected ones, and the
      ODOM lines go on from each of them. The odometry is then put together from the steps between
      ODOM lines, without those jumps. Read as they stand, such lines keep within centimetres of
      the corrected path, as if they had been scan-matched; put together they drift by metres.
    - Otherwise the log has odometry alone.

    A reading of 0 is too near (-inf). Time stamps that lost their digits give nan.

    Args:
        path: The log.
        max_range: Readings of this many metres and more are "no return". None: the maximum range
            that ROBOTLASER1 lines say; for FLASER the largest value in the log, and what is less
            than 0.3 % below it is "no return", too.
        angles: Directions of the beams in the laser's frame, radians, shape (B,), instead of
            those above.
        mount: x, y, yaw of the laser in the robot's frame, instead of what the lines or the
            parameters `robot_frontlaser_offset`, `.._side_offset`, `.._angular_offset` say.

    Returns:
        The log. Damaged lines are left out with an `InputWarning` that counts them; another says
        where headings seem to be in degrees.

    Raises:
        InputError: the file cannot be read, has no sound scan, more than 1 % of its lines of
            scans, odometry or parameters are damaged, or its beams' angles are not known.
    """
    path = Path(path)
    lines = read_lines(path)
    _report_damage(path, lines)
    shape = lines.scans[0].shape
    ranges, limit = _ranges(path, lines, max_range)
    laser = np.array([scan.laser for scan in lines.scans])
    robot = np.array([scan.robot for scan in lines.scans])
    headings = np.abs(np.stack([laser[:, 2], robot[:, 2]]))
    if np.median(headings, axis=1).max() > TURNED:
        warnings.warn(
            f"{path}: most headings are beyond two turns in radians, up to "
            f"{headings.max():.4g}; if they are degrees, convert them.",
            InputWarning,
            stacklevel=2,
        )
    seat = between(robot, laser)
    # Against the first, so that a laser that looks back is not torn apart at -pi and pi.
    spread = between(seat[0], seat)
    fixed = bool((np.abs(spread - np.median(spread, axis=0)) < SAME_POSE).all())
    middle = compose(seat[0], np.median(spread, axis=0))
    stated = lines.mount if mount is None else mount
    if fixed and stated is not None and np.abs(middle).max() >= SAME_POSE:
        # Odometry without errors, in a frame of its own: the laser does not sit that far off.
        # A log that states all of the mount is right about it.
        near = SAME_POSE if mount is None and lines.mount_is_whole else MISPLACED
        fixed = float(np.abs(between(stated, middle)).max()) < near
    if mount is None:
        mount = _mount(lines, middle if fixed else None)
    rebased = fixed and _rebased(lines, laser)
    odometry = _chained(lines) if rebased else robot
    return Log(
        name=path.name.removesuffix(".gz").removesuffix(".log"),
        angles=_angles(path, shape.beams, shape.start, shape.step, angles),
        max_range=limit,
        ranges=ranges,
        time=_time(np.array([scan.time for scan in lines.scans])),
        odometry=_robot_poses(odometry, mount) if rebased else odometry,
        poses=_robot_poses(laser, mount) if rebased or not fixed else None,
        mount=mount,
        source=path,
        skipped=len(lines.damaged),
    )


def _report_damage(path: Path, lines: Lines) -> None:
    """Warn about damaged lines, or raise `InputError` for the log."""
    if not lines.damaged:
        return
    first = lines.damaged[0]
    for kind, total in lines.counts.items():
        bad = [damage for damage in lines.damaged if damage.kind == kind]
        if len(bad) > MOST_DAMAGED * total:
            raise InputError(
                f"{path}: line {bad[0].line}: {bad[0].kind}: {bad[0].reason}; {len(bad)} of "
                f"{total} {kind} lines are damaged, more than 1 %: get the file again."
            )
    warnings.warn(_sentence(path, first, len(lines.damaged)), InputWarning, stacklevel=3)


def _sentence(path: Path, first: Damage, count: int) -> str:
    many = "1 damaged line was" if count == 1 else f"{count} damaged lines were"
    return f"{path}: {many} left out; line {first.line}: {first.kind}: {first.reason}."


def _ranges(path: Path, lines: Lines, max_range: float | None) -> tuple[Floats32, float]:
    """Return readings, shape (S, B), and the maximum range."""
    values = np.array([scan.ranges for scan in lines.scans])
    stated_range = lines.scans[0].shape.max_range
    finite = values[np.isfinite(values)]
    if max_range is not None:
        limit = cut = as_positive(max_range, f"{path}: max_range", "metres")
    elif stated_range > 0.0:
        limit = cut = stated_range
    else:
        limit = float(finite.max()) if len(finite) else 0.0
        if limit <= 0.0:
            raise InputError(f"{path}: no reading is above 0; give max_range, or another log.")
        cut = NO_RETURN_SHARE * limit
    values[values >= cut] = np.inf
    values[values == 0.0] = -np.inf
    ranges = values.astype(np.float32)
    # In single precision a reading just below the maximum can become the maximum.
    ranges[ranges >= limit] = np.inf
    return ranges, limit


def _angles(path: Path, beams: int, start: float, step: float, values: ArrayLike | None) -> Floats:
    if values is not None:
        angles = np.array(values, dtype=np.float64)
        if angles.shape != (beams,):
            raise InputError(
                f"{path}: angles have the shape {angles.shape}; its scans have {beams} beams."
            )
        return angles
    if step != 0.0:
        return np.asarray(start + step * np.arange(beams), dtype=np.float64)
    if beams not in OPEN + CLOSED:
        raise InputError(
            f"{path}: its FLASER lines have {beams} readings, and only 180, 181, 360 and 361 say "
            "where they look; give angles."
        )
    count = beams if beams in OPEN else beams - 1
    return np.asarray(-0.5 * math.pi + math.pi / count * np.arange(beams), dtype=np.float64)


def _mount(lines: Lines, seat: Floats | None) -> Mount:
    """Return the laser's mount: from the lines, or else from the parameters."""
    mount = lines.mount or (0.0, 0.0, 0.0)
    if seat is None:
        return mount
    near = float(np.abs(between(mount, seat)).max()) < SAME_POSE
    x, y, yaw = (float(value) for value in seat)
    return mount if near else (x, y, yaw)


def _robot_poses(laser: Floats, mount: Mount) -> Floats:
    """Compute poses of the robot from its laser's; equal if the laser is in the centre."""
    return compose(laser, inverse(mount)) if any(mount) else laser


def _time(stamps: Floats) -> Floats:
    """Return time stamps, or all nan if they do not increase."""
    steps = np.diff(stamps)
    useless = len(steps) > 0 and float((steps > 0.0).mean()) < FORWARD_SHARE
    return np.full_like(stamps, np.nan) if useless else stamps


def _rebased(lines: Lines, laser: Floats) -> bool:
    """Return whether nearly every odometry line after a scan repeats the scan's pose."""
    after = zip(lines.path, lines.path[1:], strict=False)
    pairs = [(a, b) for a, b in after if isinstance(a, int) and a >= 0 and not isinstance(b, int)]
    if len(pairs) < 2 or len(pairs) < REBASED_SHARE * (len(laser) - 1):
        return False
    scans = np.array([a for a, _ in pairs])
    apart = between(laser[scans], np.array([b for _, b in pairs]))
    return float((np.abs(apart).max(axis=1) < SAME_POSE).mean()) >= REBASED_SHARE


def _chained(lines: Lines) -> Floats:
    """Sum odometry at each scan from the steps between consecutive lines.

    The first line after a scan, damaged or not, is where the next step begins.
    """
    pose: Triple | None = None
    last: Triple = lines.scans[0].laser
    begins = False
    odometry = []
    for entry in lines.path:
        if isinstance(entry, int):
            if pose is None:
                pose = last
            if entry >= 0:
                odometry.append(pose)
            begins = True
            continue
        if pose is None:
            pose = entry
        elif not begins:
            pose = _moved(pose, last, entry)
        last, begins = entry, False
    return np.array(odometry)


def _moved(pose: Triple, before: Triple, after: Triple) -> Triple:
    """Apply the motion between two odometry lines to a pose."""
    turn = pose[2] - before[2]
    c, s = math.cos(turn), math.sin(turn)
    dx, dy = after[0] - before[0], after[1] - before[1]
    step = math.remainder(after[2] - before[2], 2.0 * math.pi)
    return pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, pose[2] + step
