"""Reader of a drive's table, `drive.csv`."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ambinav.config import read_text
from ambinav.drive.drives import Drives
from ambinav.drive.world import DRIVING
from ambinav.logs.export_drive import RecordedDrive
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

AXES: Final = ("x", "y", "theta")


def load_drive(path: str | Path) -> RecordedDrive:
    """Read `drive.csv` as `export_drive` wrote it.

    The table tells poses, covariances and updates. It does not tell the readings, the route's end
    and length (nan), nor what became of the run (its outcome is that of one still driving).

    Raises:
        InputError: there is no such file, or it is not such a table; the message names line or
            column.
    """
    column = _read_columns(Path(path))

    def track(prefix: str) -> Floats:
        return np.column_stack([column[f"{prefix}{axis}"] for axis in AXES])[np.newaxis]

    count = len(column["time"])
    covariance = np.empty((1, count, 3, 3))
    for i, a in enumerate(AXES):
        for j, b in enumerate(AXES[i:], start=i):
            covariance[0, :, i, j] = covariance[0, :, j, i] = column[f"covariance_{a}_{b}"]
    drives = Drives(
        time=column["time"],
        truth=track(""),
        odometry=track("odometry_"),
        estimate=track("estimate_"),
        covariance=covariance,
        updated=column["updated"][np.newaxis] != 0.0,
        samples=np.array([count]),
        outcome=np.array([DRIVING]),
        goal=(np.nan, np.nan, np.nan),
        length=np.nan,
        open_loop=False,
        ranges=None,
    )
    return RecordedDrive(drives, 0, None)


def _read_columns(path: Path) -> dict[str, Floats]:
    """Return the columns of the table by name."""
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    names = lines[0].split(",") if lines else []
    columns = ["time", "updated"]
    columns += [f"{prefix}{axis}" for prefix in ("odometry_", "", "estimate_") for axis in AXES]
    columns += [f"covariance_{a}_{b}" for i, a in enumerate(AXES) for b in AXES[i:]]
    missing = [name for name in columns if name not in names]
    if missing:
        raise InputError(
            f"{path}: the column {missing[0]} is missing, so this is not a drive of ambinav; give "
            "the drive.csv of a comparison's `exports`, or a trajectory that ends in .tum."
        )
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split(",")
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != len(names):
            raise InputError(
                f"{path}: line {number} is not {len(names)} numbers; export the drive again."
            )
        rows.append(row)
    if not rows:
        raise InputError(f"{path}: there is no sample in it; export the drive again.")
    table = np.array(rows)
    column = {name: table[:, i] for i, name in enumerate(names)}
    bad = ~np.isfinite(table).all(axis=1)
    if bad.any():
        raise InputError(
            f"{path}: line {int(bad.argmax()) + 2} has a value that is not finite; export the "
            "drive again."
        )
    back = np.flatnonzero(np.diff(column["time"]) <= 0.0)
    if len(back):
        raise InputError(
            f"{path}: line {int(back[0]) + 3}: time does not go forward; export the drive again."
        )
    return column
