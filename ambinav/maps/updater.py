"""Function behind `AmbiguityMap.update`, as packages that compute maps import this one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_installed: list[Callable[..., Any]] = []


def install(updater: Callable[..., Any]) -> None:
    """Set the function that `AmbiguityMap.update` calls: `ambinav.map_building.update.updated`."""
    _installed[:] = [updater]


def installed() -> Callable[..., Any]:
    """Return the function that `AmbiguityMap.update` calls; `import ambinav` installs one."""
    (updater,) = _installed
    return updater
