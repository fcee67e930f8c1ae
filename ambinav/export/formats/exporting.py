"""Export from a map: options and output checked, files written completely or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import NoneType

from ambinav.config import check_kind
from ambinav.export.formats.inputs import drive_on, only_route
from ambinav.export.options import ExportOptions, MapExport
from ambinav.export.registry import EXPORTERS, Exporter
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing, writable_parent
from ambinav.runtime.packages import need


def export_map(
    amap: AmbiguityMap,
    kind: str,
    output: str | Path,
    options: ExportOptions | None = None,
    *,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write files for another program.

    Args:
        amap: The map.
        kind: Name of an exporter of maps; also of routes and of drives, which are then named in
            the options and checked against the map.
        output: The file, or of drives the folder; its ending is that of the format.
        options: Options of the export.
        overwrite: Replace existing files.

    Returns:
        The files, `output` first.

    Raises:
        InputError: there is no such exporter (the nearest are offered), an option does not suit
            it, a package is missing, or a file is there.
    """
    check_kind(amap, AmbiguityMap, "amap")
    check_kind(options, (ExportOptions, NoneType), "options")
    options, path = options or ExportOptions(), Path(output)
    exporter, names = prepare(kind, path, options, overwrite)
    name = path.absolute().name  # also of "."
    try:
        with tempfile.TemporaryDirectory(prefix=f".{name}.", dir=writable_parent(path)) as place:
            made = _write(exporter, amap, options, Path(place) / name)
            folder = path if exporter.subject == "drive" else path.parent
            targets = tuple(folder / file.name for file in made)
            _check_replaceable(targets)
            if not overwrite:
                _check_free([*names, *targets])
            folder.mkdir(parents=True, exist_ok=True)
            # Write the file that names the others last, so that readers find all of them.
            for file, target in reversed(list(zip(made, targets, strict=True))):
                with replacing(target) as fresh:
                    shutil.move(file, fresh)
    except OSError as error:
        raise InputError(
            f"{path}: it cannot be written ({error.strerror or error}); choose another output."
        ) from error
    return targets


def prepare(
    kind: str, path: Path, options: ExportOptions, overwrite: bool = False
) -> tuple[Exporter, tuple[Path, ...]]:
    """Check everything that can be checked before the map is opened.

    Returns:
        The exporter, and the files that it will write as far as they are known.

    Raises:
        InputError: see `export_map`.
    """
    exporter = EXPORTERS.get(kind)
    need(kind, exporter.needs, exporter.extra)
    uses = {"route": {"routes"}, "drive": {"drives"}}.get(exporter.subject)
    if uses is not None:
        exporter = replace(exporter, uses=frozenset(uses))
    options.check(exporter)
    if exporter.subject == "drive":
        return exporter, ()
    suffixes = exporter.suffixes or (f".{exporter.format}",)
    if path.suffix.lower() != suffixes[0]:
        raise InputError(
            f"--output: {path} ends in {path.suffix or 'nothing'!r}; {kind} writes a file that "
            f"ends in {suffixes[0]}."
        )
    names = (path, *(path.with_name(path.stem + suffix) for suffix in suffixes[1:]))
    _check_replaceable(names)
    if not overwrite:
        _check_free(names)
    return exporter, names


def _write(
    exporter: Exporter, amap: AmbiguityMap, options: ExportOptions, path: Path
) -> tuple[Path, ...]:
    if exporter.subject == "map":
        return exporter.written(MapExport(amap, options), path)
    if exporter.subject == "route":
        return exporter.written(only_route(amap, options.routes, exporter.name), path)
    if len(options.drives) != 1:
        raise InputError(
            f"--drive is given {len(options.drives)} times, and {exporter.name} is of one drive; "
            "give the drive.csv of a comparison's `exports`."
        )
    path.mkdir()
    return exporter.written(drive_on(amap, options.drives[0]), path)


def _check_replaceable(names: Sequence[Path]) -> None:
    """Check that no folder stands in the place of a file.

    Raises:
        InputError: one does.
    """
    for name in names:
        if name.is_dir():
            raise InputError(f"{name}: this is a folder; choose another output.")


def _check_free(names: Sequence[Path]) -> None:
    """Check that no file exists that would be replaced.

    Raises:
        InputError: something is.
    """
    for name in names:
        if name.exists():
            raise InputError(
                f"{name}: this is there already; choose another output, or give --overwrite "
                "(overwrite=True in Python)."
            )
