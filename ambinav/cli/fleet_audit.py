"""`ambinav fleet audit`: audits of many buildings, resumable, with a catalogue and a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.gate import FleetGate
from ambinav.cli.limits import at_least
from ambinav.cli.map_options import AmbiguityRadius, RobotRadius, Spacing, check_radius
from ambinav.cli.printing import finish, show, table
from ambinav.cli.running import check_writable, note, progress_bars, reporting, resumable
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import need

if TYPE_CHECKING:
    from ambinav.reports.conditions import Condition
    from ambinav.studies.fleet.batch import Batch
    from ambinav.studies.fleet.document import Result
    from ambinav.studies.fleet.fleet import Fleet
    from ambinav.studies.fleet.unit import UnitDone

SHOWN = 20
"""Rows of the table on the terminal."""


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Options on where the audits run.

    Attributes:
        workers (N): Number of processes of this computer; 0: this process, with its threads.
            [default: one per processor]
        dask (ADDRESS): Audit on the workers of a Dask scheduler, e.g. tcp://10.0.0.5:8786; they
            must reach the buildings and the output. [default: processes of this computer]
        batch (K/N): Audit the K-th of N parts and write only its results, for array jobs and CI
            matrices; the same command without it reads them there, makes what is missing, and
            writes the report. [default: all]
    """

    PANEL: ClassVar[str] = "Workers"

    workers: Annotated[int | None, at_least(0)] = None
    dask: str | None = None
    batch: str | None = None

    @property
    def part(self) -> Batch | None:
        """The part to audit; None: all.

        Raises:
            InputError: it cannot be read.
        """
        from ambinav.studies.fleet.batch import Batch

        return Batch.parse(self.batch) if self.batch is not None else None

    def check(self) -> None:
        """Check the options before the long work.

        Raises:
            InputError: a value cannot be used, or the scheduler does not answer.
        """
        if self.workers is not None and self.dask is not None:
            raise InputError(
                "--workers: processes of this computer and --dask exclude each other; give one of "
                "them."
            )
        if self.dask is not None:
            from ambinav.runtime.cluster import threads_of

            threads_of(self.dask, "--dask")


