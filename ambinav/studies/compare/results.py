"""Stored results of the drives along a route."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ambinav.drive.drives import Drives
from ambinav.drive.metrics import Metrics
from ambinav.runtime.array_files import read_arrays, write_arrays
from ambinav.runtime.array_types import Floats

STEP = 0.5
"""Metres between the stations at which errors are kept."""

LEAST = 0.25
"""Share of the runs that must still be driving for a quantile to be reported."""


@dataclass(frozen=True, eq=False)
class Results:
    """R runs along one route.

    Attributes:
        metrics: Their figures.
        errors: Shape (R, S): the position's error after k * `STEP` metres truly driven,
            metres. nan after a wall or the time limit ended a run; one that stopped at its goal
            keeps its last error.
        lost_at: Shape (R, 2): where the robot truly was when it was first lost; nan if it never
            was.
        end: Shape (R, 2): where it truly ended.
    """

    metrics: Metrics
    errors: Floats
    lost_at: Floats
    end: Floats

    def __len__(self) -> int:
        """Return the number of runs R."""
        return len(self.metrics)


def results_of(drives: Drives, measured: Metrics, length: float) -> Results:
    """Summarize drives along a route of a given length, metres."""
    stations = np.arange(int(np.ceil(length / STEP)) + 1) * STEP
    errors = drives.errors()
    size = np.hypot(errors[..., 0], errors[..., 1])
    travelled = drives.travelled()
    rows = np.empty((len(drives), len(stations)))
    lost_at = np.full((len(drives), 2), np.nan)
    for run, count in enumerate(drives.samples.tolist()):
        index = np.searchsorted(travelled[run, :count], stations - 1e-9)
        rows[run] = size[run, np.minimum(index, count - 1)]
        if not drives.reached[run] and not drives.open_loop:
            rows[run, index >= count] = np.nan
        if measured.lost[run]:
            k = int(np.searchsorted(drives.time, measured.lost_after[run] - 1e-9))
            lost_at[run] = drives.truth[run, k, :2]
    end = drives.truth[np.arange(len(drives)), drives.samples - 1, :2]
    return Results(measured, rows, lost_at, end)


def quantiles(errors: Floats, shares: Sequence[float]) -> Floats:
    """Compute quantiles over the runs that still drove or stood at their goal, shape (Q, S).

    Args:
        errors: Shape (R, S), see `Results`.
        shares: Q of them, 0 to 1.

    Returns:
        Metres; nan where fewer than a quarter of the runs were still driving.
    """
    out = np.full((len(shares), errors.shape[1]), np.nan)
    enough = np.isfinite(errors).sum(axis=0) >= max(1.0, LEAST * len(errors))
    out[:, enough] = np.nanquantile(errors[:, enough], shares, axis=0)
    return out


def joined(parts: Sequence[Results]) -> Results:
    """Concatenate the runs of several results of the same route."""
    return Results(
        joined_metrics([part.metrics for part in parts]),
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS),
    )


def joined_metrics(parts: Sequence[Metrics]) -> Metrics:
    """Concatenate the figures of all runs."""
    return Metrics(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(Metrics)
        }
    )


ARRAYS = ("errors", "lost_at", "end")


def save_results(results: Results, path: Path) -> None:
    """Write results as .npz, atomically."""
    arrays = {field.name: getattr(results.metrics, field.name) for field in fields(Metrics)}
    arrays |= {f"at_{name}": getattr(results, name) for name in ARRAYS}
    write_arrays(path, arrays)


def load_results(path: Path) -> Results | None:
    """Read a file of `save_results`; return None if it is missing or damaged."""
    arrays = read_arrays(path)
    if arrays is None:
        return None
    rows = [arrays.pop(f"at_{name}") for name in ARRAYS]
    return Results(Metrics(**arrays), *rows)
