"""`ambinav calibrate`: fit what forecasts and maps assume to what was measured or driven."""

from __future__ import annotations

import typer

from ambinav.cli.calibrate_localizer import localizer
from ambinav.cli.calibrate_sensor import sensor

calibrate = typer.Typer(
    name="calibrate",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Fit a sensor to measured pairs, or the forecasts of a localizer to its drives.",
)
calibrate.command("sensor")(sensor)
calibrate.command("localizer")(localizer)
