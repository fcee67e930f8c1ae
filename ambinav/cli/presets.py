"""`ambinav presets`: the bundled scanners."""

from __future__ import annotations

import json
import math
from typing import Annotated

import typer

from ambinav.cli.options import AsJson, documented
from ambinav.cli.printing import show, table
from ambinav.cli.running import reporting


@documented
def presets(name: Annotated[str | None, typer.Argument()] = None, as_json: AsJson = False) -> None:
    """List the bundled scanners, or print one as YAML.

    Example: `ambinav presets hokuyo-urg-04lx > my-scanner.yaml`

    Parameters:
        name ([NAME]): Print this preset's YAML, e.g. as a template for your own file.
    """
    with reporting():
        from ambinav.sensing.preset_summary import preset_summaries
        from ambinav.sensing.presets import PRESETS

        if name is not None:
            text = PRESETS.get(name).yaml
            if as_json:
                import yaml

                typer.echo(json.dumps(yaml.safe_load(text), indent=2))
            else:
                typer.echo(text, nl=False)
            return
        summaries = preset_summaries()
        if as_json:
            rows = [
                {
                    "name": preset.name,
                    "kind": preset.kind,
                    "beams": preset.beams,
                    "aperture_deg": round(math.degrees(preset.aperture), 3),
                    "max_range_m": preset.max_range,
                    "description": preset.description,
                    "source": preset.source,
                }
                for preset in summaries
            ]
            typer.echo(json.dumps(rows, indent=2))
            return
        columns = "name", "kind", "beams", "aperture", "range", "description"
        shown = (preset.row()[:6] for preset in summaries)
        left = "name", "kind", "description"
        show(table(columns, shown, left=left, no_wrap=columns[:-1], fold=True))
