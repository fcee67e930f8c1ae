"""The command line: `ambinav audit | map | plan | export | compare | train | evaluate | ...`.

Every command lives in a module of its own, and imports what computes only when it runs, so that
`ambinav --help` answers at once.
"""

from __future__ import annotations

from typing import Annotated

import typer

from ambinav.cli import interrupts, positions
from ambinav.cli.audit import audit
from ambinav.cli.benchmark import benchmark
from ambinav.cli.calibrate import calibrate
from ambinav.cli.card import card
from ambinav.cli.compare import compare
from ambinav.cli.dataset import dataset
from ambinav.cli.demo import demo
from ambinav.cli.design import design
from ambinav.cli.diff import diff
from ambinav.cli.evaluate import evaluate
from ambinav.cli.export import export
from ambinav.cli.fleet import fleet
from ambinav.cli.forecast import forecast
from ambinav.cli.map import build
from ambinav.cli.plan import plan
from ambinav.cli.plugins import plugins
from ambinav.cli.presets import presets
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
app.add_typer(calibrate)
app.add_typer(design)
app.add_typer(fleet)
app.add_typer(store)


def _show_version(wanted: bool) -> None:
    if wanted:
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
        app()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    finally:
        end_quickly()
