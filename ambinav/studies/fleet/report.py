"""Report of a fleet: fleet.json, tables, catalogue, and a page that stands alone."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any, Final

from ambinav.maps.address import Address
from ambinav.maps.zones import MEANINGS, ZONES
from ambinav.plotting.style import ZONE_COLOURS
from ambinav.reports.fields import Part
from ambinav.reports.number_text import metres2, percent
from ambinav.reports.pages import counted
from ambinav.studies.fleet.catalogue import CATALOGUE, ITEMS, catalogue
from ambinav.studies.fleet.document import (
    FILE,
    FleetDocument,
    FleetFigures,
    NeedPart,
    RunPart,
    figures_of,
)
from ambinav.studies.fleet.mix import best_mixes
from ambinav.studies.fleet.tables import parquet
from ambinav.studies.fleet.unit import RESULTS, FleetSettings, UnitDone
from ambinav.studies.study import Content, Study
from ambinav.version import __version__

PAGE: Final = "index.html"
FIGURES: Final = "figures.parquet"
RUNS: Final = "runs.parquet"
STUDY: Final = Study(
    "fleet audit", "ambinav.studies.fleet", (), (RESULTS, ITEMS, CATALOGUE, FIGURES, RUNS, PAGE),
    stem="fleet", documents=("json",),
)  # fmt: skip


def fleet_document(results: Sequence[UnitDone], settings: FleetSettings) -> FleetDocument:
    """Collect the figures of all results."""
    rows = tuple(figures_of(done.result) for done in results)
    return FleetDocument(
        ambinav_version=__version__,
        summary=_summary(rows),
        spacing_m=settings.spacing,
        radius_m=settings.radius,
        robot_radius_m=settings.robot_radius,
        needs=_needs(rows),
        mixes=best_mixes(rows),
        figures=rows,
    )


def write_report(report: FleetDocument, results: Sequence[UnitDone], output: Address) -> None:
    """Write all files of the report, its document last.

    Raises:
        InputError: one cannot be written.
    """
    figures = [row.model_dump() for row in report.figures]
    runs = [
        {"site": row.site, "scanner": row.scanner, **done.result.run.model_dump()}
        for row, done in zip(report.figures, results, strict=True)
    ]
    output.write(FIGURES, parquet(figures, FleetFigures))
    output.write(RUNS, parquet(runs, _KeyPart, RunPart))
    for name, text in catalogue(results):
        output.write(name, text.encode())
    output.write(PAGE, page(report, results).encode())
    output.write(FILE, Content(report).json.encode())


class _KeyPart(Part):
    """The first columns of runs.parquet."""

    site: str
    scanner: str


def page(report: FleetDocument, results: Sequence[UnitDone]) -> str:
    """Return the page: sites that need most first, those without figures last."""
    pictures = {
        (done.result.site, done.result.scanner): base64.b64encode(done.picture).decode()
        for done in results
    }
    rows = sorted(report.figures, key=lambda row: (row.bad_m2 is None, -(row.bad_m2 or 0.0)))
    values: dict[str, Any] = {
        "rows": [(row, pictures[row.site, row.scanner]) for row in rows],
        "scanners": sorted({row.scanner for row in rows}),
        "zones": [*zip(ZONES, ZONE_COLOURS, MEANINGS, strict=True)],
    }
    return STUDY.fill("index.html.j2", Content(report, values), {})


def _summary(rows: Sequence[FleetFigures]) -> str:
    sites, failed = {row.site for row in rows}, [row for row in rows if row.status == "failed"]
    sentences = [f"{counted(len(sites), 'site')}."]
    for scanner in sorted({row.scanner for row in rows}):
        of_it = [row for row in rows if row.scanner == scanner and row.bad_m2 is not None]
        if not of_it:
            continue
        bad, floor = (sum(getattr(row, name) for row in of_it) for name in ("bad_m2", "counted_m2"))
        worst = max(of_it, key=lambda row: row.bad_m2 or 0.0)
        where = f", most in {worst.site} ({metres2(worst.bad_m2 or 0.0)})" if bad else ""
        sentences.append(
            f"{scanner} leaves robots lost on {metres2(bad)} of {metres2(floor)} "
            f"({percent(bad / max(floor, 1e-9))}){where}."
        )
    if failed:
        sentences.append(f"{counted(len(failed), 'audit')} of {len(rows)} failed.")
    return " ".join(sentences)


def _needs(rows: Sequence[FleetFigures]) -> tuple[NeedPart, ...]:
    groups: dict[tuple[str, str], list[FleetFigures]] = {}
    for row in rows:
        if row.advice:
            groups.setdefault((row.scanner, row.advice), []).append(row)
    needs = [
        NeedPart(
            scanner=scanner,
            advice=advice,
            sites=tuple(row.site for row in group),
            bad_m2=sum(row.bad_m2 or 0.0 for row in group),
            removed_m2=sum(
                (row.bad_m2 or 0.0) - row.bad_after_m2
                for row in group
                if row.bad_after_m2 is not None
            ),
        )
        for (scanner, advice), group in groups.items()
    ]
    return tuple(sorted(needs, key=lambda need: (-need.removed_m2, need.scanner, need.advice)))