@options.documented
def audit_fleet(
    sites: Annotated[str, typer.Argument()],
    output: Annotated[str, typer.Option("--output", "-o")],
    scanner: Annotated[
        list[str] | None, typer.Option("--scanner", "-s", autocompletion=options.complete_preset)
    ] = None,
    spacing: Spacing = 0.1,
    radius: AmbiguityRadius = 0.5,
    robot_radius: RobotRadius = None,
    no_advice: bool = False,
    *,
    running: WorkerOptions,
    gate: FleetGate,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Audit many buildings, and list which need what.

    If it is interrupted, the same command resumes it; what failed is tried again. A site that fails
    stops no other one: it is named, and the exit status is 2 if all fail or a condition of
    --fail-if cannot be checked there.

    Writes index.html (self-contained), figures.parquet, fleet.json, a STAC catalogue (catalog.json)
    and the results of each site.

    Example: `ambinav fleet audit sites/ --scanner rplidar-a1 -o fleet --fail-if "bad > 5 %"`

    Parameters:
        sites (SITES.csv|FOLDER): A table with the columns site and building (and date, scanner,
            level, unit, height, doors, glass), or a folder of buildings; either may be a URL.
        output (DIR|URL): Folder or URL for the results; those of an earlier run there are kept.
        scanner (PRESET|FILE): A preset or a scanner .yaml file; repeatable. [default: the column
            scanner]
        no_advice: Leave out what each site needs: much faster.
    """
    with reporting():
        if running.dask is None and running.workers != 0:
            from ambinav.runtime.workers import prepare_processes

            prepare_processes("ambinav.studies.fleet.unit")
        from ambinav.maps.address import Address
        from ambinav.studies.fleet.fleet import run_batch, run_fleet, units_of
        from ambinav.studies.fleet.report import PAGE, STUDY
        from ambinav.studies.fleet.sites import read_sites
        from ambinav.studies.fleet.unit import FleetSettings

        need("fleet audit", ("pyarrow",), "fleet")
        check_radius(radius, spacing)
        place = Address.of(output)
        conditions = gate.conditions(place.folder)
        part = running.part
        if part is not None and (conditions or as_json):
            raise InputError(
                f"{'--fail-if' if conditions else '--json'}: it is about the whole fleet, and "
                "--batch audits a part; give it to the last command, the one without --batch."
            )
        if place.folder is not None:
            check_writable(place.folder)
            STUDY.folder.check(place.folder)
        units = units_of(read_sites(sites), scanner or ())
        running.check()
        settings = FleetSettings(spacing, radius, robot_radius, not no_advice)
        with (
            resumable(output, "finished results are kept"),
            progress_bars(as_json or quiet) as bars,
        ):
            how: dict[str, Any] = {
                "workers": running.workers, "scheduler": running.dask, "progress": bars("sites")
            }  # fmt: skip
            if part is not None:
                results = run_batch(units, output, settings, part, **how)
            else:
                fleet = run_fleet(units, output, settings, **how)
        if part is not None:
            _show_part(results, part, quiet=quiet)
            return
        page = f"{output.rstrip('/')}/{PAGE}"
        finish(fleet.document, lambda _: _show(fleet), page, as_json=as_json, quiet=quiet)
        _judge(fleet, conditions, gate, sites, as_json=as_json or quiet)


def _show_part(results: Sequence[UnitDone], part: Batch, *, quiet: bool) -> None:
    from ambinav.reports.pages import counted

    _note_failed([unit.result for unit in results])
    if quiet:
        return
    made = sum(unit.was_made for unit in results)
    reused_text = f", {len(results) - made} were there" if made < len(results) else ""
    show(
        f"Part {part}: {counted(made, 'audit')} made{reused_text}.",
        "When all parts have ended, the same command without --batch writes the report.",
    )


def _judge(
    fleet: Fleet, conditions: Sequence[Condition], gate: FleetGate, sites: str, *, as_json: bool
) -> None:
    """Check the conditions, and name what failed.

    Raises:
        typer.Exit: with status 3: a condition holds at a site.
        InputError: all failed, or a condition cannot be checked at a site.
    """
    from ambinav.studies.fleet.gate import judge_fleet, names_of

    results = [unit.result for unit in fleet.results]
    if len(fleet.failed) == len(results):
        why = f"none of {len(results)} audits succeeded; the first one: {results[0].error}"
        unchecked = [(condition, why) for condition in conditions]
        gate.conclude((), sites, as_json=as_json, unchecked=unchecked)
        raise InputError(f"{sites}: {why}")
    _note_failed(results)
    outcomes, unchecked = [], []
    for condition in conditions:
        outcome, lacking = judge_fleet(condition, results)
        # What cannot be checked everywhere has not passed.
        if outcome is not None and (outcome.holds or not lacking):
            outcomes.append(outcome)
        else:
            why = (
                f"cannot be checked at {len(lacking)} of {len(results)}, {names_of(lacking)}; of "
                f"the first one: {lacking[0].error or 'no floor of it could be judged'}"
            )
            unchecked.append((condition, why))
    if any(outcome.holds for outcome in outcomes):
        for condition, why in unchecked:
            note(f'--fail-if: "{condition}" {why}')
    gate.conclude(outcomes, sites, as_json=as_json, unchecked=unchecked)
    if unchecked:
        condition, why = unchecked[0]
        raise InputError(f'--fail-if: "{condition}" {why}')


def _note_failed(results: Sequence[Result]) -> None:
    """Name the audits that failed."""
    from ambinav.studies.fleet.gate import names_of

    failed = [result for result in results if result.status == "failed"]
    if failed:
        note(
            f"{len(failed)} of {len(results)} audits failed, {names_of(failed)}; the first one: "
            f"{failed[0].error}"
        )


def _show(fleet: Fleet) -> None:
    from ambinav.reports.number_text import metres2, percent

    reused = len(fleet.results) - fleet.made
    reused_text = f", {reused} were there" if reused else ""
    show(
        fleet.document.summary,
        f"{fleet.made} {'audit' if fleet.made == 1 else 'audits'} made{reused_text}",
        "",
    )
    rows = sorted(
        (row for row in fleet.document.figures if row.bad_m2 is not None),
        key=lambda row: -(row.bad_m2 or 0.0),
    )
    columns = "site", "scanner", "bad floor", "share", "needs"
    shown = (
        (row.site, row.scanner, metres2(row.bad_m2 or 0.0), percent(row.bad_share or 0.0),
         row.advice or "")
        for row in rows[:SHOWN]
    )  # fmt: skip
    if rows:
        show(table(columns, shown, left=("site", "scanner", "needs"), fold=True))
    if len(rows) > SHOWN:
        show(f"and {len(rows) - SHOWN} more")
    mixes = (
        (", ".join(f"{name} ({len(sites)})" for name, sites in mix.scanners.items()),
         metres2(mix.bad_m2), percent(mix.worst_share))
        for mix in fleet.document.mixes
    )  # fmt: skip
    if fleet.document.mixes:
        headings = "best scanners (sites)", "bad floor", "worst site"
        show("", table(headings, mixes, left=headings[:1], fold=True))
