"""The table of progress: a row for every logging interval and every evaluation."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from ambinav.runtime.files import replacing
from ambinav_envs.training.episode_stats import FIGURES

COLUMNS: Final = (
    "steps", "seconds", "steps_per_second", "longest",
    *(f"train_{name}" for name in FIGURES),
    *(f"eval_{name}" for name in FIGURES),
)  # fmt: skip
"""Columns of the table; seconds cover training, evaluation and checkpoints together."""

Row = dict[str, float | None]


class Progress:
    """The table of progress, a file to which rows are added.

    Args:
        path: The file.
        steps: Rows of more steps are dropped: they came after the checkpoint that is resumed.
    """

    def __init__(self, path: Path, steps: float = math.inf) -> None:
        self._path = path
        read = read_rows(path) if path.is_file() else []
        self.rows = [row for row in read if (row["steps"] or 0.0) <= steps]
        with replacing(path) as fresh, fresh.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(_texts(row) for row in self.rows)

    def add(self, row: Mapping[str, float | None]) -> None:
        """Add a row; missing columns stay empty."""
        self.rows.append({name: row.get(name) for name in COLUMNS})
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, COLUMNS).writerow(_texts(self.rows[-1]))

    def evaluations(self) -> list[Row]:
        """Return the rows with an evaluation."""
        return [row for row in self.rows if row["eval_episodes"]]


def read_rows(path: Path) -> list[Row]:
    """Read the rows of a table of progress."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{name: _number(text) for name, text in row.items()} for row in csv.DictReader(file)]


def _number(text: str) -> float | None:
    return float(text) if text else None


def _texts(row: Row) -> dict[str, str]:
    return {
        name: ""
        if value is None or not math.isfinite(value)
        else repr(float(value)).removesuffix(".0")
        for name, value in row.items()
        if name not in ("steps", "seconds")
    } | {name: f"{row[name] or 0.0:.12g}" for name in ("steps", "seconds")}
