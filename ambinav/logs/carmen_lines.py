"""Lines of a CARMEN log: scans and odometry, and the faults of damaged lines."""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from ambinav.runtime.errors import InputError

SCANS: Final = ("ROBOTLASER1", "FLASER")
# What follows the readings of a line: two poses and time, host, logger's time; with a
# ROBOTLASER1 five figures of the robot between them.
FLASER_TAIL: Final = 9
ROBOTLASER_TAIL: Final = 14
# Metres. A larger reading has lost its decimal point, and would pass for the maximum range.
FURTHEST_READING: Final = 1000.0

Triple = tuple[float, float, float]


class Shape(NamedTuple):
    """Properties that all scans of a log must share; 0 where the line does not state one.

    The step is negative where the laser turns clockwise, as one that hangs upside down does.
    """

    beams: int
    start: float = 0.0
    step: float = 0.0
    max_range: float = 0.0


class Scan(NamedTuple):
    """Scan as its line gives it."""

    line: int
    shape: Shape
    ranges: list[float]
    laser: Triple
    robot: Triple
    time: float


class Damage(NamedTuple):
    """Line that cannot be used."""

    line: int
    kind: str
    reason: str


@dataclass
class Lines:
    """Contents of a log, in the order of its lines.

    Attributes:
        kind: The message that the scans come from.
        scans: The sound scans.
        path: One entry for each line of odometry (its pose) and of a scan (its index in `scans`,
            -1 for a damaged one).
        mount: Laser's pose on the robot by the log's parameters; None if it has none.
        mount_is_whole: Whether the parameters state x, y and yaw.
        damaged: The lines that cannot be used.
        counts: Number of lines of scans, odometry and parameters, damaged ones included.
    """

    kind: str
    scans: list[Scan] = field(default_factory=list)
    path: list[Triple | int] = field(default_factory=list)
    mount: Triple | None = None
    mount_is_whole: bool = False
    damaged: list[Damage] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)


def read_lines(path: Path) -> Lines:
    """Read a CARMEN log, plain or gzip.

    The scans are the ROBOTLASER1 lines, or the FLASER lines if there are none; lines of other
    messages are passed over. Scans of another shape than most count as damaged.

    Raises:
        InputError: the file cannot be read, or has no line with a scan.
    """
    rows = [line.split() for line in _text(path).split("\n")]
    kinds = Counter(row[0] for row in rows if row)
    kind = next((name for name in SCANS if kinds[name]), None)
    if kind is None:
        raise InputError(
            f"{path}: no line of it begins with {' or '.join(SCANS)}, so there is no scan in it; "
            "give a CARMEN log with scans."
        )
    lines = Lines(kind)
    offsets: dict[str, float] = {}
    for number, row in enumerate(rows, start=1):
        if not row or row[0] not in (kind, "ODOM", "PARAM"):
            continue
        lines.counts[row[0]] += 1
        try:
            if row[0] == "PARAM":
                _note_offset(row, offsets)
                continue
            if row[0] == "ODOM":
                lines.path.append(_odometry(row))
                continue
            scan = (_flaser if kind == "FLASER" else _robotlaser)(number, row)
            lines.path.append(len(lines.scans))
            lines.scans.append(scan)
        except (ValueError, IndexError, OverflowError) as error:
            reason = str(error) if type(error) is ValueError else "it ends too early"
            lines.damaged.append(Damage(number, row[0], reason))
            if row[0] == kind:
                lines.path.append(-1)
    if offsets:
        lines.mount = (
            offsets.get("", 0.0),
            offsets.get("side_", 0.0),
            offsets.get("angular_", 0.0),
        )
        lines.mount_is_whole = len(offsets) == len(lines.mount)
    _drop_odd_scans(lines)
    return lines


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
        if raw[:2] == b"\x1f\x8b":
            raw = gzip.decompress(raw)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(
            f"{path}: the compressed log is damaged or cut off ({error}); get the file again."
        ) from error
    except OSError as error:
        raise InputError(
            f"{path}: the log cannot be read ({error.strerror}); name a CARMEN log."
        ) from error
    return raw.decode("utf-8", errors="replace")


