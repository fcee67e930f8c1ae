"""The scanner of an environment: a planar laser by plain numbers, a preset or a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ambinav.config import (
    FaultError,
    NonNegative,
    Positive,
    check_fields,
    from_mapping,
    integer,
    number,
)
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor


@dataclass(frozen=True, kw_only=True)
class PlanarScanner:
    """A planar laser given by plain numbers; the default one sees all around.

    Attributes:
        beams: Number of beams.
        aperture: Radians from the first to the last; 2 pi is the full circle.
        max_range: Metres.
        std: Deviation of a reading, metres.
        resolution: Metres.
        height: Above the floor, metres, for buildings in space.

    Raises:
        InputError: a value makes no sense.
    """

    beams: Annotated[int, integer(most=10_000)] = 60
    aperture: Annotated[float, number(above=0, most=2.0 * math.pi)] = 2.0 * math.pi
    max_range: Positive = 4.0
    std: Positive = 0.03
    resolution: Positive = 0.01
    height: NonNegative = 0.0

    def __post_init__(self) -> None:
        """Check every field and convert it to its type."""
        check_fields(self)

    @property
    def scanner(self) -> RangeScanner:
        """The scanner with these values."""
        sensor = RangeSensor(max_range=self.max_range, std=self.std, resolution=self.resolution)
        return RangeScanner.planar(sensor, self.beams, self.aperture).raised(self.height)


def default_scanner() -> RangeScanner:
    """Return a laser with 60 beams of 4 m all around."""
    return PlanarScanner().scanner


def as_scanner(value: object) -> RangeScanner:
    """Convert a user's value to a scanner.

    Raises:
        FaultError: it is of another type.
        InputError: there is no such preset or file, or a field makes no sense.
    """
    if isinstance(value, RangeScanner):
        return value
    if isinstance(value, Path) or (isinstance(value, str) and value.endswith((".yaml", ".yml"))):
        return RangeScanner.from_yaml(value)
    if isinstance(value, str):
        return RangeScanner.from_preset(value)
    if isinstance(value, Mapping):
        return from_mapping(PlanarScanner, value).scanner
    raise FaultError(
        f"is of the type {type(value).__name__}; give a RangeScanner, the name of a preset, a "
        "YAML file, or fields of a PlanarScanner by name"
    )
