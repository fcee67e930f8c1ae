"""The command line: `ambinav audit | map | plan | export | compare | train | evaluate | ...`.

Every command lives in a module of its own, and imports what computes only when it runs, so that
`ambinav --help` answers at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from ambinav.cli import interrupts, positions
from ambinav.cli.audit import audit
from ambinav.cli.benchmark import benchmark
from ambinav.cli.calibrate_localizer import localizer
from ambinav.cli.calibrate_sensor import sensor
from ambinav.cli.card import card
from ambinav.cli.compare import compare
from ambinav.cli.dataset import dataset
from ambinav.cli.demo import demo
from ambinav.cli.design_beams import beams
from ambinav.cli.design_for import requirement
from ambinav.cli.design_place import place
from ambinav.cli.design_reflectors import reflectors
from ambinav.cli.design_scanners import scanners
from ambinav.cli.design_sweep import sweep
from ambinav.cli.diff import diff
from ambinav.cli.evaluate import evaluate
from ambinav.cli.export import export
from ambinav.cli.fleet_audit import audit_fleet
from ambinav.cli.fleet_diff import diff_fleets
from ambinav.cli.forecast import forecast
from ambinav.cli.map import build
from ambinav.cli.plan import plan
from ambinav.cli.plugins import plugins
from ambinav.cli.presets import presets
from ambinav.cli.running import INTERRUPTED, say
from ambinav.cli.serve import serve
from ambinav.cli.store import store
from ambinav.cli.train import train
from ambinav.runtime.processes import end_quickly

app = typer.Typer(
    name="ambinav",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("audit")(audit)
app.command("map")(build)
app.command("plan", cls=positions.Command)(plan)
app.command("forecast")(forecast)
app.command("export")(export)
app.command("compare")(compare)
app.command("diff")(diff)
app.command("train")(train)
app.command("evaluate")(evaluate)
app.command("benchmark")(benchmark)
app.command("card")(card)
app.command("dataset")(dataset)
app.command("demo")(demo)
app.command("serve")(serve)
app.command("presets")(presets)
app.command("plugins")(plugins)


def _add_group(name: str, text: str, **commands: Callable[..., None]) -> None:
    """Add commands under a common name, in the order of the help."""
    group = typer.Typer(name=name, no_args_is_help=True, rich_markup_mode="markdown", help=text)
    for command, function in commands.items():
        group.command(command)(function)
    app.add_typer(group)


_add_group(
    "calibrate",
    "Fit a sensor to measured pairs, or the forecasts of a localizer to its drives.",
    sensor=sensor,
    localizer=localizer,
)
_add_group(
    "design",
    "Choose and mount the scanner, and find what would help where it is lost.",
    sweep=sweep,
    scanners=scanners,
    beams=beams,
    place=place,
    reflectors=reflectors,
    **{"for": requirement},
)
_add_group(
    "fleet",
    "Audit many buildings, and compare two such audits.",
    audit=audit_fleet,
    diff=diff_fleets,
)
app.add_typer(store)


def _show_version(is_given: bool) -> None:
    if is_given:
        from ambinav import __version__

        typer.echo(f"ambinav {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Perceptual ambiguity maps: where a building leaves a range scanner lost.

    `ambinav --install-completion` lets the shell complete commands, options, presets and planners.
    """


def main() -> None:
    """Run the command line, and exit with its status.

    The status is 0 (success), 1 (internal error), 2 (invalid input), 3 (a condition of `--fail-if`
    holds, or what is verified differs) or 130 (interrupted).
    """
    # An interrupted or terminated run unwinds, so that it removes what it had begun to write.
    interrupts.install()
    try:
        app(prog_name="ambinav")
    except KeyboardInterrupt:
        # Before a command has begun or after it has ended: else the command reports it.
        say("ambinav: interrupted.")
        raise SystemExit(INTERRUPTED) from None
    finally:
        end_quickly()
