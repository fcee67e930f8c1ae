"""Result of the search for posts by `audit.counterfactual.posts`."""

from __future__ import annotations

from dataclasses import dataclass

from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.study import Remedy


@dataclass(frozen=True, eq=False)
class PostSearch:
    """Posts that help, as found by the audit.

    Attributes:
        asked: How many were asked for.
        rules: What they are like, and where they may stand.
        found: Where they stand; None: none can, or none was tried.
        reason: Why, in a sentence; else empty.
        after: Bad floor with all of them, square metres, by a whole map; None: not known.
    """

    asked: int
    rules: PlaceRules
    found: Remedy | None
    reason: str
    after: float | None = None
