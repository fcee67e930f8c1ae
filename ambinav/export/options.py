"""Options of an export of a map, and the input of an exporter of maps."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ambinav.config import as_number, nearest
from ambinav.export.registry import Exporter
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.schema import base_name
from ambinav.maps.zones import CORRIDOR, NOT_FREE, OPEN, ZONES
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError, InputWarning

PACKAGE = re.compile(r"[a-z][a-z0-9_]*(/[\w.-]+)*/?")
BAD: tuple[str, ...] = (ZONES[CORRIDOR], ZONES[OPEN])
"""The zones that exports of zones hold where nobody names any."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Options of all exporters of maps; None or empty: not given.

    Attributes:
        layer: The layer that a mask or a cost is made of, or the only one to write.
        threshold: Mark the cells at which the layer is at least this.
        zones: Names of zones to mark or to write.
        least_area: Zones smaller than this are left out, square metres.
        slowest: Speed where the layer is 1, percent of the full speed.
        max_speed: The robot's largest speed, m/s: limits are in m/s then, and not in percent.
        heading: Heading of the robot, degrees counter-clockwise from the map's x axis.
        package: ROS package that the files are installed with, and the folder in its share:
            "my_robot/maps".
        resolution: Edge of a cell, metres.
        step: Metres between the poses of a path, at most.
        routes: Files of routes.
        drives: Files of drives: the `drive.csv` of a comparison's exports.
        weight: Extra cost of a metre where the layer is 1, in metres.
        robot_radius: Radius of a round robot, metres.
        milestones: Number of milestones of the roadmap.
        seed: Seed of the roadmap.
    """

    layer: str | None = None
    threshold: float | None = None
    zones: tuple[str, ...] = ()
    least_area: float | None = None
    slowest: float | None = None
    max_speed: float | None = None
    heading: float | None = None
    package: str | None = None
    resolution: float | None = None
    step: float | None = None
    routes: tuple[Path, ...] = ()
    drives: tuple[Path, ...] = ()
    weight: float | None = None
    robot_radius: float | None = None
    milestones: int | None = None
    seed: int | None = None

    def check(self, exporter: Exporter) -> None:
        """Check for options that an exporter ignores, and for invalid values.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or (isinstance(value, tuple) and not value):
                continue
            option = _option(field.name)
            if field.name not in exporter.uses:
                able = ", ".join(sorted(_option(name) for name in exporter.uses))
                raise InputError(
                    f"{option}: {exporter.name} does not look at it; leave it out"
                    + (f" (it knows {able})." if able else ".")
                )
            if "float" in str(field.type):
                as_number(value, option)
        for name, least, most in (
            ("slowest", 0.0, 100.0),
            ("least_area", 0.0, math.inf),
            ("weight", 0.0, math.inf),
        ):
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                limits = f"from {least:g}" + (f" to {most:g}" if most < math.inf else " on")
                raise InputError(f"{_option(name)}: {value:g}; give a number {limits}.")
        if self.slowest is not None and 0.0 < self.slowest < 1.0:
            raise InputError(
                f"--slowest: {self.slowest:g} % of full speed is hardly any; give percent, e.g. 30."
            )
        for name in ("max_speed", "resolution", "step", "robot_radius"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise InputError(f"{_option(name)}: {value:g} is not above zero; give more.")
        if self.seed is not None and self.seed < 0:
            raise InputError(f"--seed: {self.seed}; give a whole number from 0 on.")
        if self.milestones is not None and self.milestones < 2:
            raise InputError(f"--milestones: {self.milestones}; give 2 or more.")
        for zone in self.zones:
            if zone not in ZONES:
                raise InputError(f"--zone: {zone!r} is not a zone; {nearest(zone, ZONES)}.")
        if self.package is not None and not PACKAGE.fullmatch(self.package):
            raise InputError(
                f"--package: {self.package!r}; give a ROS package and a folder: my_robot/maps."
            )
        if self.zones and self.threshold is not None:
            raise InputError("--threshold marks cells by a layer and --zone by zones; give one.")


def _option(name: str) -> str:
    """Return the command-line name of a field."""
    singular = {"zones": "zone", "routes": "route", "drives": "drive"}.get(name, name)
    return f"--{singular.replace('_', '-')}"


@dataclass(frozen=True)
class MapExport:
    """Input of an exporter of maps.

    Attributes:
        amap: The map.
        options: What was said, checked.
    """

    amap: AmbiguityMap
    options: ExportOptions

    def floor(self, layer: str) -> Floats:
        """Return a layer over the floor, its mean over headings, (ny, nx); nan off the free floor.

        Raises:
            InputError: the map has no such layer; the nearest are offered.
        """
        amap = self.amap
        if layer == JUDGED:
            return np.where(amap.dataset["free"].values, amap.judged.code, np.nan)
        if layer not in amap.layers:
            raise InputError(
                f"{amap.source}: the map has no layer {layer!r}; {nearest(layer, amap.layers)}."
            )
        heading = None if self.options.heading is None else math.radians(self.options.heading)
        values = amap.floor(layer, "mean" if heading is None else heading).values
        free = np.asarray(amap.dataset["free"].values, dtype=np.bool_)
        if base_name(layer) == "zone":
            free = free & (values != NOT_FREE)
        return np.where(free, values.astype(np.float64), np.nan)

    def counted(self, layer: str) -> Floats:
        """Return `floor`, with nan where floor does not count (`AmbiguityMap.judged`).

        Raises:
            InputError: see `floor`.
        """
        return np.where(self.amap.judged.counted, self.floor(layer), np.nan)

    def note_empty(self, path: Path, contents: str) -> None:
        """Warn that a written file is empty, as a reader might take it for damaged.

        Args:
            path: The file.
            contents: What there is none of, and what it is of.

        Warns:
            InputWarning: always.
        """
        warnings.warn(f"{path.name}: it is empty, for {contents}.", InputWarning, stacklevel=3)

    def zone_codes(self, usual: tuple[str, ...] = BAD) -> tuple[int, ...]:
        """Return the codes of the named zones, each once, or the usual ones."""
        return tuple(ZONES.index(name) for name in dict.fromkeys(self.options.zones or usual))
