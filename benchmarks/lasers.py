"""Laser of most benchmarks: beams all around from the robot's centre."""

from __future__ import annotations

import math
from typing import Any

from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor


def laser(
    max_range: float = 4.0, std: float = 0.03, beams: int = 60, **mounting: Any
) -> RangeScanner:
    """Return beams over the full circle with a resolution of 1 mm; `mounting` as for `planar`."""
    sensor = RangeSensor(max_range=max_range, std=std, resolution=0.001)
    return RangeScanner.planar(sensor, beams, 2.0 * math.pi, **mounting)
