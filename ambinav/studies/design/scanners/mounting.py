"""Mounting heights of scanners compared in a three-dimensional building."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ambinav.config import as_positive
from ambinav.geometry.environment import Environment
from ambinav.sensing.scanner import RangeScanner

HEIGHT: Final = 0.3
"""Metres above the floor, of a scanner whose file says no height."""


def says_height(scanner: RangeScanner) -> bool:
    """Return whether all sensors are above the floor."""
    return bool(scanner.upright[:, 0].min() > 0.0)


def mounted(scanner: RangeScanner, height: float) -> RangeScanner:
    """Return the scanner as its file mounts it, or raised by `height` metres if it has no height.

    Raises:
        InputError: the height is not above zero.
    """
    height = as_positive(height, "height", "metres")
    return scanner if says_height(scanner) else scanner.raised(height)


def mounted_in(
    environment: Environment, scanners: Sequence[RangeScanner], height: float
) -> tuple[tuple[RangeScanner, ...], tuple[str, ...]]:
    """Return scanners as mounted in a building, and remarks for the reader.

    In a plan heights mean nothing, and all stay as they are.

    Raises:
        InputError: the height is not above zero.
    """
    if environment.space is None:
        return tuple(scanners), ()
    placed = tuple(mounted(scanner, height) for scanner in scanners)
    low = [scanner.name for scanner in scanners if not says_height(scanner)]
    if not low:
        return placed, ()
    remark = (
        f"Mounted {height:g} m above the floor, because their files give no height: "
        f"{', '.join(low)}."
    )
    return placed, (remark,)
