"""Read an environment from a file of any known format."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ambinav.buildings.readers import read
from ambinav.geometry.environment import Environment


def load_environment(
    path: str | Path,
    *,
    level: str | int | None = None,
    unit: str | None = None,
    tolerance: float | None = None,
    gap: float | None = None,
    height: float | None = None,
    doors: str | None = None,
    glass: str | None = None,
    furniture: bool | None = None,
    layers: Mapping[str, str] | None = None,
    in_space: bool | None = None,
) -> Environment:
    """Read an environment: map_server YAML, GeoJSON, WKT, IFC, DXF, or what plug-ins read.

    Args:
        path: .yaml or .yml with its image beside it; .geojson or .json; .wkt; .ifc; .dxf; see
            `readers`.
        level: The floor of a plan that holds several, by name or by position from 0 on (plans
            only).
        unit: What a plan's coordinates are in: "m", "cm", "mm", "in" or "ft" (plans only, not
            IFC; if None metres, or what a DXF says, where that makes a building).
        tolerance: How far a wall may move when a map is simplified, metres (maps only; two cells
            if None).
        gap: Gaps in walls and specks up to this size are closed, metres (maps only; one cell if
            None).
        height: Height of the scanner above the floor, at which a building is cut, metres (IFC only;
            0.3 if None).
        doors: "open" or "closed" (IFC and DXF; open if None).
        glass: "solid", or "clear" where rays pass it and robots do not (IFC and DXF; solid if
            None).
        furniture: Whether furniture is there (IFC and DXF; yes if None).
        layers: What is on the layers of a DXF by their names, where those do not say it
            (`dxf.layers`).
        in_space: Whether the rays of scanners are cast in three dimensions, against walls, slabs
            and furniture between the heights that the file gives them (IFC only; no if None).

    Raises:
        InputError: the file cannot be used; the message says why.
    """
    return read(
        path, level=level, unit=unit, tolerance=tolerance, gap=gap, height=height, doors=doors,
        glass=glass, furniture=furniture, layers=layers, in_space=in_space,
    )  # fmt: skip
