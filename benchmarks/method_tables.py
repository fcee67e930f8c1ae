"""Tables of methods that drive the same episodes, as the leaderboard's are."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

from harness import table

from ambinav.reports.table import value_text
from ambinav_envs.leaderboard.figures import Row

LIBRARIES: Final = ("ambinav", "stable_baselines3", "torch", "numpy", "numba")
SHOWN: Final = ("arrived", "missed", "collided", "timeout", "lost", "length", "seconds")


def silent(text: str) -> Callable[[float], None]:
    """Print which method drives, without its progress."""
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)
    return lambda share: None


def titles(keys: Sequence[str], row: Row) -> list[str]:
    """Return the column headers of some figures, with their units."""
    return [f"{row[key].figure.title} {row[key].figure.unit}".strip() for key in keys]


def figures_table(rows: Sequence[Row]) -> str:
    """Return the table of some figures of each method, with intervals."""
    lines = [(row.method, *(value_text(row[key]) for key in SHOWN)) for row in rows]
    return table(("", *titles(SHOWN, rows[0])), lines)
