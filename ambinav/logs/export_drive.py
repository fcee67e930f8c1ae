"""Export of a simulated drive: trajectories, a CARMEN log, and a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.drives import Drives
from ambinav.export.registry import EXPORTERS, Exporter
from ambinav.logs.export import pose_columns, save_carmen, save_table, save_tum
from ambinav.logs.log import SAME_PLACE, Log
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner


class RecordedDrive(NamedTuple):
    """Single run in the form that exporters of drives take.

    Attributes:
        drives: What was recorded.
        run: Which run.
        scanner: What the robot saw with, or None.
    """

    drives: Drives
    run: int
    scanner: RangeScanner | None

    @property
    def time(self) -> Floats:
        """Seconds, shape (N,)."""
        return self.drives.time[: int(self.drives.samples[self.run])]

    @property
    def tracks(self) -> dict[str, Floats]:
        """Poses x, y, theta, shape (N, 3): truth, estimate, and odometry in its own frame."""
        n = len(self.time)
        drives = self.drives
        every = {"truth": drives.truth, "estimate": drives.estimate, "odometry": drives.odometry}
        return {name: poses[self.run, :n] for name, poses in every.items()}


def export_drive(
    drives: Drives,
    run: int,
    folder: str | Path,
    scanner: RangeScanner | None = None,
    formats: Sequence[str] | None = None,
) -> tuple[Path, ...]:
    """Write one run, to test another localizer on it and to evaluate the result.

    - carmen: `drive.log`, with a scanner: a CARMEN log of ROBOTLASER1 lines. The pose of the laser
      is the truth, the pose of the robot its odometry; `read_carmen` gives them back. (Where the
      two are the same throughout, it takes them for odometry alone.)
    - tum: `truth.tum`, `estimate.tum`, `odometry.tum`: trajectories as `evo` reads them, for
      instance `evo_ape tum truth.tum estimate.tum`. The odometry is in its own frame.
    - csv: `drive.csv`: time, odometry, truth (x, y, theta), estimate and its covariance, and
      whether the localizer took the readings in (1 or 0), a line for each sample.

    Args:
        drives: What was recorded.
        run: Which run.
        folder: Where to; it is made if it is missing, and older files are replaced.
        scanner: What the robot saw with. None: no CARMEN log, as for scanners whose beams it
            cannot describe or whose readings were not kept.
        formats: Names of formats (`export.registry.formats("drive")`); None: the three above.

    Returns:
        The files.

    Raises:
        InputError: there is no such run or format, or what `drive_log` refuses; then no file is
            written.
    """
    folder = Path(folder)
    _check_run(drives, run)
    names = DRIVE_FORMATS if formats is None else tuple(formats)
    chosen = [
        EXPORTERS.get(f"drive-{name}") for name in names if name != "carmen" or scanner is not None
    ]
    drive = RecordedDrive(drives, run, scanner)
    if scanner is not None and CARMEN in chosen:
        drive_log(drives, run, scanner)
    folder.mkdir(parents=True, exist_ok=True)
    return tuple(path for exporter in chosen for path in exporter.written(drive, folder))


def _write_carmen(drive: RecordedDrive, folder: Path) -> tuple[Path, ...]:
    if drive.scanner is None:
        raise InputError(
            "a CARMEN log holds the readings of a scanner, which are not in a drive.csv; name "
            "carmen in the scenario's `exports: formats`, and `ambinav compare` writes the log."
        )
    path = folder / "drive.log"
    save_carmen(path, drive_log(drive.drives, drive.run, drive.scanner))
    return (path,)


def _write_tum(drive: RecordedDrive, folder: Path) -> tuple[Path, ...]:
    files = []
    for name, track in drive.tracks.items():
        files.append(folder / f"{name}.tum")
        save_tum(files[-1], drive.time, track)
    return tuple(files)


def _write_table(drive: RecordedDrive, folder: Path) -> tuple[Path, ...]:
    time, tracks = drive.time, drive.tracks
    drives, run, n = drive.drives, drive.run, len(time)
    columns: dict[str, NDArray[np.generic]] = {"sample": np.arange(n), "time": time}
    for prefix, name in (("odometry_", "odometry"), ("", "truth"), ("estimate_", "estimate")):
        columns |= pose_columns(prefix, tracks[name])
    for i, a in enumerate(("x", "y", "theta")):
        for j, b in enumerate(("x", "y", "theta")[i:], start=i):
            columns[f"covariance_{a}_{b}"] = drives.covariance[run, :n, i, j]
    columns["updated"] = drives.updated[run, :n].astype(np.int64)
    path = folder / "drive.csv"
    save_table(path, columns)
    return (path,)


DRIVE_FORMATS: Final = ("carmen", "tum", "csv")
"""Our own formats of drives."""
CARMEN: Final = Exporter(
    subject="drive", format="carmen", title="a CARMEN log of ROBOTLASER1 lines", write=_write_carmen
)
TUM: Final = Exporter(
    subject="drive", format="tum", title="trajectories as `evo` reads them", write=_write_tum
)
TABLE: Final = Exporter(
    subject="drive",
    format="csv",
    title="a table with a line for each sample: odometry, truth, estimate, covariance",
    write=_write_table,
)


def drive_log(drives: Drives, run: int, scanner: RangeScanner) -> Log:
    """Return one run as a log: its readings, its odometry, and the truth as the log's poses.

    Args:
        drives: What was recorded, with the readings (`keep_ranges`).
        run: Which run.
        scanner: What the robot saw with; all beams start in one place, lie in its plane, and are
            evenly spread. Those of an upside-down laser go clockwise: the log has them reversed.

    Raises:
        InputError: there is no such run, the readings were not kept or are not of this scanner,
            or a log cannot describe its beams.
    """
    _check_run(drives, run)
    if drives.ranges is None:
        raise InputError(
            "drives: the readings were not kept, so there is no log of them; drive with "
            "keep_ranges=True, or give no scanner."
        )
    n = int(drives.samples[run])
    ranges = drives.ranges[run, :n]
    if ranges.shape[1] != scanner.beams:
        raise InputError(
            f"drives: a scan has {ranges.shape[1]} readings and scanner {scanner.name!r} has "
            f"{scanner.beams} beams; give the scanner of the drive."
        )
    x, y, yaw = scanner.mounts.T
    if max(np.ptp(x), np.ptp(y)) > SAME_PLACE:
        raise _undescribed(scanner, "its beams start in several places")
    if not scanner.level:
        raise _undescribed(scanner, "its beams look up or down")
    turn = np.unwrap(yaw)
    if turn[-1] < turn[0]:
        turn, ranges = np.unwrap(yaw[::-1]), ranges[:, ::-1]
    ahead = 0.5 * float(turn[0] + turn[-1])
    if turn[-1] - turn[0] + float(np.diff(turn).max(initial=0.0)) > 2.0 * math.pi - 1e-6:
        # All around: beam k of B looks to -pi + 2 pi k / B, so straight ahead is beam B / 2.
        ahead = float(turn[0]) + math.pi
    log = Log(
        name="drive",
        angles=turn - ahead,
        max_range=scanner.max_range,
        ranges=ranges,
        time=drives.time[:n],
        odometry=drives.odometry[run, :n],
        poses=drives.truth[run, :n],
        mount=(float(x[0]), float(y[0]), ahead),
    )
    if log.spacing is None:
        raise _undescribed(scanner, "its beams are not evenly spread")
    return log


def _undescribed(scanner: RangeScanner, why: str) -> InputError:
    return InputError(
        f"scanner {scanner.name!r}: {why}, which the log of one laser cannot say; export poses "
        "alone, without the scanner."
    )


def _check_run(drives: Drives, run: int) -> None:
    if not 0 <= run < len(drives):
        raise InputError(f"run is {run}; there are the runs 0 to {len(drives) - 1}.")
