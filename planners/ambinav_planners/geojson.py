"""Features of a GeoJSON file with their labels for messages."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ambinav.buildings.plan_units import check_frame
from ambinav.config import as_number, read_text
from ambinav.config.numbers import shown
from ambinav.runtime.errors import InputError


class Feature(NamedTuple):
    """Feature of a file.

    Attributes:
        label: File and index, counted from 0.
        properties: As they stand there.
        geometry: GeoJSON with a type.
    """

    label: str
    properties: Mapping[str, Any]
    geometry: Mapping[str, Any]


def read_features(path: Path, contents: str, *, frame: bool = True) -> Iterator[Feature]:
    """Yield the features of a FeatureCollection.

    Args:
        path: The file.
        contents: Names what it should hold.
        frame: Whether a member `crs` is looked at, see `check_frame`; else it says nothing.

    Raises:
        InputError: it cannot be read, or a feature has no geometry.
    """

    def refuse(name: str) -> None:  # NaN or Infinity, which could not be written back
        raise InputError(f"{path}: it holds {name}, which is not valid JSON; correct the file.")

    try:
        document = json.loads(read_text(path), parse_constant=refuse)
    except (json.JSONDecodeError, RecursionError) as error:
        where = f" in line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}: this is not valid JSON{where}; correct the file.") from error
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise InputError(
            f"{path}: features is {shown(features)}; give {contents}, a GeoJSON FeatureCollection."
        )
    if frame:
        check_frame(str(path), document.get("crs"), None, [])
    for k, feature in enumerate(features):
        label = f"{path}: features[{k}]"
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        if not isinstance(geometry, dict) or not isinstance(geometry.get("type"), str):
            raise InputError(f"{label}: geometry is {shown(geometry)}; give it one of GeoJSON.")
        properties = feature.get("properties") or {}
        if not isinstance(properties, dict):
            raise InputError(f"{label}: properties is {shown(properties)}; give an object.")
        yield Feature(label, properties, geometry)


def list_of(label: str, value: object) -> list[Any]:
    """Return a list of coordinates, checked to be one."""
    if not isinstance(value, list):
        raise InputError(f"{label}: coordinates hold {shown(value)} where a list must be.")
    return value


def point_of(label: str, value: object) -> tuple[float, float]:
    """Return x and y of a point, checked to be finite numbers."""
    point = list_of(label, value)
    try:
        x, y = (as_number(value, "") for value in point[:2])
    except ValueError:
        raise InputError(
            f"{label}: coordinates hold {shown(point)}; give x and y in metres."
        ) from None
    return x, y
