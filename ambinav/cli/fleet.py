"""`ambinav fleet`: audits of many buildings."""

from __future__ import annotations

import typer

from ambinav.cli.fleet_audit import audit_fleet
from ambinav.cli.fleet_diff import diff_fleets

fleet = typer.Typer(
    name="fleet",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Audit many buildings, and compare two such audits.",
)
fleet.command("audit")(audit_fleet)
fleet.command("diff")(diff_fleets)
