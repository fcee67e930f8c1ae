"""The building as a map keeps it: walls, outlines, and where they were read from."""

from __future__ import annotations

import json
from pathlib import Path

import shapely
import xarray as xr
from shapely.geometry.base import BaseGeometry

from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments


def kept_environment(dataset: xr.Dataset, source: str) -> Environment:
    """The building that a map was computed from, as far as a robot can meet it.

    Args:
        dataset: The map.
        source: Named in error messages: where the map comes from.

    Returns:
        Of a map that was made from an occupancy grid before occupied cells were kept, one that can
        be looked at but not planned in: its `collision` raises an InputError.

    Raises:
        InputError: the outline of the free space cannot be read.
    """
    attrs = dataset.attrs
    file, kept = str(attrs.get("environment_source", "")), attrs.get("collision")
    on_grid = Path(file).suffix.lower() in ("", ".yaml", ".yml")
    corners = json.loads(attrs.get("environment_extent", "[]"))
    made = (_WithoutCells if kept is None and on_grid else Environment)(
        Segments(dataset["segments"].values, dataset["segment_kind"].values),
        _outline(dataset, "floor", "free space", source),
        name=str(attrs["environment"]),
        source=Path(file) if file else None,
        checksum=str(attrs.get("environment_sha256", "")),
        resolution=json.loads(attrs.get("environment_resolution", "null")),
        notes=tuple(json.loads(attrs.get("environment_notes", "[]"))),
        extent=shapely.Polygon(corners) if corners else None,
        drivable=(
            _outline(dataset, "drivable", "drivable space", source) if kept == "drivable" else None
        ),
    )
    if isinstance(made, _WithoutCells):
        made.map_file = source
    return made


class _WithoutCells(Environment):
    """A building to look at only: its map does not keep the occupied cells."""

    map_file = ""

    @property
    def drivable(self) -> BaseGeometry | None:
        """Not known.

        Raises:
            InputError: always.
        """
        raise InputError(
            f"{self.map_file}: this map was made before occupied cells were kept with a map, so "
            "it is not known where a robot fits; make the map again with `ambinav map`."
        )


def _outline(dataset: xr.Dataset, name: str, what: str, source: str) -> BaseGeometry:
    """Polygons that are kept as a row of bytes."""
    try:
        return shapely.from_wkb(dataset[name].values.tobytes())
    except (KeyError, shapely.errors.GEOSException, TypeError) as error:
        raise InputError(
            f"{source}: {name}, the outline of the {what}, cannot be read ({error}); "
            "make the map again with `ambinav map`."
        ) from error
