"""`ambinav demo`: the main commands, run one after the other on the bundled building."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, note, reporting
from ambinav.demo import DEMO_BUILDING, DEMO_GOAL, DEMO_SCANNER, DEMO_SCENARIO, DEMO_START

MAP, REPORT, COMPARED = "map.zarr", "report", "compare"
ITERATIONS = 8000
"""Iterations of OMPL's planner, whose route is compared with the reference planner's."""


def demo(
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for all that is made; what an earlier demo left there is replaced.",
        ),
    ] = Path("ambinav-demo"),
    as_json: options.AsJson = False,
) -> None:
    """Audit the bundled building, plan through it and drive the routes; takes minutes.

    Each command is shown before it runs, so that it can be tried with another building. Without
    OMPL the routes of its planners are left out, and so are the drives.

    Example: `ambinav demo -o out/demo`
    """
    with reporting():
        check_writable(output)
        _check_output(output)
        output.mkdir(parents=True, exist_ok=True)
        with_ompl = find_spec("ompl") is not None
        if not with_ompl:
            note(
                "OMPL is not installed: its planners' routes and the drives are left out; run: "
                'pip install "ambinav[planners]".'
            )
        _run_all(output, with_ompl, as_json)
        reports = [output / REPORT / "report.html"]
        reports += [output / COMPARED / "report.html"] if with_ompl else []
        pictures = sorted(output.rglob("*.png"))
        if as_json:
            made = {"reports": reports, "pictures": pictures}
            typer.echo(
                json.dumps({key: [str(path) for path in made[key]] for key in made}, indent=2)
            )
            return
        typer.echo("\nThe reports, to open in a browser:")
        typer.echo("\n".join(f"  {path}" for path in reports))
        typer.echo("The pictures:")
        typer.echo("\n".join(f"  {path}" for path in pictures))


def steps(output: Path, with_ompl: bool) -> list[list[str]]:
    """Return the commands that make the map and plan on it, in order, without `ambinav`."""
    amap = str(output / MAP)
    ends = ["--start", *map(_number, DEMO_START), "--goal", *map(_number, DEMO_GOAL)]
    plan = ["plan", amap, *ends]
    commands = [
        ["audit", str(DEMO_BUILDING), "--scanner", DEMO_SCANNER, "--save-map", amap,
         "-o", str(output / REPORT)],
        [*plan, "--planner", "reference", "--shortest", "-o", str(output / "route.csv"),
         "--picture", str(output / "routes.png")],
        [*plan, "--planner", "reference", "--pareto", "-o", str(output / "pareto")],
    ]  # fmt: skip
    if with_ompl:
        commands.append(
            [*plan, "--planner", "prmstar", "--time", "inf", "--iterations", str(ITERATIONS),
             "--seed", "1", "-o", str(output / "route-ompl.csv")]
        )  # fmt: skip
    return commands


def _run_all(output: Path, with_ompl: bool, quiet: bool) -> None:
    """Run the commands; the drives run in parallel on another core and are printed last.

    Raises:
        typer.Exit: a command failed; with its exit status.
    """
    compare = ["compare", str(DEMO_SCENARIO), "-o", str(output / COMPARED)]
    with tempfile.TemporaryFile("w+") as log:
        beside = _start(compare, log, log) if with_ompl else None
        try:
            for arguments in steps(output, with_ompl):
                _show(arguments, quiet)
                _follow(_start(arguments, subprocess.DEVNULL if quiet else None, None))
            if beside is None:
                return
            _show(compare, quiet)
            status = beside.wait()
            log.seek(0)
            if status or not quiet:
                typer.echo(log.read(), err=bool(status), nl=False)
            if status:
                raise typer.Exit(status)
        finally:
            if beside is not None:
                _terminate(beside)


def _start(
    arguments: Sequence[str], out: IO[str] | int | None, err: IO[str] | None
) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "ambinav.cli", *arguments], stdout=out, stderr=err
    )


def _follow(process: subprocess.Popen[bytes]) -> None:
    try:
        status = process.wait()
    finally:
        _terminate(process)
    if status:
        raise typer.Exit(status)


def _terminate(process: subprocess.Popen[bytes]) -> None:
    """Terminate a running command and wait until it has cleaned up."""
    if process.poll() is None:
        process.terminate()
        process.wait()


def _show(arguments: Sequence[str], quiet: bool) -> None:
    if not quiet:
        typer.echo(f"\n$ {shlex.join(['ambinav', *arguments])}")
        sys.stdout.flush()


def _check_output(output: Path) -> None:
    """Check the folders that the commands would refuse, before any of them runs.

    Raises:
        InputError: one holds what is not of an earlier demo.
    """
    from ambinav.studies.audit import report as audit_report
    from ambinav.studies.compare import report as compare_report

    audit_report.STUDY.folder.check(output / REPORT)
    compare_report.STUDY.folder.check(output / COMPARED)


def _number(value: float) -> str:
    return f"{value:g}"
