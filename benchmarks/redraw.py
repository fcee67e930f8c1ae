"""The leaderboard's overview from the tables of `results/leaderboard.md`: nothing is driven again.

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

RESULTS = ROOT / "benchmarks" / "results"
IMAGES = ROOT / "docs" / "images"
WITHDRAWN = ("corrected-vfh", "ppo-ambiguity", "ppo-shortest")
"""Policies of the report that are no longer shipped."""
_VALUE = re.compile(r"(\S+) \[(\S+), (\S+)\]")


def main() -> None:
    """Draw the figure."""
    text = (RESULTS / "leaderboard.md").read_text(encoding="utf-8")
    match = re.search(r"^(\d+) episodes of each method", text, flags=re.MULTILINE)
    if match is None:
        raise SystemExit("leaderboard.md does not say how many episodes it has.")
    episodes = int(match.group(1))
    rows = [
        row
        for table in tables_of(text)
        for row in board_rows(table, episodes)
        if row.method not in WITHDRAWN
    ]
    picture = plot_board(rows, f"Leaderboard, {episodes} episodes each")
    save_figure(picture, IMAGES / "leaderboard.png")


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


if __name__ == "__main__":
    main()
