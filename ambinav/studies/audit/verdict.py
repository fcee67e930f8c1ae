"""The verdict of an audit: one decision and the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from ambinav.studies.audit.counterfactual.alternatives import Kind
from ambinav.studies.audit.counterfactual.search import AS_GOOD, Counterfactual

Decision = Kind | Literal["nothing", "none", "unknown"]
"""Kind of the change; or: nothing to do, no tried change pays off, no floor is explored."""


CHOICE: Final = (
    "The advice is the change with the least effort of those that remove at least "
    f"{100 * AS_GOOD:.0f} % as much as the best one."
)
"""How the advice follows from what was tried, for readers."""


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
