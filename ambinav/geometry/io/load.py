"""Read an environment from a file of any known format."""

from __future__ import annotations

from pathlib import Path

from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.mistaken import kind_of_path, refuse, refuse_image


def load_environment(
    path: str | Path,
    *,
    level: str | int | None = None,
    unit: str | None = None,
    tolerance: float | None = None,
    gap: float | None = None,
) -> Environment:
    """Read an environment: map_server YAML, GeoJSON or WKT, distinguished by the file's suffix.

    Args:
        path: .yaml or .yml with its image beside it; .geojson or .json; .wkt.
        level: The floor of a plan that holds several, by name or by position from 0 on (plans
            only).
        unit: What a plan's coordinates are in: "m", "cm" or "mm" (plans only; metres if None,
            where that makes a building).
        tolerance: How far a wall may move when a map is simplified, metres (maps only; two cells
            if None).
        gap: Gaps in walls and specks up to this size are closed, metres (maps only; one cell if
            None).

    Raises:
        InputError: the file cannot be used; the message says why.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    refuse_image(path)
    if path.is_dir():
        refuse(f"{path}", kind_of_path(path), "a building")
    if suffix in (".yaml", ".yml"):
        from ambinav.geometry.io.boundary import environment_from_grid
        from ambinav.geometry.io.map_server import load_map_server

        if level is not None or unit is not None:
            raise InputError(
                f"{path}: level and unit are for drawn plans; leave them out for an occupancy map."
            )
        return environment_from_grid(load_map_server(path), tolerance=tolerance, gap=gap)
    if suffix in (".geojson", ".json", ".wkt"):
        from ambinav.geometry.io.polygons import load_polygons

        if tolerance is not None or gap is not None:
            raise InputError(
                f"{path}: tolerance and gap are for occupancy maps; leave them out for polygons."
            )
        return load_polygons(path, level=level, unit=unit)
    raise InputError(
        f"{path}: the suffix {suffix or '(none)'} names no known format; "
        "give a map_server .yaml, a .geojson or a .wkt file."
    )
