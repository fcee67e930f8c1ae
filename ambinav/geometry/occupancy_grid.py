"""Occupancy grids: which cells of a map are free, occupied or unknown."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ambinav.runtime.array_types import Bytes, Floats

FREE: Final = 0
OCCUPIED: Final = 1
UNKNOWN: Final = 2


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Cells that are free, occupied or unknown, and where they lie in the map frame.

    Attributes:
        state: uint8, shape (rows, columns): `FREE`, `OCCUPIED` or `UNKNOWN`; row 0 lies at the
            smallest y of the grid's own frame (the last row of the image).
        resolution: Edge of a cell in metres.
        origin: Pose (x, y, yaw) of the outer corner of cell (0, 0) in the map frame, metres and
            radians, as in map_server.
        source: The YAML file, if the grid was read from one.
        image: The image file, if the grid was read from one.
        checksum: SHA-256 over the bytes of YAML file and image, or an empty string.
    """

    state: Bytes
    resolution: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    source: Path | None = None
    image: Path | None = None
    checksum: str = ""

    def to_world(self, col: Any, row: Any) -> tuple[Floats, Floats]:
        """Convert grid coordinates (column, row) to x, y in the map frame, metres.

        `col` and `row` (floats or arrays that broadcast) count from the outer corner of cell
        (0, 0); the centre of the cell in row i and column j is (j + 0.5, i + 0.5).
        """
        x0, y0, yaw = self.origin
        u = np.asarray(col, dtype=np.float64) * self.resolution
        v = np.asarray(row, dtype=np.float64) * self.resolution
        c, s = math.cos(yaw), math.sin(yaw)
        return x0 + c * u - s * v, y0 + s * u + c * v

    def to_cells(self, x: Any, y: Any) -> tuple[Floats, Floats]:
        """Convert points in the map frame to columns and rows: the inverse of `to_world`."""
        x0, y0, yaw = self.origin
        dx = (np.asarray(x, dtype=np.float64) - x0) / self.resolution
        dy = (np.asarray(y, dtype=np.float64) - y0) / self.resolution
        c, s = math.cos(yaw), math.sin(yaw)
        return c * dx + s * dy, c * dy - s * dx

    def state_at(self, x: Any, y: Any) -> Bytes:
        """Return the cell's state at each point, map frame, metres; unknown beyond the grid."""
        column, row = (np.floor(values) for values in self.to_cells(x, y))
        rows, columns = self.state.shape
        within = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        state = np.full(np.shape(within), UNKNOWN, dtype=np.uint8)
        state[within] = self.state[row[within].astype(np.intp), column[within].astype(np.intp)]
        return state

    def outline(self) -> Floats:
        """Return the grid's corners, map frame, counter-clockwise, metres, shape (4, 2)."""
        rows, columns = self.state.shape
        column, row = np.array([0, columns, columns, 0]), np.array([0, 0, rows, rows])
        return np.stack(self.to_world(column, row), axis=1)

    def transformed(self, angle: float, dx: float, dy: float) -> OccupancyGrid:
        """Turn about the origin of the map frame by `angle` radians, then shift (metres)."""
        x, y, yaw = self.origin
        c, s = math.cos(angle), math.sin(angle)
        return replace(self, origin=(c * x - s * y + dx, s * x + c * y + dy, yaw + angle))
