"""Readers of environments, each for certain file suffixes."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.plugins import Registry
from ambinav.runtime.errors import InputError
from ambinav.runtime.input_suggestions import kind_of_path, refuse, refuse_image
from ambinav.runtime.packages import need

HEIGHT: Final = 0.3
"""Metres above the floor at which a building model is cut unless another height is given."""


@dataclass(frozen=True, kw_only=True)
class MapReader:
    """Entry of the registry of readers.

    Attributes:
        title: What messages call such a file, with its article: "an occupancy map".
        suffixes: The suffixes of its files, lower-case and without the dot: ("geojson", "wkt").
            They are its names in the registry, and those of its entry points.
        read: From the file, a `Path`, and keyword options to the environment. It raises
            `InputError` where the file cannot be used.
    """

    title: str
    suffixes: tuple[str, ...]
    read: Callable[..., Environment]


MAP_READERS: Final = Registry(
    "map reader",
    MapReader,
    "ambinav.map_readers",
    {
        "yaml": "ambinav.buildings.readers:MAP_SERVER",
        "yml": "ambinav.buildings.readers:MAP_SERVER",
        "geojson": "ambinav.buildings.readers:FLOOR_PLAN",
        "json": "ambinav.buildings.readers:FLOOR_PLAN",
        "wkt": "ambinav.buildings.readers:FLOOR_PLAN",
        "ifc": "ambinav.buildings.readers:BUILDING_MODEL",
        "dxf": "ambinav.buildings.readers:CAD_DRAWING",
    },
    names_of=lambda reader: reader.suffixes,
)
"""The readers of environments, by suffix."""


def read(path: str | Path, **options: Any) -> Environment:
    """Read an environment with the reader for the file's suffix.

    Args:
        path: The file.
        options: Keyword options of the reader; None: the option is not given.

    Raises:
        InputError: no reader has the suffix, it has no such option, or it cannot use the file.
    """
    check_kind(path, (str, os.PathLike), "path", "give the path of a building's file")
    # A `Path` of a URL has lost a slash.
    if re.match(r"\w{2,}:/", str(path)):
        raise InputError(
            f"{path}: buildings are read from files of this machine; copy it here first, an "
            "occupancy map with its image. (Of a fleet, `ambinav fleet audit` reads URLs.)"
        )
    path = Path(path)
    refuse_image(path)
    if path.is_dir():
        refuse(f"{path}", kind_of_path(path), "a building")
        raise InputError(f"{path}: this is a folder; name the file of the building in it.")
    suffix = path.suffix.lower().removeprefix(".")
    suffixes = MAP_READERS.names()
    if suffix not in suffixes:
        raise InputError(
            f"{path}: the suffix {path.suffix or '(none)'} names no known format; give a "
            f"map_server .yaml, or another file with one of the suffixes .{', .'.join(suffixes)}. "
            "(In Python read_mesh, read_cloud and read_octomap read buildings in space.)"
        )
    reader = MAP_READERS.get(suffix)
    used_options = {name: value for name, value in options.items() if value is not None}
    takes = inspect.signature(reader.read).parameters
    for name in used_options:
        if name not in takes:
            raise InputError(
                f"{path}: {name} means nothing for {reader.title} (.{suffix}); leave it out."
            )
    with MAP_READERS.calling(suffix):
        environment = reader.read(path, **used_options)
        if not isinstance(environment, Environment):
            raise TypeError(f"it is not an Environment but {environment!r}")
    return environment


def _read_map_server(
    path: Path, *, tolerance: float | None = None, gap: float | None = None
) -> Environment:
    from ambinav.buildings.boundary import environment_from_grid
    from ambinav.buildings.map_server import load_map_server

    return environment_from_grid(load_map_server(path), tolerance=tolerance, gap=gap)


def _read_floor_plan(
    path: Path, *, level: str | int | None = None, unit: str | None = None
) -> Environment:
    from ambinav.buildings.polygons import load_polygons

    return load_polygons(path, level=level, unit=unit)


def _read_ifc(
    path: Path,
    *,
    level: str | int | None = None,
    height: float = HEIGHT,
    doors: str = "open",
    glass: str = "solid",
    furniture: bool = True,
    in_space: bool = False,
) -> Environment:
    need(f"{path}: reading it", ("ifcopenshell",), "plans")
    from ambinav.buildings.ifc.file import read_storey
    from ambinav.buildings.ifc.space import load_ifc_in_space

    how: dict[str, Any] = {"height": height, "doors": doors, "glass": glass, "furniture": furniture}
    if in_space:
        return load_ifc_in_space(path, level, **how)
    return read_storey(path, level, **how).environment


def _read_dxf(
    path: Path,
    *,
    unit: str | None = None,
    doors: str = "open",
    glass: str = "solid",
    furniture: bool = True,
    layers: Mapping[str, str] | None = None,
) -> Environment:
    need(f"{path}: reading it", ("ezdxf",), "plans")
    from ambinav.buildings.dxf.file import load_dxf

    return load_dxf(path, unit=unit, doors=doors, glass=glass, furniture=furniture, layers=layers)


MAP_SERVER: Final = MapReader(
    title="an occupancy map", suffixes=("yaml", "yml"), read=_read_map_server
)
"""Format of ROS's map_server: a YAML file with an image beside it."""

FLOOR_PLAN: Final = MapReader(
    title="a drawn plan", suffixes=("geojson", "json", "wkt"), read=_read_floor_plan
)
"""Polygons and lines, as GeoJSON or WKT."""

BUILDING_MODEL: Final = MapReader(title="a building model", suffixes=("ifc",), read=_read_ifc)
"""A storey of an IFC file."""

CAD_DRAWING: Final = MapReader(title="a CAD drawing", suffixes=("dxf",), read=_read_dxf)
"""The layers of a DXF file."""
