"""Read an environment from a file of any known format."""

from __future__ import annotations

from pathlib import Path

from ambinav.geometry.environment import Environment
from ambinav.geometry.io.readers import read


def load_environment(
    path: str | Path,
    *,
    level: str | int | None = None,
    unit: str | None = None,
    tolerance: float | None = None,
    gap: float | None = None,
) -> Environment:
    """Read an environment: map_server YAML, GeoJSON, WKT, or what plug-ins read, by the suffix.

    Args:
        path: .yaml or .yml with its image beside it; .geojson or .json; .wkt; see `readers`.
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
    return read(path, level=level, unit=unit, tolerance=tolerance, gap=gap)
