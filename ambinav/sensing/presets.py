"""Scanner presets: named scanner files of ambinav and of plug-ins.

Ours are one YAML file each, in the folder presets beside this. The sensor of a preset that has
one kind of sensor goes by the same name in other scanner files.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from ambinav.config import read_text
from ambinav.plugins import Registry

_FOLDER: Final = Path(__file__).parent / "presets"


@dataclass(frozen=True, kw_only=True)
class ScannerPreset:
    """Entry of the registry of presets.

    Attributes:
        name: What `RangeScanner.from_preset` and `--scanner` take.
        yaml: The text of its scanner file (`scanner_file`).
        origin: The file of the text, as messages name it; "" for a plug-in's.
    """

    name: str
    yaml: str
    origin: str = ""


def _shipped(path: Path) -> ScannerPreset:
    return ScannerPreset(name=path.stem, yaml=read_text(path), origin=str(path))


PRESETS: Final = Registry(
    "scanner preset",
    ScannerPreset,
    "ambinav.sensors",
    {path.stem: partial(_shipped, path) for path in sorted(_FOLDER.glob("*.yaml"))},
)
"""The scanner presets."""


def preset_names() -> tuple[str, ...]:
    """Return the names of all presets, sorted."""
    return tuple(sorted(PRESETS.names()))
