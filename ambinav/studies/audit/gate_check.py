"""Check of a gate's conditions on an audit as it is, and on what is known of a change."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

from ambinav.maps.zones import ZONES
from ambinav.reports.conditions import Condition, judge
from ambinav.studies.audit.audit import Audit
from ambinav.studies.audit.document import Document, ZonePart, document

BY_AREA: Final = frozenset({*ZONES, *(f"{zone} area" for zone in ZONES), "bad", "bad area"})
"""Figures that follow from the areas of the zones."""
FIXED: Final = frozenset(
    {
        *("free area", "counted", "counted area", "unexplored", "unexplored area", "unreachable"),
        *("unreachable area", "cut off area", "outside", "outside area", "notes"),
    }
)
"""Figures that neither another scanner, heading or route nor posts change."""


class GateCheck:
    """The conditions of a gate, each of which fails it if it holds.

    Args:
        conditions: Conditions on the audit's figures.
        audit: The audit.
    """

    def __init__(self, conditions: Sequence[Condition], audit: Audit) -> None:
        self._conditions = tuple(conditions)
        self._audit = audit

    @cached_property
    def _report(self) -> Document:
        return document(self._audit)

    @cached_property
    def failing(self) -> tuple[Condition, ...]:
        """Conditions that fail the gate as things are.

        Raises:
            InputError: the audit lacks a figure.
        """
        return tuple(c for c in self._conditions if judge(c, self._report).holds)

    @property
    def is_fixed(self) -> bool:
        """True if all that fails the gate are figures that no change alters."""
        return all(condition.quantity.name in FIXED for condition in self.failing)

    def passes(self, areas: Sequence[float]) -> bool | None:
        """Return whether the gate passes after a change; None if that is not known.

        Figures that do not follow from the zones' areas, such as those at the worst heading, are
        taken to stay as they are where they pass today.

        Args:
            areas: Judged floor in each zone then, square metres, in the order of `ZONES`.
        """
        total = max(sum(areas), 1e-9)
        zones = tuple(
            ZonePart.model_validate(dict(zone) | {"area_m2": area, "share": area / total})
            for zone, area in zip(self._report.zones, areas, strict=True)
        )
        changed = self._report.model_copy(update={"zones": zones})
        following = [c for c in self._conditions if c.quantity.name in BY_AREA]
        if any(judge(condition, changed).holds for condition in following):
            return False
        undecided = {c.quantity.name for c in self.failing} - BY_AREA
        if undecided & FIXED:
            return False
        return None if undecided else True
