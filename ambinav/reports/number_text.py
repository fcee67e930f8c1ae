"""Shares, areas and lengths as text, alike in reports, pictures and tables.

Sentences and legends have `percent` and `metres2`, with the digits that a reader needs; columns of
tables have `share_cell`, `area_cell` and `metres_cell`, with as many digits in every row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final


def percent(share: float | None) -> str:
    """Format a share as a whole percentage, with one decimal below 1 %; none as a dash.

    It is rounded as in documents first, so that what they keep reads the same.
    """
    if share is None:
        return "\N{EN DASH}"
    share = share if share < 0.001 else round(share, 4)
    if 0.0 < share < 0.001:
        return "less than 0.1 %"
    return f"{share * 100:.1f} %" if 0.0 < share < 0.01 else f"{share * 100:.0f} %"


def metres2(area: float) -> str:
    """Format an area in square metres with a suitable number of digits.

    It is rounded as in documents first: what they keep, and what is not kept yet, read the same.
    """
    area = round(area, 2)
    return f"{area:,.0f} m²" if area >= 10.0 else f"{area:.1f} m²"


def share_cell(share: float | None) -> str:
    """Format a share in percent with one decimal; none is empty."""
    return "" if share is None else f"{100.0 * share:.1f} %"


def area_cell(area: float) -> str:
    """Format an area in square metres with one decimal."""
    return f"{area:,.1f} m²"


def metres_cell(length: float | None) -> str:
    """Format a length in metres with two decimals and no unit; none is empty."""
    return "" if length is None else f"{length:.2f}"


FILTERS: Final[dict[str, Callable[..., str]]] = {
    "percent": percent,
    "metres2": metres2,
    "share": share_cell,
    "area": area_cell,
    "metres": metres_cell,
}
"""By their names in templates."""
