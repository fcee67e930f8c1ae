"""Posts that help, as found by `audit.counterfactual.posts`, and their part of the document."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from ambinav.reports.fields import Metres, Part, SquareMetres
from ambinav.studies.design.improved import ImprovedPart
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.document import ObstaclePart, enough_text, obstacle_parts
from ambinav.studies.design.place.study import Remedy


@dataclass(frozen=True, eq=False)
class PostSearch:
    """Posts that help, as found by the audit.

    Attributes:
        requested: Number of requested posts.
        rules: Kind of the posts and rules for their positions.
        remedy: The placed posts; None: none can be placed, or none was tried.
        reason: The reason, in a sentence; otherwise empty.
        left: Bad floor after each of them, square metres, by a whole map.
        improved: Where most floor becomes good.
        zones: Judged floor in each zone with all of them, square metres, in the order of `ZONES`;
            what they cover counts as before. None if none was placed.
    """

    requested: int
    rules: PlaceRules
    remedy: Remedy | None
    reason: str
    left: tuple[float, ...] = ()
    improved: tuple[ImprovedPart, ...] = ()
    zones: tuple[float, ...] | None = None


class PostsPart(Part):
    """Recommended posts, each placed where it helps most after those before it."""

    asked: int = Field(description="number of requested posts")
    candidates: int = Field(description="number of positions that were tried")
    radius_m: Metres = Field(description="radius of a post")
    min_passage_m: Metres = Field(description="width of passages that is kept everywhere")
    before_m2: SquareMetres | None = Field(
        description="area of bad floor without posts; null: not known"
    )
    after_m2: SquareMetres | None = Field(
        description="area of bad floor with all of them, from a full map; null: there are none"
    )
    posts: tuple[ObstaclePart, ...] = Field(
        description="posts in the order of their selection; areas in m2, from full maps, but that "
        "of each alone, which is estimated from some places"
    )
    reason: str = Field(description="reason if there are fewer than requested; otherwise empty")


def posts_part(helps: PostSearch) -> PostsPart:
    """Collect the results of the post search."""
    placed_posts, reason = helps.remedy, helps.reason
    if placed_posts is not None and len(placed_posts.placement.placed) < helps.requested:
        reason = enough_text(placed_posts, helps.requested)
    return PostsPart(
        asked=helps.requested,
        candidates=0 if placed_posts is None else len(placed_posts.trials.candidates),
        radius_m=helps.rules.radius,
        min_passage_m=helps.rules.min_passage,
        before_m2=None if placed_posts is None else placed_posts.placement.before.bad,
        after_m2=helps.left[-1] if helps.left else None,
        posts=() if placed_posts is None else obstacle_parts(placed_posts, helps.left),
        reason=reason,
    )
