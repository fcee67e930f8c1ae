"""The verdict of an audit: one decision and the evidence for it, also in the document."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from pydantic import Field

from ambinav.maps.zones import ZONES
from ambinav.reports.fields import Part, SquareMetres
from ambinav.studies.audit.counterfactual.alternatives import Kind
from ambinav.studies.audit.counterfactual.search import AS_GOOD, PAYS, Counterfactual
from ambinav.studies.design.improved import ImprovedPart

Decision = Kind | Literal["nothing", "none", "unknown"]
"""Kind of the change; or: nothing to do, no tried change pays off, no floor is explored."""


CHOICE: Final = (
    "The advice is the change with the least effort of those that remove at least "
    f"{100 * AS_GOOD:.0f} % as much as the best one."
)
"""Explanation, for readers, of how the advice follows from what was tried."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """The recommended change for a building and a scanner.

    Attributes:
        decision: The kind of the first advice, or that there is none.
        sentence: The decision for readers, with bad floor before and after.
        before: Bad floor, square metres.
        advice: Changes that pay off: the first advice, then the best of each other kind.
        tried: All that was tried, the most floor removed first.
        gated: Whether the advice is what reaches a gate.
    """

    decision: Decision
    sentence: str
    before: float
    advice: tuple[Counterfactual, ...] = ()
    tried: tuple[Counterfactual, ...] = ()
    gated: bool = False


class CounterfactualPart(Part):
    """The building with one change."""

    kind: str = Field(description="mounting, routes, range, aperture, scanner, heading or building")
    title: str = Field(description="the change, in the imperative")
    detail: str = Field(description="further consequences; or empty")
    before_m2: SquareMetres = Field(description="area of bad floor now")
    after_m2: SquareMetres = Field(
        description="area of bad floor after the change, on the same judged floor"
    )
    after_low_m2: SquareMetres = Field(description="lower end of its 95 % interval")
    after_high_m2: SquareMetres = Field(description="upper end")
    places: int = Field(
        description="number of places at which it was computed; 0: on the whole floor"
    )
    zones_m2: dict[str, SquareMetres] | None = Field(
        description="judged floor in each zone after the change; null: not known"
    )
    improved: tuple[ImprovedPart, ...] = Field(
        description="the three places where most floor becomes good, the largest first; estimated "
        "as the bad floor is; none where that is not known"
    )
    pays: bool = Field(description="true if it removes a tenth of the bad floor or more")
    scanner: str | None = Field(description="the other scanner; null: the present one")


class VerdictPart(Part):
    """The recommendation: the first sentence of the report and the evidence for it."""

    decision: str = Field(
        description="kind of the first advice; nothing: nothing to do; none: no tested change is "
        "worth it; unknown: nothing is explored"
    )
    sentence: str
    bad_m2: SquareMetres = Field(description="area of floor in corridor and open zones")
    reaches_gate: bool = Field(description="true if the advice makes the conditions pass")
    advice: tuple[CounterfactualPart, ...] = Field(
        description="what removes a tenth of the bad floor or reaches the gate: the first advice, "
        "then the best of each other kind"
    )
    tried: tuple[CounterfactualPart, ...] = Field(
        description="all tested changes, sorted by the floor that they remove, largest first"
    )


def verdict_part(verdict: Verdict) -> VerdictPart:
    """Collect the decision and its evidence."""
    return VerdictPart.of(
        verdict,
        bad_m2=verdict.before,
        reaches_gate=verdict.gated,
        advice=tuple(map(_part, verdict.advice)),
        tried=tuple(map(_part, verdict.tried)),
    )


def _part(change: Counterfactual) -> CounterfactualPart:
    return CounterfactualPart.of(
        change,
        after_m2=change.after.value,
        after_low_m2=change.after.low,
        after_high_m2=change.after.high,
        places=change.after.count,
        zones_m2=None if change.zones is None else dict(zip(ZONES, change.zones, strict=True)),
        pays=change.removed >= PAYS * change.before,
        scanner=None if change.scanner is None else change.scanner.name,
    )
