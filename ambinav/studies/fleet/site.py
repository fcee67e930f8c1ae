"""A site of a fleet: a building, wherever its files are."""

from __future__ import annotations

import json
import posixpath
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import yaml

from ambinav.maps.address import Address
from ambinav.runtime.errors import InputError

LONGEST: Final = 600.0
"""Seconds in which a building at a URL must be read."""


@dataclass(frozen=True)
class Site:
    """A building of the fleet.

    Attributes:
        name: Unique; with slashes if it lies in a folder.
        folder: Folder or URL that `building` is relative to.
        building: File of the building.
        date: ISO 8601 date or time; empty: not given.
        scanner: Preset or scanner file of this site alone; empty: those of all sites.
        reading: Options on reading the building.
    """

    name: str
    folder: str
    building: str
    date: str = ""
    scanner: str = ""
    reading: Mapping[str, Any] = field(default_factory=dict)

    @property
    def home(self) -> tuple[Address, str]:
        """Folder that holds the file, and the file's name in it."""
        place = self.building
        if "://" not in place and not place.startswith("/"):
            place = f"{self.folder}/{place}"
        head, _, name = place.rpartition("/")
        return Address.of(head or "/"), name

    def contents(self) -> dict[str, bytes]:
        """Read the building's file, and the image of a map, by their names.

        Raises:
            InputError: one is missing or cannot be read.
        """
        home, name = self.home
        contents = {name: _read(home, name, self.building)}
        image = _image(name, contents[name])
        if image is not None:
            if home.is_url and image.startswith(("..", "/")):
                raise InputError(
                    f"{self.building}: image: {image} is not in the folder of the map; put it "
                    "beside it."
                )
            contents[image] = _read(home, image, f"{self.building}: image: {image}")
        return contents

    @property
    def moment(self) -> str:
        """Its date, or else when its file was written, as RFC 3339 in UTC; empty: not known."""
        if self.date:
            return _stamp(in_utc(self.date))
        home, name = self.home
        try:
            if home.folder is not None:
                written = datetime.fromtimestamp((home.folder / name).stat().st_mtime, UTC)
            else:
                system, root = home.files
                written = system.modified(f"{root}/{name}").astimezone(UTC)
        # Whatever a file system raises: each has errors of its own.
        except Exception:
            return ""
        return _stamp(written)


def in_utc(date: str) -> datetime:
    """Return an ISO 8601 date in UTC, the zone of one that names none; errors as of Python."""
    moment = datetime.fromisoformat(date)
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def _stamp(moment: datetime) -> str:
    return moment.replace(tzinfo=None).isoformat(timespec="seconds") + "Z"


def parsed(content: bytes | None) -> Any:
    """Parse YAML or JSON; None if that is not possible."""
    try:
        text = (content or b"").decode()
        return json.loads(text) if text.lstrip().startswith("{") else yaml.safe_load(text)
    except (UnicodeDecodeError, ValueError, yaml.YAMLError):
        return None


def _image(name: str, content: bytes) -> str | None:
    """Return the name of a map's image; None if it is another file, or not relative to it."""
    if not name.lower().endswith((".yaml", ".yml")):
        return None
    plain = parsed(content)
    image = plain.get("image") if isinstance(plain, dict) else None
    return posixpath.normpath(image) if isinstance(image, str) and image.strip() else None


def _read(home: Address, name: str, label: str) -> bytes:
    content = home.read(name, LONGEST)
    if content is None:
        raise InputError(f"{label}: this file does not exist in {home}; check the path.")
    return content
