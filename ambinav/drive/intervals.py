"""Intervals as tables show and store them."""

from __future__ import annotations

import math

from ambinav.drive.bootstrap import Interval


def interval_text(interval: Interval, digits: int, sign: str = "") -> str:
    """Value and interval for readers: "3.1 [2.0, 4.5]", "-" where there is none.

    Args:
        interval: The figure.
        digits: After the point.
        sign: "+" to show signs.
    """
    if math.isnan(interval.value):
        return "-"
    value, low, high = (
        f"{round(f, digits) + 0.0:{sign}.{digits}f}"
        for f in (interval.value, interval.low, interval.high)
    )
    return f"{value} [{low}, {high}]".replace("inf", "∞")


def csv_cells(interval: Interval | None) -> list[str]:
    """Value, low and high end for a line of CSV; empty where there is nothing to tell."""
    if interval is None:
        return ["", "", ""]
    three = (interval.value, interval.low, interval.high)
    return ["" if math.isnan(f) else f"{f:.6g}" for f in three]
