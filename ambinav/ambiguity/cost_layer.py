"""Which layer costs and rewards read where nobody names one.

By what the layers tell and what robots did on routes (docs/truth.md, "To plan by"): where the
sensors differ and do not look all around, `position` tells bad places far better, and robots on
routes by it were lost less, or no more on shorter ways; with one kind of sensor, `level` was the
better cost or as good.
"""

from __future__ import annotations

from ambinav.sensing.scanner import RangeScanner


def cost_layer(scanner: RangeScanner) -> str:
    """`position` for sensors of several kinds that do not look all around, else `level`."""
    several = len(scanner.sensors) > 1 and not scanner.looks_all_around
    return "position" if several else "level"
