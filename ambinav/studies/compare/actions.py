"""The three most important actions that follow from a comparison."""

from __future__ import annotations

import math

from ambinav.reports.action import MOST, Action
from ambinav.reports.pages import listed
from ambinav.studies.compare.document import Document, VerdictPart
from ambinav.studies.compare.scenario import ALL_PAIRS
from ambinav.studies.compare.verdict_text import length_text

_RANK = {"met": 0, "better": 1, "easy": 2, "none": 3, "mixed": 3, "worse": 3}


def actions(report: Document) -> tuple[Action, ...]:
    """Return the recommended actions of a comparison, most helpful first; at least one."""
    ranked = sorted(
        (_of_pair(report, pair) for pair in report.verdicts if pair != ALL_PAIRS),
        key=lambda item: item[0],
    )
    actions = [action for _, action in ranked[:MOST]]
    uncertain = any(
        route.effect in ("none", "mixed")
        for pair in report.verdicts.values()
        for route in pair.routes
    )
    if uncertain:
        runs = report.parameters["drive"]["runs"]
        actions.append(
            Action(
                "Drive more runs",
                f"{runs} runs leave some differences open. With drive.runs at {4 * runs} the "
                "intervals are about half as wide; whole tens of finished runs are kept.",
            )
        )
    actions.append(
        Action(
            "Look for the cause",
            "Audit the building with this scanner: ambinav audit lists the worst places with the "
            "scan at each.",
        )
    )
    return tuple(actions[:MOST])


def _of_pair(report: Document, pair: str) -> tuple[int, Action]:
    """Return the recommended route of a pair and its rank: 0 helps most."""
    part = report.verdicts[pair]
    rows = {row.route: row.figures for row in report.rows if row.pair == pair}

    def order(route: VerdictPart) -> tuple[float, ...]:
        """Return what routes are sorted by: those that meet the criterion by their length."""
        rank, figures = _rank(route), rows[route.route]
        if rank == _RANK["met"]:
            return rank, route.length_ratio
        harm = (figures[key].value.value for key in ("lost", "error_p95"))
        return rank, *(math.inf if value is None else value for value in harm), route.length_ratio

    best = min(part.routes, key=order, default=None)
    baseline = part.baseline
    if best is None:
        return 3, Action(
            f"Add a route on {pair}", f"{baseline} is the only one: nothing is compared.", pair=pair
        )
    rank = _rank(best)
    if rank < 2:
        verb = "Consider" if rank else "Drive"
        return rank, Action(
            f"{verb} {best.route} on {pair}", _figures(report, pair, best), pair=pair
        )
    if rank == 2:
        return rank, Action(
            f"Keep {baseline} on {pair}", f"There is nothing to gain. {part.text}", pair=pair
        )
    return rank, Action(
        f"Change scanner or building for {pair}",
        f"No route is shown to be better than {baseline}. {part.text}",
        pair=pair,
    )


def _figures(report: Document, pair: str, best: VerdictPart) -> str:
    """Describe how a route's figures differ from its pair's baseline, in a sentence or two."""
    rows = {row.route: row.figures for row in report.rows if row.pair == pair}
    ours, theirs = rows[best.route], rows[report.verdicts[pair].baseline]
    parts = []
    for key, name, digits, unit in (
        ("lost", "lost", 0, "%"),
        ("error_p95", "95th percentile of the error", 2, "m"),
        ("collided", "collided", 0, "%"),
    ):
        values = ours[key].value.value, theirs[key].value.value
        if None not in values and (key != "collided" or any(values)):
            now, before = (f"{value:.{digits}f}" for value in values)
            parts.append(f"{name} {now} instead of {before} {unit}")
    parts.append(f"the route is {length_text(best.length_ratio)}")
    missed = [name for name, met in best.parts.items() if not met]
    criterion = (
        "The criterion is met."
        if best.outcome == "met"
        else (f"The criterion is missed by {listed(missed)}." if missed else "")
    )
    sentence = "; ".join(parts)
    return f"{sentence[0].upper()}{sentence[1:]}. {criterion}".strip()


def _rank(verdict: VerdictPart) -> int:
    if verdict.outcome == "met":
        return _RANK["met"]
    if verdict.effect == "better":
        return _RANK["better"]
    return _RANK["easy"] if verdict.outcome == "easy" else _RANK[verdict.effect]
