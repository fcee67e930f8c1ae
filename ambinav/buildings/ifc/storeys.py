"""Storeys of an IFC building, and the choice of one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import ifcopenshell.util.element
import ifcopenshell.util.placement
import ifcopenshell.util.unit

from ambinav.buildings.plan_levels import chosen_level

WHOLE = "building"
"""Name of the only level of a building without storeys."""


class Storey(NamedTuple):
    """Storey of a building.

    Attributes:
        name: Unique among the storeys of a file.
        elevation: Elevation of its floor, metres, in the world's frame.
        entity: The IfcBuildingStorey; None: the building has none.
    """

    name: str
    elevation: float
    entity: Any


def storeys_of(model: Any) -> list[Storey]:
    """Return the storeys of a file, lowest first; empty if it has none."""
    metre = ifcopenshell.util.unit.calculate_unit_scale(model)
    storeys = []
    for entity in model.by_type("IfcBuildingStorey"):
        height = ifcopenshell.util.placement.get_storey_elevation(entity)
        elevation = float(height or 0.0) * metre
        storeys.append((elevation, entity.Name or entity.LongName or "", entity))
    storeys.sort(key=lambda row: (row[0], row[1]))
    names = [name for _, name, _ in storeys]
    return [
        Storey(
            name if name and names.count(name) == 1 else f"{name or 'storey'} at {elevation:g} m",
            elevation,
            entity,
        )
        for elevation, name, entity in storeys
    ]


def chosen_storey(where: str, storeys: Sequence[Storey], level: str | int | None) -> Storey:
    """Choose a storey by name, or by position from 0, the lowest, on.

    Raises:
        InputError: there is no such storey, or there are several and none is chosen.
    """
    names = [storey.name for storey in storeys]
    listed = [f"{k}: {item.name} at {item.elevation:.4g} m" for k, item in enumerate(storeys)]
    name = chosen_level(where, names, level, listed)
    return next(storey for storey in storeys if storey.name == name)


def storey_of(element: Any) -> Any:
    """Return the storey of an element, or of the element it is a part of; None: no storey."""
    host = element
    while host is not None:
        if host.is_a("IfcBuildingStorey"):
            return host
        voids = getattr(host, "VoidsElements", ())
        if voids:
            host = voids[0].RelatingBuildingElement
        else:
            host = ifcopenshell.util.element.get_parent(host)
    return None


def base_of(lows: Sequence[float]) -> float:
    """Return the height at which most walls begin: the floor of a building without storeys.

    Args:
        lows: The lowest points of the walls, metres.
    """
    rounded = [round(low, 2) for low in lows]
    return max(sorted(set(rounded)), key=rounded.count, default=math.nan)
