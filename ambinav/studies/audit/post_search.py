"""Result of the search for posts by `audit.counterfactual.posts`."""

from __future__ import annotations

from dataclasses import dataclass

from ambinav.studies.design.improved import ImprovedPlace
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.study import Remedy


@dataclass(frozen=True, eq=False)
class PostSearch:
    """Posts that help, as found by the audit.

    Attributes:
        requested: Number of requested posts.
        rules: Kind of the posts and rules for their positions.
        remedy: The placed posts; None: none can be placed, or none was tried.
        reason: The reason, in a sentence; otherwise empty.
        after: Bad floor with all of them, square metres, by a whole map; None: not known.
        improved: Where most floor becomes good.
    """

    requested: int
    rules: PlaceRules
    remedy: Remedy | None
    reason: str
    after: float | None = None
    improved: tuple[ImprovedPlace, ...] = ()
