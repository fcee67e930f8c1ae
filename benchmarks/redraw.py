"""Figures of the documentation from stored reports: nothing is driven or trained again.

The leaderboard's overview is drawn from the tables of `results/leaderboard.md`, the curve of a
training from its table in `results/baselines.md`, which has the judged episodes alone.

    python benchmarks/redraw.py
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from harness import ROOT
from report_tables import Table, tables_of

from ambinav.drive.bootstrap import Interval
from ambinav.plotting.canvas import save_figure
from ambinav.reports.table import Cell
from ambinav_envs.leaderboard.figures import FIGURES, Row
from ambinav_envs.leaderboard.methods import SHORTEST
from ambinav_envs.leaderboard.overview import plot_board
from ambinav_envs.training.curve import ENDS, plot_curve
from ambinav_envs.training.progress import Row as Progress

RESULTS = ROOT / "benchmarks" / "results"
IMAGES = ROOT / "docs" / "images"
PICTURED = "ppo-ambiguity"
"""The training whose curve is shown."""
_VALUE = re.compile(r"(\S+) \[(\S+), (\S+)\]")


def main() -> None:
    """Draw both figures."""
    text = (RESULTS / "leaderboard.md").read_text(encoding="utf-8")
    match = re.search(r"^(\d+) episodes of each method", text, flags=re.MULTILINE)
    if match is None:
        raise SystemExit("leaderboard.md does not say how many episodes it has.")
    episodes = int(match.group(1))
    rows = [row for table in tables_of(text) for row in board_rows(table, episodes)]
    picture = plot_board(rows, f"Leaderboard, {episodes} episodes each")
    save_figure(picture, IMAGES / "leaderboard.png")
    text = (RESULTS / "baselines.md").read_text(encoding="utf-8")
    curve = next(candidate for candidate in tables_of(text) if candidate.heading == PICTURED)
    plot_curve([progress_of(curve, row) for row in curve.rows], IMAGES / "training-curve.png")


def board_rows(table: Table, episodes: int) -> Iterator[Row]:
    """Return the rows of a setting's table of figures; none of any other table."""
    titles = tuple(
        f"{episode_figure.title} ({episode_figure.unit})"
        if episode_figure.unit
        else episode_figure.title
        for episode_figure in FIGURES
    )
    if table.header != ("method", *titles) or not _VALUE.fullmatch(table.rows[0][1]):
        return
    for method, *texts in table.rows:
        values = [interval_of(text, episodes) for text in texts]
        yield Row(
            table.heading.lower(),
            method,
            episodes,
            tuple(
                # The picture needs no difference, but asks whether there is one.
                Cell(figure, value, None if method == SHORTEST else value)
                for figure, value in zip(FIGURES, values, strict=True)
            ),
        )


def interval_of(text: str, episodes: int) -> Interval:
    """Parse value and interval of the reports: "92.0 [86.5, 96.7]"."""
    match = _VALUE.fullmatch(text)
    if match is None:  # no episode has a value
        return Interval(math.nan, math.nan, math.nan, episodes)
    value, low, high = (float(part) for part in match.groups())
    return Interval(value, low, high, episodes)


def progress_of(table: Table, row: tuple[str, ...]) -> Progress:
    """Convert a row of a training's table to a row of progress, without missing columns."""
    values = dict(zip(table.header, (float(cell.replace(",", "")) for cell in row), strict=True))
    judged = ("arrived", *ENDS)
    return {
        "steps": values["steps"],
        "seconds": 60.0 * values["minutes"],
        "longest": None,
        "train_arrived": None,
        **{f"eval_{name}": values[f"{name} %"] / 100.0 for name in judged},
    }


if __name__ == "__main__":
    main()
