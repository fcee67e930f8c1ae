"""Building as a map stores it: walls, outlines, and their source."""

from __future__ import annotations

import json
from pathlib import Path

import shapely
import xarray as xr
from shapely.geometry.base import BaseGeometry

from ambinav.casting.packed import unpacked
from ambinav.casting.space import Scans, SpaceCaster, SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.runtime.array_types import Bytes, Floats
from ambinav.runtime.errors import InputError


def kept_environment(dataset: xr.Dataset, source: str) -> Environment:
    """Return the building that a map was computed from, as far as a robot can meet it.

    Args:
        dataset: The map.
        source: Named in error messages: where the map comes from.

    Returns:
        Of a map that was made in space by a caster that is neither prisms nor a mesh the floor is
        known alone: scans raise an InputError.

    Raises:
        InputError: the outline of the free space, or the building in space, cannot be read.
    """
    attrs = dataset.attrs
    file = str(attrs.get("environment_source", ""))
    corners = json.loads(attrs.get("environment_extent", "[]"))
    return Environment(
        Segments(dataset["segments"].values, dataset["segment_kind"].values),
        _outline(dataset, "floor", "free space", source),
        name=str(attrs["environment"]),
        source=Path(file) if file else None,
        checksum=str(attrs.get("environment_sha256", "")),
        resolution=json.loads(attrs.get("environment_resolution", "null")),
        notes=tuple(json.loads(attrs.get("environment_notes", "[]"))),
        extent=shapely.Polygon(corners) if corners else None,
        drivable=(
            _outline(dataset, "drivable", "drivable space", source)
            if attrs.get("collision") == "drivable"
            else None
        ),
        space=_space(dataset, source),
        floor=json.loads(attrs.get("environment_floor", "0.0")),
    )


def _space(dataset: xr.Dataset, source: str) -> SpaceCaster | None:
    """Return what rays meet in a map that was made in space; None of one that was made in a plan.

    Raises:
        InputError: it cannot be read.
    """
    checksum = str(dataset.attrs.get("environment_space", ""))
    if not checksum:
        return None
    if "space" not in dataset:
        return _LostSpace(source, checksum)
    try:
        return unpacked(dataset["space"].values)
    except InputError as error:
        raise InputError(
            f"{source}: space, the building in space, cannot be read ({error}); make the map again "
            "with `ambinav map`."
        ) from error


class _LostSpace:
    """Space of a building whose map stores only the floor: no ray can be cast in it.

    Args:
        map_file: What messages call the map.
        checksum: Checksum of the building's space.
    """

    def __init__(self, map_file: str, checksum: str) -> None:
        self.map_file = map_file
        self.checksum = checksum

    def __repr__(self) -> str:
        """Return a text that says that the space is not known."""
        return "space not kept"

    def _lost(self) -> InputError:
        return InputError(
            f"{self.map_file}: this map was made of a building in space, of which it keeps the "
            "floor alone, so that no ray can be cast; give the building itself."
        )

    @property
    def surface_normal(self) -> Floats:
        """Unknown normals; raises `InputError`."""
        raise self._lost()

    @property
    def surface_kind(self) -> Bytes:
        """Unknown kinds; raises `InputError`."""
        raise self._lost()

    def cast_scans(
        self,
        x: Floats,
        y: Floats,
        theta: Floats,
        rays: SpaceRays,
        max_range: float,
        *,
        incidence: bool = True,
    ) -> Scans:
        """Raise `InputError`, as the space is not known."""
        raise self._lost()


def _outline(dataset: xr.Dataset, name: str, outline_name: str, source: str) -> BaseGeometry:
    """Decode polygons that are stored as a row of bytes."""
    try:
        return shapely.from_wkb(dataset[name].values.tobytes())
    except (KeyError, shapely.errors.GEOSException, TypeError) as error:
        raise InputError(
            f"{source}: {name}, the outline of the {outline_name}, cannot be read ({error}); "
            "make the map again with `ambinav map`."
        ) from error
