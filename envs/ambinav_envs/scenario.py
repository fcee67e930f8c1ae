"""Buildings and parameters of an environment from the arguments of `gymnasium.make`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ambinav.config import checked
from ambinav.geometry.environment import Environment
from ambinav.layers.registry import on_request
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.buildings.suites import SUITES
from ambinav_envs.buildings.suites import suite as named
from ambinav_envs.map_file import MapFile
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.registration import with_task

SUITE = "procedural"
"""The suite of buildings that is drawn from if neither a suite nor a map is named."""


def scenario(
    suite: str | None,
    map: str | Path | Mapping[str, Any] | Environment | None,
    buildings: int | None,
    first_building: int | None,
    max_episode_steps: int | None,
    options: dict[str, Any],
) -> tuple[BuildingSource, NavigationParameters]:
    """Return the source of the buildings, and the parameters.

    Args:
        suite: Name of a suite of buildings, whatever files there are.
        map: An environment file, whatever suites there are, or an environment, instead; or the file
            with how it is read, see `map_file.MapFile`.
        buildings: How many of the suite's buildings are drawn from; None: a new one every time, or
            as many as the task says.
        first_building: Number of the first of them; None: that of the task, or 0.
        max_episode_steps: As the parameter `max_steps`, by the name that Gymnasium has for it;
            `gymnasium.make` keeps it to itself and does not pass it on.
        options: Fields of `NavigationParameters`.

    Raises:
        InputError: something of it is unknown or of no use.
    """
    if options.get("task") is not None:
        settings = {
            "suite": suite, "map": map, "buildings": buildings,
            "first_building": first_building, "max_episode_steps": max_episode_steps,
        }  # fmt: skip
        given_settings = {name: value for name, value in settings.items() if value is not None}
        options = with_task({**options, **given_settings})
        suite, map = options.pop("suite", None), options.pop("map", None)
        buildings = options.pop("buildings", None)
        first_building = options.pop("first_building", None)
        max_episode_steps = options.pop("max_episode_steps", None)
    if max_episode_steps is not None:
        options = options | {"max_steps": max_episode_steps}
    parameters = NavigationParameters.of(options)
    source = BuildingSource(
        _buildings_of(suite, map, parameters), parameters.scanner, parameters.robot.radius,
        count=buildings, first=0 if first_building is None else first_building,
        layers=on_request(parameters.cost_layer),
    )  # fmt: skip
    return source, parameters


def source_of(arguments: Mapping[str, Any]) -> tuple[BuildingSource, NavigationParameters]:
    """Return buildings and parameters of an environment, given arguments of `gymnasium.make`.

    Raises:
        InputError: one of them cannot be used.
    """
    options = dict(arguments)
    count, steps = options.pop("buildings", None), options.pop("max_episode_steps", None)
    suite, place = options.pop("suite", None), options.pop("map", None)
    return scenario(suite, place, count, options.pop("first_building", None), steps, options)


def _buildings_of(
    suite: object, map: object, parameters: NavigationParameters
) -> str | Path | Environment:
    """Return the name of a suite, or a map."""
    if suite is not None and map is not None:
        raise InputError(
            f"suite is {suite!r}, perhaps by the name of the id, and map is given too; give one of "
            "the two, and a map to the id ambinav/Navigation-v1 alone."
        )
    if map is not None:
        if isinstance(map, Mapping):
            map_file = checked(MapFile, map, "map")
            return map_file.load(map_file.file, parameters.scanner, parameters.robot.radius)
        if not isinstance(map, str | Path | Environment):
            raise InputError(
                f"map is of the type {type(map).__name__}; give an environment file, a mapping "
                "with the key file, or an Environment."
            )
        if isinstance(map, str) and map in SUITES.names():
            raise InputError(f"map is {map!r}, which is a suite; give suite={map!r}, or a file.")
        return Path(map) if isinstance(map, str) else map
    if suite is None:
        return SUITE
    if not isinstance(suite, str):
        raise InputError(
            f"suite is of the type {type(suite).__name__}; give a suite's name, or map."
        )
    if Path(suite).suffix:
        raise InputError(f"suite is {suite!r}, which is a file's name; give it as map.")
    return named(suite).name
