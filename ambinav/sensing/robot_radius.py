"""Default radius of the robot that carries a scanner."""

from __future__ import annotations

from collections.abc import Iterable

from ambinav.geometry.collision.reach import ROBOT_RADIUS
from ambinav.sensing.scanner import RangeScanner


def robot_radius(scanner: RangeScanner) -> float:
    """Radius of the robot where nobody gives one, metres: the scanner's, or `ROBOT_RADIUS`."""
    return ROBOT_RADIUS if scanner.robot_radius is None else scanner.robot_radius


def common_robot_radius(scanners: Iterable[RangeScanner]) -> float:
    """Radius of one robot for all of some scanners, metres: the largest of `robot_radius`."""
    return max(map(robot_radius, scanners))
