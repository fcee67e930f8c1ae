"""Recommended posts in the audit's document."""

from __future__ import annotations

from pydantic import Field

from ambinav.reports.fields import Metres, Part, SquareMetres
from ambinav.studies.audit.what_helps import WhatHelps
from ambinav.studies.design.place.document import ObstaclePart, enough_text, obstacle_parts


class HelpPart(Part):
    """Recommended posts, each placed where it helps most after those before it."""

    asked: int = Field(description="posts that were asked for")
    candidates: int = Field(description="places that were tried")
    radius_m: Metres = Field(description="of a post")
    min_passage_m: Metres = Field(description="that is left everywhere")
    before_m2: SquareMetres | None = Field(description="bad floor without posts; null: not known")
    after_m2: SquareMetres | None = Field(description="bad floor with all of them, by a whole map")
    posts: tuple[ObstaclePart, ...] = Field(description="in the order of choice; areas in m2")
    reason: str = Field(description="why there are fewer than were asked for; else empty")


def help_part(helps: WhatHelps) -> HelpPart:
    """Collect the results of the post search."""
    found, reason = helps.found, helps.reason
    if found is not None and len(found.placement.placed) < helps.asked:
        reason = enough_text(found, helps.asked)
    return HelpPart(
        asked=helps.asked,
        candidates=0 if found is None else len(found.trials.candidates),
        radius_m=helps.rules.radius,
        min_passage_m=helps.rules.min_passage,
        before_m2=None if found is None else found.placement.before.bad,
        after_m2=helps.after,
        posts=() if found is None else obstacle_parts(found),
        reason=reason,
    )
