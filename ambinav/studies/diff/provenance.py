"""Differences in the inputs and parameters of two maps."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Set
from typing import Final

import numpy as np
import yaml
from pydantic import Field

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.fields import Part
from ambinav.reports.pages import cell

_PLAIN: Final = ("environment", "environment_sha256", "scanner", "cost_layer", "ambinav_version")
FILE: Final = ("environment", "environment_sha256")
"""Attributes that name the file of a building."""
_BUILDING: Final = frozenset({"segments", "segment_kind", "floor", "drivable", "space"})
"""Variables that hold the building: walls and outlines."""
_JSON: Final = ("environment_resolution", "parameters", "versions")
_RESULTS: Final = frozenset({"parameters.free_poses"})
"""Not chosen by anybody: they follow from the rest."""
_ABSENT: Final = "-"


class ParameterPart(Part):
    """A parameter that differs, with its values in the first and in the second map."""

    name: str = Field(description="with dots between nested keys")
    before: str = Field(description='as text; "-": the first map has none')
    after: str


def differing_parameters(first: AmbiguityMap, second: AmbiguityMap) -> tuple[ParameterPart, ...]:
    """Return the parameters, scanner, building and versions that differ, in the maps' order.

    Two files of one building differ in name and bytes alone; neither is listed then.
    """
    ours, theirs = (dict(_parameters(amap)) for amap in (first, second))
    if same_content(first, second, _BUILDING):
        for name in FILE:
            ours.pop(name), theirs.pop(name)
    return tuple(
        ParameterPart(name=name, before=_text(ours, name), after=_text(theirs, name))
        for name in dict.fromkeys([*ours, *theirs])
        if name not in _RESULTS and ours.get(name, _ABSENT) != theirs.get(name, _ABSENT)
    )


def same_content(first: AmbiguityMap, second: AmbiguityMap, only: Set[str] | None = None) -> bool:
    """Return whether layers, walls and outlines are the same, bit for bit.

    Args:
        first: A map.
        second: Another.
        only: Names of the variables that count, where a map has them; None: all.
    """
    ours, theirs = first.dataset, second.dataset
    names = set(ours.variables) if only is None else set(ours.variables) & only
    if names != (set(theirs.variables) if only is None else set(theirs.variables) & only):
        return False
    return all(
        ours[name].dims == theirs[name].dims
        and np.array_equal(
            ours[name].values, theirs[name].values, equal_nan=ours[name].dtype.kind == "f"
        )
        for name in names
    )


def _parameters(amap: AmbiguityMap) -> Iterator[tuple[str, object]]:
    attrs = amap.dataset.attrs
    for name in _PLAIN:
        yield name, attrs.get(name, _ABSENT)
    yield from _flatten("scanner", yaml.safe_load(attrs.get("scanner_yaml", "")))
    for name in _JSON:
        yield from _flatten(name, json.loads(attrs.get(name, "null")))
    yield "building in space", str(attrs.get("environment_space", ""))[:12] or "a plan"
    yield "floor z", json.loads(attrs.get("environment_floor", "0.0"))
    # The robot whose floor counts, which needs no other map.
    yield "judged.robot_radius", amap.judged.radius
    yield from _flatten("judged.start", amap.judged.start)


def _flatten(name: str, value: object) -> Iterator[tuple[str, object]]:
    """Flatten a nested value to single values with dotted names."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _flatten(f"{name}.{key}", part)
    elif isinstance(value, list) and any(isinstance(part, Mapping | list) for part in value):
        for key, part in enumerate(value):
            yield from _flatten(f"{name}.{key}", part)
    elif value is not None:
        yield name, value


def _text(values: Mapping[str, object], name: str) -> str:
    return cell(values[name]) if name in values else _ABSENT
