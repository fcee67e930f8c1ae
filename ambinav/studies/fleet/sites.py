"""The sites of a fleet: rows of a table, or all building files of a folder."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any, Final

from ambinav.buildings.plan_units import UNITS
from ambinav.buildings.readers import MAP_READERS
from ambinav.buildings.section_floor import DOORS, GLASS
from ambinav.config.numbers import nearest
from ambinav.maps.address import Address
from ambinav.runtime.errors import InputError
from ambinav.runtime.input_suggestions import MAP, kind_of
from ambinav.studies.fleet.site import LONGEST, Site, in_utc, parsed

READING: Final = ("level", "unit", "height", "doors", "glass")
"""Columns that are options on reading the building, see `load_environment`."""
COLUMNS: Final = ("site", "building", "date", "scanner", *READING)
"""Columns of a table of sites; the first two are needed."""

_CHOICES: Final = {"unit": tuple(UNITS), "doors": DOORS, "glass": GLASS}
_SEPARATOR: Final = re.compile(r"sep=(.)\s*")
"""First line by which spreadsheets say what separates cells."""
_SAFE: Final = re.compile(r"[\w.-]")
_RESERVED: Final = (".json", ".png")


def read_sites(place: str) -> tuple[Site, ...]:
    """Read the sites of a table or a folder, sorted by name.

    Args:
        place: A .csv file with the columns `COLUMNS`, whose relative files are relative to it; or
            a folder, in which every file that a reader of buildings takes is a site. Either may
            be a URL.

    Raises:
        InputError: it cannot be read, a column is unknown or missing, a value cannot be used, a
            file is missing, two sites have the same name, or there is none.
    """
    address = Address.of(place.rstrip("/") or "/")
    if address.folder is not None:  # as workers may have another working folder
        address = Address.of(address.folder.absolute())
    read = _from_table if place.lower().endswith(".csv") else _from_folder
    sites = [*read(address)]
    if not sites:
        raise InputError(
            f"{place}: there are no buildings; give a folder of map_server .yaml, .geojson, .ifc "
            "... files, or a .csv with the columns site and building."
        )
    counts = Counter(site.name for site in sites)
    for name, count in counts.items():
        if count > 1:
            files = ", ".join(str(site.building) for site in sites if site.name == name)
            raise InputError(
                f"{place}: {count} sites are called {name!r} ({files}); give each a name of its "
                "own."
            )
    missing = [site for site in sites if not _is_there(site)]
    if missing:
        others = f" (nor {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise InputError(
            f"{place}: site {missing[0].name!r}: the building {missing[0].building} does not "
            f"exist{others}; paths are relative to {sites[0].folder}."
        )
    return tuple(sorted(sites, key=lambda site: site.name))


def safe_name(text: str) -> str:
    """Return a text as the name of a file, on any file system and in addresses."""
    composed = _composed(text)
    return "".join(c if _is_safe(c) else "_" for c in composed).strip(".-") or "_"


def _composed(text: str) -> str:
    return unicodedata.normalize("NFC", text)


def _is_safe(character: str) -> bool:
    # Marks that no letter takes up, as in Devanagari, are none of \w.
    return bool(_SAFE.match(character)) or unicodedata.category(character) in ("Mn", "Mc")


def _can_name(part: str) -> bool:
    """Return whether a part of a site's name can name a file or folder as it is."""
    return (
        part != ""
        and all(map(_is_safe, part))
        and part[0] not in ".-"
        and part[-1] != "."
        and not part.endswith(_RESERVED)
    )


