"""Digests of environments and maps by their content, to name results made from them."""

from __future__ import annotations

import inspect
from typing import Final

from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.provenance import digest_of

# What an environment is called, where it was read from, and the bytes of that file, which another
# comment or file name changes; the rest decides numbers, the occupied cells by way of `drivable`.
_NAMES: Final = ("name", "source", "checksum", "notes", "occupancy")
# Attributes that define an ambiguity map; the others record when and where it was made.
_MAP_ATTRIBUTES: Final = ("parameters", "scanner_yaml", "cost_layer", "frame", "units")


def environment_digest(environment: Environment) -> str:
    """Compute the digest of an environment's content, without its name and location.

    Neither a file's name and time of change nor how it is written matters, only what was read
    from it: pixels, thresholds, resolution and origin of a map_server file, shapes of a drawing.
    """
    made_of = [name for name in inspect.signature(type(environment)).parameters]
    content = {name: getattr(environment, name) for name in made_of if name not in _NAMES}
    if environment.space is not None:
        content["space"] = environment.space.checksum
    return digest_of(content)


def map_digest(amap: AmbiguityMap) -> str:
    """Compute the digest of a map's content: its arrays, its scanner and its parameters."""
    dataset = amap.dataset
    arrays = {str(name): (array.dims, array.values) for name, array in dataset.variables.items()}
    return digest_of(arrays, {name: dataset.attrs.get(name) for name in _MAP_ATTRIBUTES})
