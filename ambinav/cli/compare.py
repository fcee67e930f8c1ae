"""`ambinav compare`: routes judged by what happens to a robot that drives them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, progress_bars, reporting, resumable
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.studies.compare.document import PairPart
    from ambinav.studies.compare.tables import Row

SHOWN = {
    "lost": "lost, %",
    "error_p95": "95 % error, m",
    "collided": "collided, %",
    "arrived": "arrived",
    "length": "length, m",
}
"""Figures on the terminal; the first two with their intervals."""
WITH_INTERVAL = ("lost", "error_p95")


def compare(
    scenario_file: Annotated[
        Path,
        typer.Argument(
            metavar="SCENARIO.yaml",
            help="Building, scanner, robot, localizer, start-goal pairs and routes; see configs.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for the report; resumes an interrupted comparison in it.",
            show_default=False,
        ),
    ],
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            metavar="N",
            help="Number of processes that simulate drives.",
            show_default="all cores",
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            "--episodes",
            "-n",
            metavar="N",
            help="Number of drives per route.",
            show_default="the scenario's `runs`",
        ),
    ] = None,
    pictures: options.Pictures = "png",
    force: options.Force = False,
    trust: options.Trust = False,
    no_store: options.NoStore = False,
    as_json: options.AsJson = False,
) -> None:
    """Drive routes with a localizer in the loop, and compare localization along them.

    Writes report.html (self-contained), report.md, report.json, table.csv, routes, pictures and, if
    the scenario asks for them, drives for other programs. docs/compare.md explains the scenario.

    A policy that was trained with another scanner or robot is refused unless --force is given. A
    policy that is code (module:callable) is refused unless --trust is given.

    Example: `ambinav compare configs/compare-demo.yaml -o out/compare`
    """
    with reporting():
        for option, number in (("--jobs", jobs), ("--episodes", episodes)):
            if number is not None and number < 1:
                raise InputError(f"{option}: {number} is too few; give 1 or more.")
        options.check_pictures(pictures)
        from ambinav.studies.compare.report import FOLDER, HTML
        from ambinav.studies.compare.report import compare_routes as run
        from ambinav.studies.compare.scenario_file import load_scenario

        loaded = load_scenario(scenario_file, runs=episodes, force=force, trust=trust)
        check_writable(output)
        FOLDER.check(output)
        with resumable(output, "the drives so far are"), progress_bars(as_json) as bars:
            report, rows = run(
                loaded,
                output,
                jobs=jobs or os.cpu_count() or 1,
                bars=bars,
                image_format=pictures,
                store=options.store_of(no_store),
            )
        if as_json:
            typer.echo(report.model_dump_json(indent=2))
        else:
            _show(rows, report.verdicts, output / HTML)


def _show(rows: tuple[Row, ...], verdicts: dict[str, PairPart], report: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ambinav.reports.table import value_text

    console = Console(highlight=False)
    for pair, verdict in verdicts.items():
        own = [row for row in rows if row.pair == pair]
        table = Table(box=None, pad_edge=False, title=Text(pair), title_justify="left")
        table.add_column("route")
        for title in SHOWN.values():
            table.add_column(title, justify="right", no_wrap=True)
        for row in own:
            cells = (
                text if key in WITH_INTERVAL else text.split(" [")[0]
                for key, text in ((key, value_text(row[key])) for key in SHOWN)
            )
            table.add_row(Text(row.route), *(Text(cell) for cell in cells))
        lines = (verdict.headline, verdict.text, *(route.text for route in verdict.routes))
        console.print(table, "", *(Text(f"- {line}") for line in lines), "", sep="\n")
    console.print(Text(f"report: {report}"), soft_wrap=True)
