"""`ambinav demo`: the main commands, run one after the other on the bundled building."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, note, reporting
from ambinav.demo import DEMO_BUILDING, DEMO_DRIVES, DEMO_GOAL, DEMO_SCANNER, DEMO_START

MAP, REPORT, COMPARED = "map.zarr", "report", "compare"


def demo(
    context: typer.Context,
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
    """Audit the bundled building, plan through it and drive routes of OMPL; takes a minute or two.

    Each command is shown before it runs, so that it can be tried with another building. Without
    OMPL the drives are left out.

    Example: `ambinav demo -o out/demo`
    """
    with reporting():
        check_writable(output / MAP)
        _check_output(output)
        output.mkdir(parents=True, exist_ok=True)
        with_ompl = find_spec("ompl") is not None
        if not with_ompl:
            note(
                "OMPL is not installed: its routes and their drives are left out; run: "
                'pip install "ambinav[planners]".'
            )
        _run_all(context.find_root().command.main, output, with_ompl, as_json)
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


def steps(output: Path) -> list[list[str]]:
    """Return the commands that make the map and plan on it, in order, without `ambinav`."""
    amap = str(output / MAP)
    return [
        ["audit", str(DEMO_BUILDING), "--scanner", DEMO_SCANNER, "--save-map", amap,
         "-o", str(output / REPORT)],
        ["plan", amap, "--start", *map(_number, DEMO_START), "--goal", *map(_number, DEMO_GOAL),
         "--planner", "reference", "--shortest", "-o", str(output / "route.csv"),
         "--picture", str(output / "routes.png")],
    ]  # fmt: skip


def _run_all(program: Callable[..., Any], output: Path, with_ompl: bool, quiet: bool) -> None:
    """Run the commands; the drives run beside them in another process and are printed last.

    Raises:
        typer.Exit: a command failed; with its exit status.
    """
    compare = ["compare", str(DEMO_DRIVES), "-o", str(output / COMPARED)]
    with tempfile.TemporaryFile("w+") as log:
        beside = None
        if with_ompl:
            command = [sys.executable, "-m", "ambinav.cli", *compare]
            beside = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            for arguments in steps(output):
                _show(arguments, quiet)
                _run(program, arguments, quiet)
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


def _run(program: Callable[..., Any], arguments: list[str], quiet: bool) -> None:
    """Run a command in this process, which has imported and compiled for the one before it.

    Raises:
        typer.Exit: it failed; with its exit status.
    """
    with contextlib.redirect_stdout(io.StringIO()) if quiet else contextlib.nullcontext():
        status = program(arguments, standalone_mode=False)
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
