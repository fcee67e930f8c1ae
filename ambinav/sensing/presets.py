"""The scanners that come with ambinav: one YAML file each, in the folder presets beside this."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from ambinav.config import nearest
from ambinav.errors import InputError

FOLDER = Path(__file__).parent / "presets"


@dataclass(frozen=True)
class PresetSummary:
    """One line about a preset.

    Attributes:
        name: What `RangeScanner.from_preset` takes.
        kind: "laser", "cone" (sonars, and the zones of time-of-flight chips) or "mixed".
        beams: Number of beams.
        aperture: Field of view in radians, cones included.
        max_range: Farthest range in metres.
        description: What it is.
        source: Where its figures come from.
    """

    name: str
    kind: str
    beams: int
    aperture: float
    max_range: float
    description: str
    source: str

    def row(self) -> tuple[str, ...]:
        """Return the summary as the cells of a table; degrees and metres."""
        return (
            self.name,
            self.kind,
            str(self.beams),
            f"{math.degrees(self.aperture):.0f}°",
            f"{self.max_range:g} m",
            self.description,
            self.source,
        )


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


def preset_summaries() -> tuple[PresetSummary, ...]:
    """Return one summary a preset, sorted by name."""
    from ambinav.sensing.scanner import RangeScanner  # it needs preset_path from here

    scanners = [RangeScanner.from_preset(name) for name in preset_names()]
    return tuple(
        PresetSummary(
            name=s.name,
            kind="cone" if s.kind == "sonar" else s.kind,
            beams=s.beams,
            # From the edge of the first cone to that of the last.
            aperture=min(s.aperture + max(sensor.aperture for sensor in s.sensors), math.tau),
            max_range=s.max_range,
            description=s.description,
            source=s.source,
        )
        for s in scanners
    )