def _from_table(address: Address) -> Iterator[Site]:
    folder, _, name = address.place.rpartition("/")
    content = Address.of(folder or "/").read(name)
    if content is None:
        raise InputError(f"{address}: this file does not exist; check the path.")
    try:
        text = content.decode("utf-8-sig")
        # Spreadsheets separate by what their language leaves free.
        first, _, body = text.partition("\n")
        declared = _SEPARATOR.fullmatch(first)
        separator = declared[1] if declared else max(",;\t", key=first.count)
        lines = io.StringIO(body if declared else text, newline="")
        table = csv.DictReader(lines, strict=True, delimiter=separator)
        columns = [column.strip() for column in table.fieldnames or ()]
        table.fieldnames = columns
        rows = [(table.line_num + bool(declared), row) for row in table]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{address}: this is not CSV in UTF-8 ({error}); save it as such."
        ) from error
    for column in columns:
        if column not in COLUMNS:
            raise InputError(f"{address}: column {column!r}: {nearest(column, COLUMNS)}.")
        if columns.count(column) > 1:
            raise InputError(f"{address}: the column {column} is given twice; leave one.")
    for column in COLUMNS[:2]:
        if column not in columns:
            raise InputError(
                f"{address}: the column {column} is missing; add it to the first line."
            )
    for line, row in rows:
        where = f"{address}: line {line}"
        if None in row or None in row.values():
            raise InputError(f"{where}: it has not {len(columns)} values, as the first line has.")
        values = {column: value.strip() for column, value in row.items()}
        if any(values.values()):
            yield _site(where, folder, values)


def _site(where: str, folder: str, values: Mapping[str, str]) -> Site:
    for column in COLUMNS[:2]:
        if not values[column]:
            raise InputError(f"{where}: {column} is empty; give a value.")
    name = _composed(values["site"])
    if not all(map(_can_name, name.split("/"))):
        raise InputError(
            f"{where}: site {name!r} cannot name a file; use letters, digits and - _ . and /, "
            "without .json or .png at the end."
        )
    reading: dict[str, Any] = {name: values[name] for name in READING if values.get(name)}
    for column, choices in _CHOICES.items():
        if reading.get(column, choices[0]) not in choices:
            raise InputError(
                f"{where}: {column} {reading[column]!r}: {nearest(reading[column], choices)}."
            )
    if "height" in reading:
        try:
            reading["height"] = float(reading["height"].replace(",", "."))
        except ValueError:
            raise InputError(
                f"{where}: height {reading['height']!r} is not a number; give metres, e.g. 0.3."
            ) from None
    date = values.get("date", "")
    if date:
        try:
            in_utc(date)
        except (ValueError, OverflowError):
            raise InputError(
                f"{where}: date {date!r} is not an ISO 8601 date; give e.g. 2026-05-31."
            ) from None
    return Site(name, folder, values["building"], date, values.get("scanner", ""), reading)


def _from_folder(address: Address) -> Iterator[Site]:
    if address.folder is not None and not address.folder.is_dir():
        raise InputError(
            f"{address}: there is no such folder; give a folder of buildings, or a .csv of sites."
        )
    suffixes = MAP_READERS.names()
    files = [
        name
        for name in address.names()
        if PurePosixPath(name).suffix.lower().removeprefix(".") in suffixes
        and not any(part.startswith(".") for part in name.split("/"))
        and _is_building(address, name)
    ]
    stems = Counter(str(PurePosixPath(name).with_suffix("")) for name in files)
    for name in files:
        path = PurePosixPath(name)
        stem = str(path.with_suffix(""))
        if stems[stem] > 1:
            stem += path.suffix.replace(".", "-")
        yield Site("/".join(map(safe_name, stem.split("/"))), address.place, name)


def _is_building(address: Address, name: str) -> bool:
    """Return whether a file is a building's by its keys, if its suffix does not tell."""
    suffix = PurePosixPath(name).suffix.lower()
    if suffix not in (".yaml", ".yml", ".json"):
        return True
    content = address.read(name, LONGEST)
    if suffix == ".json":
        plain = parsed(content)
        return isinstance(plain, dict) and plain.get("type") == "FeatureCollection"
    plain = parsed(content)
    # A map that cannot be parsed is a site that fails, rather than one that is missed.
    return b"image:" in (content or b"") if plain is None else kind_of(plain) == MAP


def _is_there(site: Site) -> bool:
    """Return whether a building's file exists; at a URL it is assumed to."""
    home, name = site.home
    return home.is_url or home.exists(name)
