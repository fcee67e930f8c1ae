"""Unit of a drawn plan, from its numbers and its reference system, and questions about it.

A plan in degrees or millimetres is a plan like any other to the geometry: it comes out as a
building of a tenth of a millimetre, or of ten kilometres. Nobody can tell a hall of 40 m from a
cupboard of 40 cm by its numbers alone, so only what no building has is asked about.
"""

from __future__ import annotations

import re
import reprlib
import warnings
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.runtime.errors import InputError, InputWarning

UNITS: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres in each unit that a plan may be drawn in."""

# In the plan's own numbers. No robot drives in a plan smaller than this in metres; a kilometre of
# a town is 0.01 degrees.
SMALLEST: Final = 0.5
# No building is larger than this in metres; a room is larger in millimetres, a house in
# centimetres.
LARGEST: Final = 1000.0
# No wall is thicker, and no plan has only wider doors, in metres.
THICKEST: Final = 3.0
WIDEST: Final = 50.0

# Reference systems of longitude and latitude by the last part of their name: WGS 84 and CRS84,
# ETRS89, NAD83, NAD27, and those with a height.
_DEGREES: Final = frozenset(
    [
        *("4326", "4979", "4258", "4937", "4269", "4267", "4955", "4283", "4490"),
        *("wgs84", "crs84", "crs84h", "crs83", "crs27"),
    ]
)
# Metres in name only: a length of this map is 1 / cos(latitude) times that of the ground.
_MERCATOR: Final = frozenset(("3857", "900913", "3785"))


class Sizes(NamedTuple):
    """Parts of a plan whose size in a building is known, in the plan's own unit.

    Attributes:
        shapes: Everything that is drawn.
        thicknesses: Thicknesses of its walls.
        openings: Lengths of its openings.
    """

    shapes: Sequence[BaseGeometry]
    thicknesses: Sequence[float] = ()
    openings: Sequence[float] = ()


def metres_in(unit: str | None, where: str) -> float:
    """Return the length of a unit in metres; 1 for None.

    Raises:
        InputError: there is no such unit.
    """
    if unit is None:
        return 1.0
    if unit not in UNITS:
        raise InputError(f"{where}: unit is {unit!r}; it must be {', '.join(UNITS)}.")
    return UNITS[unit]


def check_frame(where: str, crs: object, unit: str | None, notes: list[str]) -> None:
    """Check the reference system in the member `crs` of a GeoJSON file, if there is one.

    Args:
        where: The file.
        crs: The member, or None; that of our own files is known.
        unit: What the user says that the numbers are in.
        notes: A remark is added to them: the system is not used.

    Raises:
        InputError: its coordinates are longitude and latitude.

    Warns:
        InputWarning: the system is not used.
    """
    if crs in (None, MAP_FRAME["crs"]):
        return
    name = _crs_name(crs)
    last = re.split(r"[:/#]", name)[-1].strip().lower().replace(" ", "")
    if last in _DEGREES:
        raise InputError(
            f"{where}: crs {name!r} is longitude and latitude in degrees; project the plan to "
            "metres first, e.g. to the UTM zone of the place."
        )
    named = reprlib.repr(name) if name else reprlib.repr(crs)
    stretched = " (which web Mercator stretches by 1 / cos(latitude))" if last in _MERCATOR else ""
    note = (
        f"{where}: crs {named} is not used; coordinates count as {unit or 'metres'} in the map "
        f"frame{stretched}."
    )
    warnings.warn(note, InputWarning, stacklevel=3)
    notes.append(note)


def _crs_name(crs: object) -> str:
    """Return the name in a crs {"type": "name", "properties": {"name": ...}}, or ""."""
    if isinstance(crs, str):
        return crs
    properties: Any = crs.get("properties") if isinstance(crs, dict) else None
    if isinstance(properties, dict):
        for key in ("name", "code", "href"):
            if isinstance(properties.get(key), str | int):
                return str(properties[key])
    return ""


def check_size(where: str, sizes: Sizes, unit: str | None) -> None:
    """Raise `InputError` for a plan whose size in metres is not plausible for a building.

    Args:
        where: The file.
        sizes: What is in it, in its own numbers.
        unit: What the user says that the numbers are in; they are believed.

    Raises:
        InputError: no unit is given, and as metres the plan would be smaller or larger than any
            building, its walls thicker or all of its doors wider.
    """
    if unit is not None:
        return
    west, south, east, north = shapely.total_bounds(list(sizes.shapes)).tolist()
    width, height = east - west, north - south
    if 0.0 < max(width, height) < SMALLEST:
        # Latitude may come first.
        x, y = max(abs(west), abs(east)), max(abs(south), abs(north))
        degrees = max(x, y) <= 180.0 and min(x, y) <= 90.0
        looks = "no robot drives in it"
        if degrees:
            looks = "its numbers look like longitude and latitude in degrees"
        raise InputError(
            f"{where}: the plan is {width:.2g} by {height:.2g} m in all and {looks}; give "
            "coordinates in metres, e.g. of the UTM zone of the place, or say with --unit that "
            "they are."
        )
    ask = f"say with --unit what its numbers are in, one of {', '.join(UNITS)}."
    if max(width, height) > LARGEST:
        raise InputError(
            f"{where}: the plan is {width:.6g} by {height:.6g} m in all, more than a building has; "
            f"{ask}"
        )
    if max(sizes.thicknesses, default=0.0) > THICKEST:
        raise InputError(
            f"{where}: a wall has the thickness {max(sizes.thicknesses):g} m, more than any has; "
            f"{ask}"
        )
    if min(sizes.openings, default=0.0) > WIDEST:
        raise InputError(
            f"{where}: the narrowest opening is {min(sizes.openings):.4g} m wide, more than a "
            f"door; {ask}"
        )
