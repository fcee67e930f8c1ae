"""The table of colours as a module of the page, generated from the Python table.

The page imports `page/style.js`; the server answers it with this text, a report embeds it.
"""

from __future__ import annotations

import json
from typing import Any, Final

from ambinav.maps.judged_floor import REASONS
from ambinav.maps.zones import MEANINGS, ZONES
from ambinav.plotting import style

ROUTES: Final = 4
"""Styles of each kind of route that the page is given."""


def page_style() -> dict[str, Any]:
    """Return colours by meaning, hexadecimal; those of routes with rim and dashes.

    Dashes are in line widths.
    """
    return {
        "zones": [
            {"name": name, "colour": colour, "meaning": meaning}
            for name, colour, meaning in zip(ZONES, style.ZONE_COLOURS, MEANINGS, strict=True)
        ],
        "judged": list(REASONS),
        "floor": style.FLOOR,
        "solid": style.SOLID,
        "unreachable": style.UNREACHABLE,
        "unknown": style.UNKNOWN,
        "unexplored": style.UNEXPLORED,
        "wall": style.WALL,
        "frontier": style.FRONTIER,
        "reflector": style.REFLECTOR,
        "echo": style.ECHO,
        "silent": style.SILENT,
        "slide": style.SLIDE,
        "lost": style.ZONE_COLOURS[3],
        "letters": {"start": style.START, "goal": style.GOAL},
        "routes": {
            kind: [style.route_style(kind, number)._asdict() for number in range(ROUTES)]
            for kind in style.ROUTE_COLOURS
        },
        "series": list(style.SERIES),
    }


def style_module() -> str:
    """Return the same as an ES module with a default export."""
    return f"export default {json.dumps(page_style(), indent=1)};\n"