def _note_offset(row: list[str], offsets: dict[str, float]) -> None:
    """Store robot_frontlaser_[side_|angular_]offset; the first of each name counts."""
    name = row[1] if len(row) > 1 else ""
    if name.startswith("robot_frontlaser_") and name.endswith("offset"):
        value = _numbers([row[2]])[0]
        offsets.setdefault(name[len("robot_frontlaser_") : -len("offset")], value)


def _numbers(words: list[str]) -> list[float]:
    """Parse finite numbers."""
    values = [_number(word) for word in words]
    if not all(map(math.isfinite, values)):
        raise ValueError("a value of it is not finite")
    return values


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"{word!r} is not a number") from None


def _triple(words: list[str]) -> Triple:
    x, y, theta = _numbers(words)
    return x, y, theta


def _odometry(row: list[str]) -> Triple:
    """Parse ODOM x y theta tv rv accel time host time."""
    if len(row) < 4:
        raise ValueError(f"it has {len(row)} values where ODOM has 10")
    return _triple(row[1:4])


def _count(word: str, items: str, least: int = 0) -> int:
    if not word.isascii() or not word.isdigit() or int(word) < least:
        raise ValueError(f"its number of {items} is {word!r}")
    return int(word)


def _ranges(words: list[str]) -> list[float]:
    """Parse readings in metres; some loggers write inf where nothing returns."""
    values = list(map(_number, words))
    bad = next((v for v in values if not (0.0 <= v <= FURTHEST_READING or v == math.inf)), None)
    if bad is not None:
        raise ValueError(f"a reading is {bad:g}, not 0 to {FURTHEST_READING:g} m")
    return values


def _require(row: list[str], count: int, readings: int) -> None:
    if len(row) != count:
        raise ValueError(f"it has {len(row)} values; with {readings} readings it must be {count}")


def _flaser(line: int, row: list[str]) -> Scan:
    """Parse FLASER n r_1 .. r_n x y theta odom_x odom_y odom_theta time host time."""
    n = _count(row[1], "readings", 1)
    _require(row, 2 + n + FLASER_TAIL, n)
    tail = row[2 + n :]
    laser, robot = _triple(tail[:3]), _triple(tail[3:6])
    return Scan(line, Shape(n), _ranges(row[2 : 2 + n]), laser, robot, _numbers([tail[6]])[0])


def _robotlaser(line: int, row: list[str]) -> Scan:
    """Read a ROBOTLASER1 line.

    Its fields: type start_angle field_of_view angular_resolution maximum_range accuracy
    remission_mode n r_1 .. r_n m s_1 .. s_m laser pose (3), robot pose (3), tv rv forward side
    turn_axis time host time.
    """
    n = _count(row[8], "readings", 1)
    m = _count(row[9 + n], "remissions")
    _require(row, 10 + n + m + ROBOTLASER_TAIL, n)
    start, _, step, max_range = _numbers(row[2:6])
    if not (max_range > 0.0 and step != 0.0):
        raise ValueError(f"its maximum range is {max_range:g} and its angular step {step:g}")
    tail = row[10 + n + m :]
    laser, robot = _triple(tail[:3]), _triple(tail[3:6])
    shape = Shape(n, start, step, max_range)
    return Scan(line, shape, _ranges(row[9 : 9 + n]), laser, robot, _numbers([tail[11]])[0])


def _drop_odd_scans(lines: Lines) -> None:
    """Count scans whose shape differs from the most common one as damaged."""
    if not lines.scans:
        return
    usual = Counter(scan.shape for scan in lines.scans).most_common(1)[0][0]
    scans: list[Scan] = []
    index = []
    for scan in lines.scans:
        if scan.shape == usual:
            index.append(len(scans))
            scans.append(scan)
            continue
        index.append(-1)
        reason = f"it has {scan.shape.beams} readings where most have {usual.beams}"
        if scan.shape.beams == usual.beams:
            reason = "its beams or its maximum range differ from most others"
        lines.damaged.append(Damage(scan.line, lines.kind, reason))
    lines.scans = scans
    lines.path = [index[e] if isinstance(e, int) and e >= 0 else e for e in lines.path]
    lines.damaged.sort()
