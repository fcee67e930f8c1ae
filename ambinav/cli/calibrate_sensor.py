"""`ambinav calibrate sensor`: fit a sensor to measured pairs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ambinav.cli.limits import above_zero, not_negative
from ambinav.cli.options import AsJson, documented
from ambinav.cli.running import check_apart, check_file, reporting
from ambinav.runtime.errors import InputError


@documented
def sensor(
    pairs: Annotated[Path, typer.Argument()],
    output: Annotated[Path, typer.Option("--output", "-o")],
    max_range: Annotated[float, above_zero("5.6")],
    resolution: Annotated[float, above_zero("0.001")],
    min_range: Annotated[float, not_negative("0.02")] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Fit a sensor's bias and deviation to measured pairs, and show the residuals.

    Example: `ambinav calibrate sensor pairs.csv -o sensor.yaml --max-range 5.6 --resolution 0.001`

    Parameters:
        pairs (CSV): Measured pairs: columns true_range and reading, metres.
        output (FILE): Sensor file to write.
        max_range (M): Largest range that is read, metres.
        resolution (M): Resolution of the readings, metres.
        min_range (M): Smallest range that is read, metres.
    """
    with reporting():
        if min_range >= max_range:
            raise InputError(
                f"--min-range: {min_range:g} m is not below --max-range {max_range:g} m; "
                "give less, or raise the other."
            )
        check_file(output)
        check_apart(output, pairs)
        from ambinav.sensing.sensor import RangeSensor

        fitted = RangeSensor.fit(
            pairs, max_range=max_range, resolution=resolution, min_range=min_range
        )
        fit = fitted.calibration
        assert fit is not None, "RangeSensor.fit keeps its calibration"
        fitted.to_yaml(output)
        if as_json:
            residuals = fit.residuals
            result = {
                "output": str(output),
                "pairs": int(residuals.size),
                "sensor": fitted.to_plain(),
                "residual_rms_m": round(float((residuals**2).mean() ** 0.5), 6),
                "residual_largest_m": round(float(abs(residuals).max()), 6),
            }
            typer.echo(json.dumps(result, indent=2))
        else:
            typer.echo(fit.report())
            typer.echo(
                f'sensor: {output} (in a scanner file, put its lines under "sensor:" of a part)'
            )
