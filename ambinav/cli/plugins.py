"""`ambinav plugins`: all that can be plugged in, and who brings it."""

from __future__ import annotations

import json
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import typer

from ambinav.cli.options import AsJson
from ambinav.cli.printing import show, table
from ambinav.cli.running import note, reporting

if TYPE_CHECKING:
    from ambinav.plugins import Registry


def plugins(as_json: AsJson = False) -> None:
    """List layers, planners, tasks and other entries, and the package that provides each.

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
        rows = (
            (
                registry.what,
                entry.name,
                entry.distribution or "a module",
                entry.error or entry.file or entry.place or "",
            )
            for registry, entries in listed.items()
            for entry in entries
        )
        columns = "kind", "name", "from", "place or error"
        show(table(columns, rows, left=columns, no_wrap=columns[:-1], fold=True))


def _registries() -> tuple[Registry[Any], ...]:
    """Return all registries whose packages are installed."""
    from ambinav.plugin import EXPORTERS, LAYERS, LOCALIZERS, MAP_READERS, PRESETS, SENSOR_MODELS
    from ambinav_planners.plugin import PLANNERS

    core = (PRESETS, SENSOR_MODELS, LAYERS, MAP_READERS, EXPORTERS, PLANNERS, LOCALIZERS)
    if find_spec("gymnasium") is None:
        note(
            "tasks, suites, rewards and observations need gymnasium; run: pip install "
            '"ambinav[envs]".'
        )
        return core
    from ambinav_envs.plugin import OBSERVATIONS, REWARD_TERMS, SUITES, TASKS

    return (*core, REWARD_TERMS, OBSERVATIONS, TASKS, SUITES)
