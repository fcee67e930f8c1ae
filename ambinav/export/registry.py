"""Exporters that write a map, a route or a drive as files for other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from ambinav.plugins import Registry
from ambinav.runtime.errors import InputError

Subject = Literal["map", "route", "drive"]


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """Entry of the registry of exporters.

    Attributes:
        subject: What it writes: "map", "route" or "drive".
        format: The format; of a route the suffix of its file, lower-case and without the dot.
        title: What the file is, in a line.
        write: For a map: takes an `export.options.MapExport` and the path of the first file, in a
            folder of its own. Of a route: takes a `Route` and the file's path. Of a drive: takes a
            `logs.export_drive.RecordedDrive` and a folder that exists. It gives the files that it
            wrote, and raises `InputError` where it cannot say what it is given.
        reader: Who reads it: program, message or function.
        suffixes: For a map: ending of the first file, then what stands in its place in the names
            of the files beside it: (".yaml", ".pgm", "_params.yaml").
        uses: For a map: the options (fields of `export.options.ExportOptions`) that it looks at.
        needs: Packages that it imports and a user may not have, by the name of the import.
        extra: The optional dependencies that bring them: "geotiff" of `ambinav[geotiff]`.
        read: For a route: from the file's path to a `Route`, perhaps one that is not measured
            (`Route.through`); it raises `InputError` where the file cannot be used. None: files of
            this format are only written.
    """

    subject: Subject
    format: str
    title: str
    write: Callable[[Any, Path], tuple[Path, ...]]
    reader: str = ""
    suffixes: tuple[str, ...] = ()
    uses: frozenset[str] = frozenset()
    needs: tuple[str, ...] = ()
    extra: str = ""
    read: Callable[[Path], Any] | None = None

    @property
    def name(self) -> str:
        """Name in the registry and of an entry point: "route-gpx"; for a map the format."""
        return self.format if self.subject == "map" else f"{self.subject}-{self.format}"

    def written(self, subject: Any, path: Path) -> tuple[Path, ...]:
        """Call `write`; the failure of a plug-in is an `InputError` that names it."""
        with EXPORTERS.calling(self.name):
            return tuple(map(Path, self.write(subject, path)))


EXPORTERS: Final = Registry(
    "exporter",
    Exporter,
    "ambinav.exporters",
    {
        "map-server": "ambinav.export.formats.map_server:MAP_SERVER",
        "nav2-keepout": "ambinav.export.formats.nav2_masks:KEEPOUT",
        "nav2-preference": "ambinav.export.formats.nav2_masks:PREFERENCE",
        "nav2-speed": "ambinav.export.formats.nav2_masks:SPEED",
        "nav2-binary": "ambinav.export.formats.nav2_masks:BINARY",
        "nav2-path-yaml": "ambinav.export.formats.nav2_path:PATH_YAML",
        "nav2-path-json": "ambinav.export.formats.nav2_path:PATH_JSON",
        "nav2-route-graph": "ambinav_planners.roadmap_export:ROUTE_GRAPH",
        "covariance-npz": "ambinav.export.formats.covariance:NPZ",
        "covariance-raw": "ambinav.export.formats.covariance:RAW",
        "covariance-geotiff": "ambinav.export.formats.covariance:GEOTIFF",
        "zones-geojson": "ambinav.export.formats.zones:GEOJSON",
        "zones-lanelet2": "ambinav.export.formats.lanelet2:LANELET2",
        "zones-autoware": "ambinav.export.formats.autoware:AUTOWARE",
        "geotiff": "ambinav.export.formats.geotiff:GEOTIFF",
        "npz": "ambinav.export.formats.npz:NPZ",
        "mcap": "ambinav.export.formats.mcap:MCAP",
        "route-csv": "ambinav.routes.files:CSV",
        "route-geojson": "ambinav.routes.files:GEOJSON",
        "route-json": "ambinav.routes.files:PATH_MESSAGE",
        "drive-carmen": "ambinav.logs.export_drive:CARMEN",
        "drive-tum": "ambinav.logs.export_drive:TUM",
        "drive-csv": "ambinav.logs.export_drive:TABLE",
    },
)
"""The exporters."""


def formats(subject: Subject) -> tuple[str, ...]:
    """Return the formats of a route or a drive."""
    head = f"{subject}-"
    return tuple(name.removeprefix(head) for name in EXPORTERS.names() if name.startswith(head))


def exporter(subject: Subject, path: Path) -> Exporter:
    """Return the exporter for the suffix of a file.

    Raises:
        InputError: no format has this suffix.
    """
    suffix = path.suffix.lower().removeprefix(".")
    suffixes = formats(subject)
    if suffix not in suffixes:
        if path.is_dir():
            raise InputError(f"{path}: this is a folder; name a file in it.")
        raise InputError(
            f"{path}: the ending {path.suffix!r} names no format of {subject}s; choose "
            f".{', .'.join(suffixes)}."
        )
    return EXPORTERS.get(f"{subject}-{suffix}")
