"""Export of selected drives for other programs: trajectories, a CARMEN log, a table."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.runs import BLOCK, items_of
from ambinav.studies.compare.scenario_schema import ExportsPart
from ambinav.studies.compare.workers import Item, Setup, drive_item, in_workers

ABOUT: Final = "about.json"
"""File that describes the drives of a route, in their folder."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A route and the drives to export.

    Attributes:
        plan: The route.
        items: The pieces of work that hold the wanted runs.
        folder: Output folder.
    """

    plan: Plan
    items: tuple[Item, ...]
    folder: Path


def export_all(
    setup: Setup, plans: Sequence[Plan], folder: Path, names: Sequence[str], jobs: int
) -> tuple[str, ...]:
    """Write the drives requested by the scenario, one folder for each route.

    The drives are made once more, with their readings; they are the same. Folders that hold just
    what is asked for are left as they are; those of an earlier scenario are removed.

    Args:
        setup: The scenario with its worlds.
        plans: All routes.
        folder: Holds the routes' folders.
        names: Names of the routes' folders.
        jobs: How many processes.

    Returns:
        The names of the folders that hold drives.
    """
    exports = setup.scenario.exports
    blocks = {number // BLOCK for number in exports.numbers}
    pieces, written = [], []
    for plan, name in zip(plans, names, strict=True):
        if not blocks or (exports.routes is not None and plan.name not in exports.routes):
            continue
        items = tuple(item for item in items_of(setup, plan) if item.block in blocks)
        piece = Piece(plan, items, folder / name)
        written.append(name)
        if not _is_there(piece, exports):
            pieces.append(piece)
    for _ in in_workers(setup, _export, pieces, jobs):
        pass
    for older in folder.iterdir() if folder.is_dir() else ():
        is_current = older.name in written or older.is_symlink()
        if not is_current and (older / ABOUT).is_file():
            shutil.rmtree(older)
    return tuple(written)


def _export(setup: Setup, piece: Piece) -> None:
    """Repeat the runs of a route and write them atomically."""
    from ambinav.logs.export_drive import drive_log, export_drive

    exports = setup.scenario.exports
    numbers = exports.numbers
    about = _about(piece, exports) | {"scanner": setup.scanner.to_yaml()}
    with replacing(piece.folder) as fresh:
        fresh.mkdir()
        for item in piece.items:
            drives = drive_item(setup, item, keep_ranges=True)
            scanner: RangeScanner | None = setup.scanner
            try:
                drive_log(drives, 0, setup.scanner)
            except InputError as error:
                # A CARMEN log cannot describe every scanner; the other formats remain useful.
                about["no_carmen_log"], scanner = str(error), None
            for number in numbers:
                if number // BLOCK == item.block:
                    run = number - BLOCK * item.block
                    files = fresh / _run_name(number)
                    export_drive(drives, run, files, scanner, exports.formats)
        (fresh / ABOUT).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")


def _about(piece: Piece, exports: ExportsPart) -> dict[str, Any]:
    return {
        "pair": piece.plan.pair,
        "route": piece.plan.name,
        "runs": [number + 1 for number in exports.numbers],
        "keys": [item.key for item in piece.items],
        "formats": None if exports.formats is None else list(exports.formats),
    }


def _is_there(piece: Piece, exports: ExportsPart) -> bool:
    try:
        stored = json.loads((piece.folder / ABOUT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    expected = _about(piece, exports)
    runs = all((piece.folder / _run_name(number)).is_dir() for number in exports.numbers)
    return (
        isinstance(stored, dict) and runs and {key: stored.get(key) for key in expected} == expected
    )


def _run_name(number: int) -> str:
    return f"run-{number + 1:03d}"
