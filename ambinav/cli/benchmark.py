"""`ambinav benchmark`: the leaderboard of planners and policies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.evaluate import arguments_of
from ambinav.cli.map_options import BuildingOptions, check_with_map
from ambinav.cli.packages import TRAINED, need
from ambinav.cli.running import check_writable, progress_bars, reporting, resumable
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ambinav_envs.leaderboard.board import Board
    from ambinav_envs.leaderboard.figures import Row

EPISODES, BUILDINGS = 300, 100
QUICK_EPISODES, QUICK_BUILDINGS = 30, 10
SHOWN = {
    "arrived": "arrived (%)",
    "collided": "collided (%)",
    "lost": "lost (%)",
    "error": "error (m)",
    "length": "length ratio",
    "exposure": "exposure per m",
}
"""Figures on the terminal, with their intervals."""
WIDTH = 150
"""Columns of text where there is no terminal."""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """Options on the planners and policies that drive."""

    PANEL: ClassVar[str] = "Methods"

    policy: Annotated[
        list[str] | None,
        typer.Option(
            "--policy",
            metavar="FILE|NAME|module:callable",
            help="A policy in addition to the shipped ones; repeatable.",
            show_default=False,
        ),
    ] = None
    planner: Annotated[
        list[str] | None,
        typer.Option(
            "--planner",
            metavar="NAME[:WEIGHT]",
            help="A planner instead of the default ones; repeatable.",
            show_default=False,
        ),
    ] = None
    force: options.Force = False
    trust: options.Trust = False


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Options on the episodes and their number."""

    PANEL: ClassVar[str] = "Episodes"

    episodes: Annotated[
        int | None,
        typer.Option(
            "--episodes",
            "-n",
            metavar="N",
            help="Episodes of each method in each setting.",
            show_default=f"{EPISODES}",
        ),
    ] = None
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Seed of the episodes, 0 or more.")
    ] = 0
    suite: Annotated[
        list[str] | None,
        typer.Option(
            "--suite",
            metavar="NAME",
            help="A suite of buildings; repeatable.",
            show_default="procedural and hall",
        ),
    ] = None
    map_file: Annotated[
        list[Path] | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="A building in addition to those of the suites; repeatable.",
            show_default=False,
        ),
    ] = None
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help=f"{QUICK_EPISODES} episodes in {QUICK_BUILDINGS} buildings, to try it."
        ),
    ] = False

    def check(self) -> None:
        """Refuse numbers outside their range.

        Raises:
            InputError: there is one.
        """
        if self.episodes is not None and self.episodes < 1:
            raise InputError(f"--episodes: {self.episodes} is too few; give 1 or more.")
        if self.seed < 0:
            raise InputError(f"--seed: {self.seed} is negative; give 0 or more.")


@options.grouped
def benchmark(
    methods: MethodOptions,
    driven: EpisodeOptions,
    building: BuildingOptions,
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KEY=VALUE]...",
            help="Arguments of the environment, common to all methods, e.g. localizer=mcl.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for the report; resumes an interrupted leaderboard in it.",
        ),
    ] = Path("leaderboard"),
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Evaluate all planners and policies on the same episodes, in one table.

    Writes report.md, report.json, table.csv and a picture. docs/leaderboard.md explains them. A
    policy that was trained with another scanner or robot is refused (a shipped one is left out),
    unless --force is given. Policy files are data: no code in them is run. module:callable is code
    and needs --trust.

    Example: `ambinav benchmark -o out/board --policy run/best.zip`
    """
    with reporting():
        driven.check()
        check_with_map(driven.map_file, building)
        options.check_pictures(pictures)
        common = arguments_of(values or [])
        check_writable(output)
        # The shipped policies, which take part, are trained ones.
        need("the leaderboard", TRAINED)
        from ambinav_envs.leaderboard.report import FOLDER, JSON, MARKDOWN
        from ambinav_envs.leaderboard.report import benchmark as run

        FOLDER.check(output)
        board = _board(methods, driven, building, common)
        with resumable(output, "what is finished is"), progress_bars(as_json) as bars:
            rows = run(board, output, bars, pictures)
        if as_json:
            typer.echo((output / JSON).read_text(encoding="utf-8").rstrip())
        else:
            _show(rows, output / MARKDOWN)


def _board(
    methods: MethodOptions,
    driven: EpisodeOptions,
    building: BuildingOptions,
    common: dict[str, Any],
) -> Board:
    """Create the leaderboard of the selected methods and venues."""
    from ambinav_envs.leaderboard.board import Board, settings_for
    from ambinav_envs.leaderboard.methods import all_methods

    count, buildings = (QUICK_EPISODES, QUICK_BUILDINGS) if driven.quick else (EPISODES, BUILDINGS)
    return Board(
        all_methods(methods.planner or [], methods.policy or [], trust=methods.trust),
        settings_for(
            driven.map_file or [],
            buildings,
            driven.suite or [],
            **building.reading(),
        ),
        driven.episodes or count,
        driven.seed,
        common,
        methods.force,
    )


def _show(rows: Sequence[Row], report: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ambinav.reports.table import interval_text, value_text

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDTH)
    for setting in dict.fromkeys(row.setting for row in rows):
        table = Table(box=None, pad_edge=False, title=Text(setting), title_justify="left")
        table.add_column("method", no_wrap=True)
        for title in SHOWN.values():
            table.add_column(title, justify="right")
        table.add_column("normalized", justify="right")
        for row in rows:
            if row.setting == setting:
                cells = (value_text(row[key], brief=True) for key in SHOWN)
                score = "-" if row.score is None else interval_text(row.score, 2)
                table.add_row(Text(row.method), *(Text(cell) for cell in (*cells, score)))
        console.print(table, "")
    console.print(Text(f"report: {report}"), soft_wrap=True)
