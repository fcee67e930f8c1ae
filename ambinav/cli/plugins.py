"""`ambinav plugins`: all that can be plugged in, and who brings it."""

from __future__ import annotations

import json
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import typer

from ambinav.cli.options import AsJson
from ambinav.cli.running import note, reporting

if TYPE_CHECKING:
    from ambinav.plugins import Registry


def plugins(as_json: AsJson = False) -> None:
    """List layers, planners, exporters and other entries, and the package that provides each.

    A plug-in that is broken is listed with its error.

    Example: `ambinav plugins --json`
    """
    with reporting():
        listed = {registry: registry.listed() for registry in _registries()}
        if as_json:
            groups = [
                {
                    "kind": registry.what,
                    "group": registry.group,
                    "entries": [entry._asdict() for entry in entries],
                }
                for registry, entries in listed.items()
            ]
            typer.echo(json.dumps(groups, indent=2))
            return
        from rich.console import Console
        from rich.table import Table

        table = Table(box=None, pad_edge=False)
        for title in ("kind", "name", "from", "place or error"):
            table.add_column(title, no_wrap=title != "place or error", overflow="fold")
        for registry, entries in listed.items():
            for entry in entries:
                origin = entry.distribution or "a module"
                place = entry.error or entry.file or entry.place or ""
                table.add_row(registry.what, entry.name, origin, place)
        Console(highlight=False, markup=False).print(table)


def _registries() -> tuple[Registry[Any], ...]:
    """Return all registries whose packages are installed."""
    from ambinav.plugin import (
        EXPORTERS,
        LAYERS,
        LOCALIZERS,
        MAP_READERS,
        PRESETS,
        SENSOR_MODELS,
    )
    from ambinav_planners.plugin import PLANNERS

    core = (PRESETS, SENSOR_MODELS, LAYERS, MAP_READERS, EXPORTERS, PLANNERS, LOCALIZERS)
    if find_spec("gymnasium") is None:
        note('rewards and observations need gymnasium; run: pip install "ambinav[envs]".')
        return core
    from ambinav_envs.plugin import OBSERVATIONS, REWARD_TERMS

    return (*core, REWARD_TERMS, OBSERVATIONS)
