"""The demo building and what is asked of it: shipped, so that a wheel can show what it does.

    import ambinav as an

    env = an.load_environment(an.DEMO_BUILDING)

The building is drawn by `configs/draw_demo.py`; `configs/README.md` describes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

DEMO_BUILDING: Final = Path(__file__).with_name("demo.geojson")
"""A building of 45 by 28 m as GeoJSON, metres."""
DEMO_SCENARIO: Final = Path(__file__).with_name("compare-demo.yaml")
"""Routes through it to compare: `ambinav compare` reads this."""
DEMO_DRIVES: Final = Path(__file__).with_name("drive-demo.yaml")
"""Fewer of them: what `ambinav demo` drives."""
DEMO_SCANNER: Final = "hokuyo-urg-04lx"
"""The preset whose map is shown: a laser of 4 m."""
DEMO_START: Final = (3.0, 3.0)
DEMO_GOAL: Final = (42.0, 20.0)
"""From the lobby to the store, metres in the map frame: the shortest route is a bare corridor."""
