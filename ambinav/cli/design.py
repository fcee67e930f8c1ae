"""`ambinav design`: choose and mount the scanner, and find what would help."""

from __future__ import annotations

import typer

from ambinav.cli.design_beams import beams
from ambinav.cli.design_for import requirement
from ambinav.cli.design_place import place
from ambinav.cli.design_reflectors import reflectors
from ambinav.cli.design_scanners import scanners
from ambinav.cli.design_sweep import sweep

design = typer.Typer(
    name="design",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Choose and mount the scanner, and find what would help where it is lost.",
)


@design.callback()
def _main() -> None:
    """Keep the subcommands below even if there is only one."""


design.command("sweep")(sweep)
design.command("scanners")(scanners)
design.command("beams")(beams)
design.command("place")(place)
design.command("reflectors")(reflectors)
design.command("for")(requirement)
