"""Routes through space: figures, files and pictures of one."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from ambinav.routes.files import path_message
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.service.volume_service import VolumeService

FORMAT: Final = "ambinav-flight/1"
SUFFIXES: Final = (".csv", ".json")
"""Endings of its files."""
COLUMNS: Final = ("x", "y", "z", "distance", "cost", "level")
_REMARK: Final = (
    "## x, y, z, distance from the start: metres; cost: metres-equivalent from the start; level: "
    "the layer at the point"
)


@dataclass(frozen=True, eq=False)
class FlightRoute:
    """A route through space, straight from point to point.

    Attributes:
        points: x, y, z, shape (N, 3), metres, map frame.
        cost: The integral of the cost per metre along it, equivalent metres.
        length: Metres.
        curve: Seconds and cost whenever the planner's cost fell.
        service: Service for the cost per metre that it was planned with.
        radius: Radius of the sphere or cylinder that covers the robot, metres.
        half_height: Half the height of the cylinder, metres; None: it is a sphere.
        planner: Name of the planner.
        seed: Its seed, or None.
    """

    points: Floats
    cost: float
    length: float
    curve: tuple[tuple[float, float], ...]
    service: VolumeService
    radius: float
    half_height: float | None
    planner: str
    seed: int | None

    @cached_property
    def _unit(self) -> VolumeService:
        return VolumeService(self.service.volume, self.service.layer, weight=1.0)

    @property
    def mean_level(self) -> float:
        """Mean of the layer along the route."""
        return self._unit.route_cost(self.points) / self.length - 1.0 if self.length else 0.0

    @property
    def figures(self) -> dict[str, Any]:
        """Figures as plain data, with the names that route files have for them."""
        attrs = self.service.volume.dataset.attrs
        return {
            "format": FORMAT, "planner": self.planner, "seed": self.seed,
            "environment": attrs["environment"], "scanner": attrs["scanner"], "space": "r3",
            "robot_radius_m": self.radius, "half_height_m": self.half_height,
            "layer": self.service.layer, "weight": self.service.weight,
            "length_m": self.length, "cost": self.cost, "mean_level": self.mean_level,
            "lowest_m": float(self.points[:, 2].min()), "highest_m": float(self.points[:, 2].max()),
            "curve": [list(entry) for entry in self.curve],
        }  # fmt: skip

    def save(self, path: str | Path) -> None:
        """Write the route, completely or not at all; an older file is replaced.

        - `.csv`: the figures in lines that begin with #, then a table of the points.
        - `.json`: the fields of a ROS nav_msgs/Path in the frame `map`, without stamps and turns,
          and the member `ambinav` with figures and points.

        Args:
            path: Where to; the ending says the format.

        Raises:
            InputError: another ending, or the place is not writable.
        """
        path = Path(path)
        if path.suffix.lower() not in SUFFIXES:
            raise InputError(
                f"{path}: routes through space are written as {' or '.join(SUFFIXES)}; give a name "
                "that ends so."
            )
        text = self._table() if path.suffix.lower() == ".csv" else self._message()
        write_text(path, text)

    def draw(self, path: str | Path, layer: str | None = None) -> None:
        """Draw it over the layer at each height, its height over distance, and in space.

        Args:
            path: Picture to write; its suffix sets the format.
            layer: Name of a layer; None: that of the costs.
        """
        from ambinav.plotting.canvas import save_figure
        from ambinav.plotting.volumes import plot_volume

        figure = plot_volume(self.service.volume, layer or self.service.layer, self.points)
        save_figure(figure, Path(path))

    def _rows(self) -> list[list[float]]:
        """Return a row of `COLUMNS` for each point."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        pieces = [self.service.route_cost(self.points[k : k + 2]) for k in range(len(steps))]
        levels = [self._unit.near(*point) - 1.0 for point in self.points.tolist()]
        along = [np.append(0.0, np.cumsum(part)) for part in (steps, pieces)]
        rows: list[list[float]] = np.column_stack([self.points, *along, levels]).tolist()
        return rows

    def _table(self) -> str:
        out = io.StringIO()
        for name, value in self.figures.items():
            out.write(f"# {name}: {json.dumps(value, ensure_ascii=False)}\n")
        out.write(f"{_REMARK}\n")
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(COLUMNS)
        rows.writerows(self._rows())
        return out.getvalue()

    def _message(self) -> str:
        flat = np.column_stack([self.points[:, :2], np.zeros(len(self.points))])
        message = path_message(flat, flat[:, 2])
        for entry, z in zip(message["poses"], self.points[:, 2].tolist(), strict=True):
            entry["pose"]["position"]["z"] = z
        points = [dict(zip(COLUMNS, row, strict=True)) for row in self._rows()]
        message["ambinav"] = {**self.figures, "points": points}
        return json.dumps(message, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
