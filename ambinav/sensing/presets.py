"""The scanners that come with ambinav: one YAML file each, in the folder presets beside this."""

from __future__ import annotations

from pathlib import Path

from ambinav.config import nearest
from ambinav.errors import InputError

FOLDER = Path(__file__).parent / "presets"


def preset_names() -> tuple[str, ...]:
    """Return the names of all presets, sorted."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))


def preset_path(name: str) -> Path:
    """Return the YAML file of a preset.

    Raises:
        InputError: there is no such preset; the nearest names are offered.
    """
    if name not in preset_names():
        raise InputError(f"there is no scanner preset {name!r}; {nearest(name, preset_names())}.")
    return FOLDER / f"{name}.yaml"
