"""Estimate of the time and memory that a map takes, before it is made."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numba

from ambinav.ambiguity.model import thin
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import HEADINGS, TILE_BYTES
from ambinav.sensing.scanner import RangeScanner

# Seconds of one thread, between what two processors took (benchmarks/results/map.md, and the same
# at commit 04728c3): on 2 threads the kernel compares 832 and 263 million beams a second with one
# heading; casting 136 000 poses of 60 rays takes 0.14 and 0.35 s, turning on the spot 0.42 and
# 1.0 s.
PER_COMPARISON: Final = 4.8e-9
PER_RAY: Final = 55e-9
# Of a ray in space (benchmarks/results/prisms.md): between what prisms and Embree take of one.
PER_SPACE_RAY: Final = 250e-9
PER_TURNED_BEAM: Final = 160e-9
# Bytes, from the same run's peaks: the program; a pose, and one more heading of it; a cell of the
# floor's bounding box, in all layers, and one more heading of it; a ray's hit from a pose.
PROGRAM: Final = 230e6
PER_HIT: Final = 12.0
PER_POSE: Final = 500.0
PER_POSE_AND_HEADING: Final = 120.0
PER_CELL_AND_HEADING: Final = 48.0

_UNITS: Final = (("day", 1440.0), ("hour", 60.0), ("minute", 1.0))


@dataclass(frozen=True)
class Estimate:
    """Expected cost of a map, to a factor of about two on today's processors.

    Attributes:
        spacing: Distance of its points, metres.
        poses: Free points.
        neighbours: Points that each is compared with.
        beams: Beams that take part.
        headings: Headings at each point.
        seconds: Time to make it, without further layers.
        bytes: Memory at the peak.
    """

    spacing: float
    poses: float
    neighbours: float
    beams: int
    headings: int
    seconds: float
    bytes: float

    def times(self, count: int) -> Estimate:
        """Return the estimate of several such maps, made one after the other."""
        return replace(self, poses=count * self.poses, seconds=count * self.seconds)

    def __str__(self) -> str:
        """Return minutes and GB in words."""
        gigabytes = max(self.bytes / 1e9, 0.1)
        memory = f"{gigabytes:.0f}" if gigabytes >= 10.0 else f"{gigabytes:.2g}"
        return f"{time_text(self.seconds)} and {memory} GB"


def time_text(seconds: float) -> str:
    """Format a duration roughly, such as "about 3 hours"."""
    minutes = seconds / 60.0
    if minutes < 0.75:
        return "less than a minute"
    unit, size = next((unit, size) for unit, size in _UNITS if minutes >= 1.5 * size or size == 1.0)
    count = round(minutes / size)
    return f"about {count} {unit}{'' if count == 1 else 's'}"


def estimate(
    environment: Environment,
    scanner: RangeScanner,
    spacing: float = 0.1,
    radius: float = 0.5,
    headings: int | None = None,
) -> Estimate:
    """Estimate the cost of `build_map` with these arguments on this computer."""
    xmin, ymin, xmax, ymax = environment.free.bounds
    poses = environment.free.area / spacing**2
    cells = (xmax - xmin) * (ymax - ymin) / spacing**2
    # Points within the radius; walls keep some of them apart.
    neighbours = max(0.9 * math.pi * (radius / spacing) ** 2, 1.0)
    thinned = thin(scanner)
    turning = headings is None and scanner.looks_all_around
    count = headings or (1 if turning else HEADINGS)
    rays = len(thinned.rays(environment.space is not None))
    each = (
        neighbours * thinned.beams * PER_COMPARISON
        + rays * (PER_RAY if environment.space is None else PER_SPACE_RAY)
        + (thinned.beams * PER_TURNED_BEAM if turning else 0.0)
    )
    # A tile and the one before it are held at a time, and the hits of all rays of one heading.
    tile = TILE_BYTES / (count * thinned.beams * 5 * 4)
    tiles = min(poses, 2.0 * tile) * count * thinned.beams * 5 * 4
    hits = min(poses, tile) * rays * PER_HIT
    memory = (
        PROGRAM
        + tiles
        + hits
        + poses * (PER_POSE + PER_POSE_AND_HEADING * count)
        + cells * PER_CELL_AND_HEADING * count
    )
    seconds = poses * count * each / numba.get_num_threads()
    return Estimate(spacing, poses, neighbours, thinned.beams, count, seconds, memory)


def coarser(
    environment: Environment,
    scanner: RangeScanner,
    spacing: float,
    radius: float,
    headings: int | None,
    seconds: float,
) -> Estimate | None:
    """Return the estimate at the least wider spacing below `seconds`, or at the widest.

    A spacing is at most the radius; None where it is that already.
    """
    wider = None
    for factor in (1.5, 2.0, 3.0, 4.0, 5.0):
        candidate = float(f"{factor * spacing:.3g}")
        if candidate > radius * (1.0 + 1e-9):
            break
        wider = estimate(environment, scanner, candidate, radius, headings)
        if wider.seconds < seconds:
            break
    return wider
