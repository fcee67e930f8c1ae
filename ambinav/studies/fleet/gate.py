"""Conditions on the figures of all sites of a fleet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ambinav.reports.conditions import Condition, Outcome, judge
from ambinav.runtime.errors import InputError
from ambinav.studies.fleet.document import Result

NAMED: Final = 10
"""Sites that a message names at most."""


def judge_fleet(
    condition: Condition, results: Sequence[Result]
) -> tuple[Outcome | None, list[Result]]:
    """Evaluate a condition at every site.

    Args:
        condition: On a figure of an audit; it holds for the fleet if it holds at any site.
        results: The results of the fleet.

    Returns:
        The outcome at the worst site, which names all those where it holds (None: no site can be
        judged), and the results that lack the figure.
    """
    outcomes: list[tuple[Outcome, Result]] = []
    lacking = []
    for result in results:
        try:
            if result.audit is None:
                raise InputError(result.error)
            outcomes.append((judge(condition, result.audit), result))
        except InputError:
            lacking.append(result)
    if not outcomes:
        return None, lacking
    is_upper = condition.limit.operator.startswith(">")
    outcomes.sort(key=lambda pair: pair[0].value, reverse=is_upper)
    holding = [(outcome, result) for outcome, result in outcomes if outcome.holds]
    unit = condition.quantity.unit
    named = ", ".join(
        f"{name_of(result)} {outcome.value:.4g}{f' {unit}' if unit else ''}"
        for outcome, result in holding[:NAMED]
    )
    where = f"At {len(holding)} of {len(results)}: {named}{_and_others(len(holding))}."
    return Outcome(condition, outcomes[0][0].value, where), lacking


def name_of(result: Result) -> str:
    """Return site and scanner."""
    return f"{result.site} ({result.scanner})"


def names_of(results: Sequence[Result]) -> str:
    """Return sites and scanners, of many only the first."""
    return f"{', '.join(map(name_of, results[:NAMED]))}{_and_others(len(results))}"


def _and_others(count: int) -> str:
    return f" and {count - NAMED} others" if count > NAMED else ""
