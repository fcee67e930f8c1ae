"""Alternative scanners: longer range, wider aperture, other models and mounts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Part, Planar
from ambinav.sensing.preset_summary import field_of_view
from ambinav.sensing.presets import preset_names
from ambinav.sensing.scanner import RangeScanner

Kind = Literal["mounting", "routes", "range", "aperture", "scanner", "heading", "building"]
"""Kind of a change, least effort first. Few robots can keep a heading while they drive."""

RANGES: Final = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 40.0)
"""Metres that range scanners are sold for."""
LONGER: Final = 1.25
"""A longer range is longer by this factor at least."""
SLIGHT: Final = math.radians(5.0)
"""Apertures that differ by less are alike."""
APERTURES: Final = (180.0, 270.0, 360.0)
"""Degrees."""


@dataclass(frozen=True)
class ScannerChange:
    """An alternative scanner in place of the present one.

    Attributes:
        kind: Kind of the change.
        title: Title in the imperative, for readers.
        scanner: The scanner.
        value: Metres of a range, degrees of an aperture; 0 of others.
    """

    kind: Kind
    title: str
    scanner: RangeScanner
    value: float = 0.0


def scanner_changes(scanner: RangeScanner, environment: Environment) -> list[ScannerChange]:
    """Return all alternative scanners for a building."""
    return [
        *other_mounts(scanner),
        *longer_ranges(scanner, environment),
        *wider_apertures(scanner),
        *other_models(scanner),
    ]


def longer_ranges(scanner: RangeScanner, environment: Environment) -> tuple[ScannerChange, ...]:
    """Return scanners of longer range, ascending, up to the first that spans the building."""
    xmin, ymin, xmax, ymax = environment.bounds
    across = math.hypot(xmax - xmin, ymax - ymin)
    changes: list[ScannerChange] = []
    for value in RANGES:
        if value < LONGER * scanner.max_range:
            continue
        try:
            longer = replace(
                scanner,
                parts=tuple(_with_range(part, scanner.max_range, value) for part in scanner.parts),
                name=f"{scanner.name} (max_range {value:g})",
            )
        except InputError:  # its calibration is known no farther
            break
        title = f"Use a scanner with a range of {value:g} m instead of {scanner.max_range:g} m"
        changes.append(ScannerChange("range", title, longer, value))
        if value >= across:
            break
    return tuple(changes)


def _with_range(part: Part, longest: float, value: float) -> Part:
    """Return the part with another range if it is one of those with the longest range."""
    if part.sensor.max_range < longest:
        return part
    return replace(part, sensor=replace(part.sensor, max_range=value))


def wider_apertures(scanner: RangeScanner) -> tuple[ScannerChange, ...]:
    """Return scanners of wider fans with the same angle between beams, ascending."""
    if scanner.looks_all_around:
        return ()
    fans = [part.layout for part in scanner.parts if isinstance(part.layout, Planar)]
    if not fans or fans[0].beams < 2:
        return ()
    changes = []
    for value in APERTURES:
        aperture = math.radians(value)
        if all(fan.aperture > aperture - math.radians(1.0) for fan in fans):
            continue
        wider = replace(
            scanner,
            parts=tuple(_with_aperture(part, aperture) for part in scanner.parts),
            name=f"{scanner.name} (aperture {value:g})",
        )
        now, then = (math.degrees(field_of_view(s)) for s in (scanner, wider))
        title = f"Use an aperture of {then:.0f}° instead of {now:.0f}°"
        changes.append(ScannerChange("aperture", title, wider, value))
    return tuple(changes)


def _with_aperture(part: Part, aperture: float) -> Part:
    layout = part.layout
    if not isinstance(layout, Planar) or layout.beams < 2 or layout.aperture >= aperture:
        return part
    return replace(part, layout=layout.with_aperture(aperture))


def other_mounts(scanner: RangeScanner) -> Iterator[ScannerChange]:
    """Yield the scanner mounted in the robot's centre; nothing if that changes nothing."""
    middle = scanner.mounts[:, :2].mean(axis=0)
    if scanner.looks_all_around or float(np.hypot(*middle)) < 0.05 or len(scanner.parts) > 1:
        return
    part = scanner.parts[0]
    if isinstance(part.layout, Planar):
        x, y, _ = part.layout.mount
        moved = replace(part, layout=part.layout.moved(-x, -y))
        centred_name = f"{scanner.name} (in the centre)"
        yield ScannerChange(
            "mounting", "Mount the scanner in the robot's centre",
            replace(scanner, parts=(moved,), name=centred_name),
        )  # fmt: skip


def other_models(scanner: RangeScanner) -> Iterator[ScannerChange]:
    """Yield presets of the same kind of sensor, at the present scanner's mount where it has one.

    Those that see neither farther nor wider are left out, and those that see less wide.
    """
    for name in preset_names():
        model = RangeScanner.from_preset(name)
        if model.kind != scanner.kind or name == scanner.name or model.upright.any():
            continue
        wider = field_of_view(model) - field_of_view(scanner)
        if wider < -SLIGHT or (wider < SLIGHT and model.max_range <= scanner.max_range):
            continue
        model = at_mount_of(scanner, model)
        title = f"Use {name} ({model.max_range:g} m, {math.degrees(field_of_view(model)):.0f}°)"
        yield ScannerChange("scanner", title, model)


def at_mount_of(scanner: RangeScanner, other: RangeScanner) -> RangeScanner:
    """Return another scanner where a scanner is mounted; as it is unless both are single fans.

    Its own yaw is added to that of the mount. One with a place of its own off the robot's centre
    stays there. One on the floor, whose file gives no height, is raised to the first one's height.
    """
    height = float(scanner.upright[:, 0].min())
    if height > 0.0 >= other.upright[:, 0].min():
        other = other.raised(height)
    if len(scanner.parts) > 1 or len(other.parts) > 1:
        return other
    place, part = scanner.parts[0].layout, other.parts[0]
    if not (isinstance(place, Planar) and isinstance(part.layout, Planar)):
        return other
    if any(part.layout.mount[:2]):
        return other
    x, y, yaw = place.mount
    layout = replace(part.layout, mount=(x, y, yaw + part.layout.mount[2]))
    return replace(other, parts=(replace(part, layout=layout),))
