"""Actions recommended by an audit, taken from its advice."""

from __future__ import annotations

from typing import Final

from ambinav.reports.action import MOST, Action
from ambinav.reports.number_text import metres2, percent
from ambinav.studies.audit.document import Document
from ambinav.studies.audit.verdict import CounterfactualPart
from ambinav.studies.design.improved import improved_text

_LARGE_SHARE: Final = 0.1
"""Share of the free floor from which unexplored floor is worth mapping."""


def actions(report: Document) -> tuple[Action, ...]:
    """Return the recommended actions, most important first; empty if nothing needs to be done."""
    recommended = (
        [] if report.verdict is None else [_action(advice) for advice in report.verdict.advice]
    )
    if report.floor.unexplored_share >= _LARGE_SHARE:
        recommended.insert(
            1,
            Action(
                "Map the unexplored floor",
                f"On {metres2(report.floor.unexplored_area_m2)} "
                f"({percent(report.floor.unexplored_share)} of the free floor) half of the beams "
                "or more end in unknown space. This floor cannot be judged until it is mapped.",
            ),
        )
    return tuple(recommended[:MOST])


def _action(part: CounterfactualPart) -> Action:
    if part.kind == "routes":
        return Action(
            part.title,
            f"{part.detail} Weighted by how often it is driven, bad floor is "
            f"{metres2(part.after_m2)} instead of {metres2(part.before_m2)}.",
        )
    text = f"Bad floor: {metres2(part.before_m2)} now, {metres2(part.after_m2)} after the change"
    if part.places:
        text += (
            f", between {metres2(part.after_low_m2)} and {metres2(part.after_high_m2)}, estimated "
            f"at {part.places} places"
        )
    sentences = (f"{text}.", part.detail, improved_text(part.improved, named=False))
    return Action(part.title, " ".join(filter(None, sentences)))
