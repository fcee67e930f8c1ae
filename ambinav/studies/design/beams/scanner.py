"""A scanner with a subset of another scanner's beams, and the ROS filter for its messages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import yaml

from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Mounts, Part, Planar
from ambinav.sensing.mounting import TURN
from ambinav.sensing.scanner import RangeScanner

FRAME = "laser"


def subset_scanner(scanner: RangeScanner, beams: Sequence[int]) -> RangeScanner:
    """Return the scanner with a subset of its beams, listed mount by mount.

    A part that keeps all of its beams stays as it is, one that keeps none is left out.

    Args:
        scanner: The scanner.
        beams: Indices of the beams that are kept, each once.

    Raises:
        InputError: an index is given twice or there is no such beam.
    """
    kept = sorted(beams)
    if not kept or kept[0] < 0 or kept[-1] >= scanner.beams or len(set(kept)) < len(kept):
        raise InputError(
            f"beams: of scanner {scanner.name!r} give one or more of 0 to {scanner.beams - 1}, "
            "each once."
        )
    if len(kept) == scanner.beams:
        return scanner
    parts, first = [], 0
    for part in scanner.parts:
        mounts = part.layout.mounts()
        local = [beam - first for beam in kept if first <= beam < first + len(mounts)]
        first += len(mounts)
        if len(local) == len(mounts):
            parts.append(part)
        elif local:
            parts.append(Part(part.sensor, Mounts.of(mounts[local], part.layout.upright()[local])))
    name = f"{scanner.name} ({len(kept)} of {scanner.beams} beams)"
    return replace(scanner, parts=tuple(parts), name=name)


@dataclass(frozen=True)
class ScanMask:
    """Readings removed from one laser's LaserScan messages.

    Attributes:
        frame: `header.frame_id` of its messages.
        readings: Number of readings in a message.
        first: Direction of the first, relative to the laser's axis, degrees: `angle_min`.
        masked: Indices of the readings to leave out, ascending.
    """

    frame: str
    readings: int
    first: float
    masked: tuple[int, ...]


def planar_lasers(scanner: RangeScanner) -> dict[int, Planar]:
    """Return the fans of the parts that send LaserScan messages, by the number of their part."""
    return {
        number: part.layout
        for number, part in enumerate(scanner.parts)
        if isinstance(part.layout, Planar) and part.layout.beams > 1 and part.sensor.aperture == 0.0
    }


def scan_masks(
    scanner: RangeScanner,
    beams: Sequence[int],
    frames: Sequence[str] = (),
    angle_min: float | None = None,
) -> tuple[ScanMask, ...]:
    """Return the readings to remove from each laser's messages.

    A LaserScan message is that of a planar part without cones: readings in the order of the beams,
    counter-clockwise. Sonars, and what is listed mount by mount or in a ring, have no mask, and
    there is none where nothing is left out.

    Args:
        scanner: The full scanner.
        beams: The beams that are kept.
        frames: Frame of each such part; where there are fewer: "laser", "laser2" ...
        angle_min: Direction of a full circle's first reading, degrees; None: that of its first
            beam, -180. A fan begins with its first beam anyway.
    """
    kept = set(beams)
    masks: list[ScanMask] = []
    lasers = planar_lasers(scanner)
    begin = 0
    for index, part in enumerate(scanner.parts):
        count = len(part.layout.mounts())
        if index in lasers:
            layout, number = lasers[index], len(masks)
            frame = f"{FRAME}{number + 1 if number else ''}"
            removed = np.array([begin + k not in kept for k in range(count)])
            first = -180.0 if layout.full_circle else -math.degrees(layout.aperture / 2)
            if layout.full_circle and angle_min is not None:
                # Beam k looks to -pi + 2 pi k / B.
                removed = np.roll(
                    removed, -round((math.radians(angle_min) + math.pi) * count / TURN)
                )
                first = angle_min
            masked = tuple(np.flatnonzero(removed).tolist())
            masks.append(
                ScanMask(frames[number] if number < len(frames) else frame, count, first, masked)
            )
        begin += count
    return tuple(masks) if any(mask.masked for mask in masks) else ()


def laser_filters_text(masks: Sequence[ScanMask]) -> str:
    """Return parameters for ROS 2's `scan_to_scan_filter_chain` that remove the readings.

    Its `LaserScanMaskFilter` sets them to nan. It declares the indices as an array of doubles, so
    they are written with a point.
    """
    lines = [
        "# ros2 run laser_filters scan_to_scan_filter_chain --ros-args --params-file THIS_FILE"
    ]
    for mask in masks:
        lines.append(
            f"# frame {mask.frame}: {mask.readings - len(mask.masked)} of {mask.readings} readings "
            f"are kept; the first looks to {mask.first:g} degrees from the laser's axis (angle_min)"
        )
    chosen = {mask.frame: [float(index) for index in mask.masked] for mask in masks if mask.masked}
    filter1 = {
        "name": "chosen_beams",
        "type": "laser_filters/LaserScanMaskFilter",
        "params": {"masks": chosen},
    }
    plain = {"scan_to_scan_filter_chain": {"ros__parameters": {"filter1": filter1}}}
    return "\n".join(lines) + "\n" + yaml.safe_dump(plain, sort_keys=False, default_flow_style=None)
