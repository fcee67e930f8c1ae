"""Default radius of the robot that carries a scanner."""

from __future__ import annotations

from collections.abc import Iterable

from ambinav.geometry.collision.reach import ROBOT_RADIUS
from ambinav.sensing.scanner import RangeScanner


def robot_radius(scanner: RangeScanner) -> float:
    """Return the default robot radius, metres: the scanner's, or `ROBOT_RADIUS`."""
    return ROBOT_RADIUS if scanner.robot_radius is None else scanner.robot_radius


def common_robot_radius(scanners: Iterable[RangeScanner]) -> float:
    """Return one radius for several scanners, metres: the largest of `robot_radius`."""
    return max(map(robot_radius, scanners))
