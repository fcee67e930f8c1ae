"""What would help: the first posts that `ambinav design place` would put up, for the audit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from ambinav.design.place.candidates import PlaceRules
from ambinav.design.place.study import Help, find_help
from ambinav.errors import InputError
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing.scanner import RangeScanner

CANDIDATES: Final = 60
"""Places that are tried: an audit is to stay an audit."""
WIDER: Final = 0.5
"""The passage that is left is so much wider than the robot, metres, and 0.9 at least."""


@dataclass(frozen=True, eq=False)
class WhatHelps:
    """Posts that would help.

    Attributes:
        asked: How many were asked for.
        rules: What they are like, and where they may stand.
        found: Where they stand; None: none can.
        reason: Why none can, in a sentence; else empty.
    """

    asked: int
    rules: PlaceRules
    found: Help | None
    reason: str


def find_what_helps(
    environment: Environment,
    scanner: RangeScanner,
    amap: AmbiguityMap,
    reach: Reach,
    count: int,
    report: Callable[[float], None] = lambda share: None,
) -> WhatHelps:
    """Place posts for the whole map, by few candidates and without asking how good greedy is.

    Args:
        environment: The building.
        scanner: The scanner.
        amap: Its map.
        reach: What the robot reaches.
        count: How many posts.
        report: Called with the share done.
    """
    passage = max(2.0 * reach.radius + WIDER, PlaceRules().min_passage)
    reflective = len(scanner.intensity_beams) > 0
    rules = PlaceRules(min_passage=passage, most=CANDIDATES, reflective=reflective)
    try:
        found = find_help(
            environment, scanner, amap, rules, count, reach, report=lambda text: report
        )
    except InputError as error:
        return WhatHelps(count, rules, None, str(error))
    return WhatHelps(count, rules, found, "")
