"""Perceptual ambiguity maps: where a building leaves a range scanner lost.

The names below are loaded when they are first used, so that `import ambinav` stays quick and
pulls in no optional package.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ambinav.maps import updater
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.version import __version__

if TYPE_CHECKING:
    from ambinav.buildings.load import load_environment
    from ambinav.buildings.shapes import environment_from_shapes
    from ambinav.geometry.environment import Environment
    from ambinav.map_building.build import build_map
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.sensing.sensor import RangeSensor
    from ambinav.server.client import Client
    from ambinav.service.service import AmbiguityService

__all__ = [
    "AmbiguityMap",
    "AmbiguityService",
    "Client",
    "Environment",
    "InputError",
    "InputWarning",
    "RangeScanner",
    "RangeSensor",
    "__version__",
    "build_map",
    "environment_from_shapes",
    "load_environment",
]

_HOME = {
    "AmbiguityMap": "ambinav.maps.ambiguity_map",
    "AmbiguityService": "ambinav.service.service",
    "Client": "ambinav.server.client",
    "Environment": "ambinav.geometry.environment",
    "RangeScanner": "ambinav.sensing.scanner",
    "RangeSensor": "ambinav.sensing.sensor",
    "build_map": "ambinav.map_building.build",
    "environment_from_shapes": "ambinav.buildings.shapes",
    "load_environment": "ambinav.buildings.load",
}


def _update(
    amap: AmbiguityMap, env: Environment, *, progress: bool | Callable[[float], None] = False
) -> AmbiguityMap:
    # Imported late: it loads the kernels.
    from ambinav.map_building.update import updated

    return updated(amap, env, progress=progress)


updater.install(_update)


def __getattr__(name: str) -> Any:
    """Load a public name from its module on first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
