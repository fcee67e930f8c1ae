"""Table of ambinav's scanner presets, one line each."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ambinav.sensing.presets import preset_names
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True)
class PresetSummary:
    """Summary of a preset in one line.

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


def field_of_view(scanner: RangeScanner) -> float:
    """Return a scanner's field of view, radians, from the first cone's edge to the last one's."""
    return min(scanner.aperture + max(sensor.aperture for sensor in scanner.sensors), math.tau)


def preset_summaries() -> tuple[PresetSummary, ...]:
    """Return one summary per preset, sorted by name."""
    scanners = [RangeScanner.from_preset(name) for name in preset_names()]
    return tuple(
        PresetSummary(
            name=s.name,
            kind="cone" if s.kind == "sonar" else s.kind,
            beams=s.beams,
            aperture=field_of_view(s),
            max_range=s.max_range,
            description=s.description,
            source=s.source,
        )
        for s in scanners
    )
