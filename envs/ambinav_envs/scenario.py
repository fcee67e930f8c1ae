"""What the environments are made of, from the arguments that `gymnasium.make` passes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ambinav.ambiguity.layers.registry import on_request
from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.parameters import NavigationParameters

SUITE = "procedural"
"""The suite of buildings that is drawn from if neither a suite nor a map is named."""


def scenario(
    suite: str | None,
    map: str | Path | Environment | None,
    buildings: int | None,
    first_building: int,
    max_episode_steps: int | None,
    options: dict[str, Any],
) -> tuple[BuildingSource, NavigationParameters]:
    """Where the buildings come from, and the parameters.

    Args:
        suite: Name of a suite of buildings.
        map: An environment file, or an environment, instead.
        buildings: How many of the suite's buildings are drawn from; None: a new one every time.
        first_building: Number of the first of them.
        max_episode_steps: As the parameter `max_steps`, by the name that Gymnasium has for it.
        options: Fields of `NavigationParameters`.

    Raises:
        InputError: something of it is unknown or of no use.
    """
    if suite is not None and map is not None:
        raise InputError(f"suite is {suite!r} and map {map!r}; give one of the two.")
    if max_episode_steps is not None:
        options = options | {"max_steps": max_episode_steps}
    parameters = NavigationParameters.of(options)
    what = map if map is not None else SUITE if suite is None else suite
    source = BuildingSource(
        what, parameters.scanner, parameters.robot.radius, count=buildings, first=first_building,
        layers=on_request(parameters.layer),
    )  # fmt: skip
    return source, parameters
