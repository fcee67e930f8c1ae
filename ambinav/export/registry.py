"""Exporters: what writes a route or a drive as a file that other programs read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from ambinav.errors import InputError
from ambinav.plugins import Registry

Subject = Literal["route", "drive"]


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """An entry of the registry.

    Attributes:
        subject: What it writes: "route" or "drive".
        format: The format; of a route the suffix of its file, lower-case and without the dot.
        title: What the file is, in a line.
        write: Of a route: takes a `Route` and the file's path. Of a drive: takes a
            `logs.export_drive.RecordedDrive` and a folder that exists. It gives the files that it
            wrote, and raises `InputError` where it cannot say what it is given.
        read: Of a route: from the file's path to a `Route`, perhaps one that is not measured
            (`Route.through`); it raises `InputError` where the file cannot be used. None: files of
            this format are only written.
    """

    subject: Subject
    format: str
    title: str
    write: Callable[[Any, Path], tuple[Path, ...]]
    read: Callable[[Path], Any] | None = None

    @property
    def name(self) -> str:
        """The name in the registry, and of an entry point: "route-gpx"."""
        return f"{self.subject}-{self.format}"

    def written(self, what: Any, path: Path) -> tuple[Path, ...]:
        """Call `write`; the failure of a plug-in is an `InputError` that names it."""
        with EXPORTERS.calling(self.name):
            return tuple(map(Path, self.write(what, path)))


EXPORTERS: Final = Registry(
    "exporter",
    Exporter,
    "ambinav.exporters",
    {
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
    """The formats that a route or a drive can be written in."""
    head = f"{subject}-"
    return tuple(name.removeprefix(head) for name in EXPORTERS.names() if name.startswith(head))


def exporter(subject: Subject, path: Path) -> Exporter:
    """The exporter for the suffix of a file.

    Raises:
        InputError: no format has this suffix.
    """
    suffix = path.suffix.lower().removeprefix(".")
    known = formats(subject)
    if suffix not in known:
        raise InputError(
            f"{path}: the ending {path.suffix!r} names no format of {subject}s; choose "
            f".{', .'.join(known)}."
        )
    return EXPORTERS.get(f"{subject}-{suffix}")
