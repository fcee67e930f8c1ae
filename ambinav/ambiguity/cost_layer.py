"""Default layer of costs and rewards.

By what robots did on routes (docs/truth.md, "To plan by"): where the sensors differ and do not look
all around, Monte Carlo localization lost fewer robots on routes by `position`, and a Kalman filter
as many; with one kind of sensor `level` is as good.
"""

from __future__ import annotations

from ambinav.sensing.scanner import RangeScanner


def cost_layer(scanner: RangeScanner) -> str:
    """Return `position` for different sensors that do not look all around, else `level`."""
    several = len(scanner.sensors) > 1 and not scanner.looks_all_around
    return "position" if several else "level"
