"""`ambinav compare`: routes judged by what happens to a robot that drives them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.limits import at_least
from ambinav.cli.printing import finish, show, table
from ambinav.cli.running import check_report, progress_bars, reporting, resumable
from ambinav.runtime.processes import processors

if TYPE_CHECKING:
    from rich.table import Table

    from ambinav.studies.compare.document import PairPart
    from ambinav.studies.compare.tables import Row

SHOWN = {
    "lost": "lost,\n%",
    "error_p95": "95 % error,\nm",
    "collided": "collided,\n%",
    "arrived": "arrived,\n%",
    "length": "driven,\nm",
}
"""Figures on the terminal; the first two with their intervals. Units stand below: with the names of
routes all must fit on 80 columns."""
WITH_INTERVAL = ("lost", "error_p95")
FORECAST = "forecast,\n%"
"""Forecast of lost robots, %, after the figure `lost`."""


@options.documented
def compare(
    scenario_file: Annotated[Path, typer.Argument()],
    output: Annotated[Path, typer.Option("--output", "-o")],
    jobs: Annotated[int | None, at_least(1), typer.Option("--jobs", "-j")] = None,
    episodes: Annotated[int | None, at_least(1), typer.Option("--episodes", "-n")] = None,
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

    Parameters:
        scenario_file (SCENARIO.yaml): Building, scanner, robot, localizer, start-goal pairs and
            routes; see configs.
        output (DIR): Folder for the report; resumes an interrupted comparison in it.
        jobs (N): Number of processes that simulate drives. [default: all cores]
        episodes (N): Number of drives per route. [default: the scenario's `runs`]
    """
    with reporting():
        from ambinav.runtime.runfolder import WORK
        from ambinav.studies.compare.report import STUDY, compare_routes
        from ambinav.studies.compare.scenario_file import load_scenario

        check_report(STUDY, output, pictures)
        loaded = load_scenario(scenario_file, runs=episodes, force=force, trust=trust)
        with resumable(output / WORK, "the drives so far are"), progress_bars(as_json) as bars:
            report, rows = compare_routes(
                loaded,
                output,
                jobs=jobs or processors(),
                stages=bars,
                image_format=pictures,
                store=options.store_of(no_store),
            )
        finish(
            report, lambda report: _show(rows, report.verdicts), STUDY.page(output), as_json=as_json
        )


def _show(rows: tuple[Row, ...], verdicts: dict[str, PairPart]) -> None:
    from ambinav.reports.table import value_text

    def cells(row: Row) -> Iterator[str]:
        yield row.route
        for key in SHOWN:
            text = value_text(row[key])
            yield text if key in WITH_INTERVAL else text.split(" [")[0]
            if key == "lost" and has_forecast:
                yield row.forecast_text

    has_forecast = any(row.forecasts for row in rows)
    titles = tuple(SHOWN.values())
    parts: list[str | Table] = []
    if has_forecast:
        titles = (titles[0], FORECAST, *titles[1:])
    for pair, verdict in verdicts.items():
        pair_rows = map(cells, (row for row in rows if row.pair == pair))
        lines = [verdict.headline, verdict.text, *(route.text for route in verdict.routes)]
        lines += [
            f"forecast of {row.route}: {row.forecasts[0].sentence}"
            for row in rows
            if row.pair == pair and len(row.forecasts) == 1
        ]
        figures = table(
            ("route", *titles), pair_rows, left=("route",), no_wrap=titles, fold=True, title=pair,
            collapse_padding=True,
        )  # fmt: skip
        parts += ["", figures, "", *(f"- {line}" for line in lines)]
    show(*parts[1:])
