"""Text of verdicts, for the opening of a report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from ambinav.drive.bootstrap import Interval
from ambinav.reports.criterion import AcceptanceCriterion
from ambinav.reports.number_text import percent
from ambinav.reports.pages import listed
from ambinav.routes.bad_floor import BadFloor, unexplored_note
from ambinav.studies.compare.criterion import CRITERION, Change, Effect, Outcome, Verdict

WALLS: Final = 0.5
"""Share of runs that end at a wall from which what was lost says little of a route."""
ERROR: Final = "95th percentile of the error"
MOST_DIGITS: Final = 4
"""Decimals of a difference at most."""

EFFECTS: Final[dict[Effect, str]] = {
    "better": "better",
    "worse": "worse",
    "mixed": "better and worse",
    "none": "makes no difference",
}
OUTCOMES: Final[dict[Outcome, str]] = {
    "met": "met",
    "not met": "not met",
    "easy": "nothing to gain",
}
"""Texts of the outcomes in reports."""


def criterion_text(criterion: AcceptanceCriterion = CRITERION) -> str:
    """Describe the acceptance criterion in a sentence."""
    return (
        "Criterion against the shortest route, of which all parts must hold: robots are lost at "
        f"most {percent(criterion.lost)} as often, the {ERROR} is at most "
        f"{percent(criterion.error)}, the route is planned at most {percent(criterion.extra)} "
        "longer, and robots are not shown to collide more often, nor do more than "
        f"{percent(criterion.walls)} of them. If no robot was lost or collided on the shortest "
        f"route and the {ERROR} is below {criterion.easy:g} m there, there is nothing to gain."
    )


def baseline_sentence(runs: int, lost: float, error: float, collided: float, route: str) -> str:
    """Describe the runs along the baseline route in a sentence.

    Args:
        runs: How many.
        lost: Share that was lost.
        error: 95th percentile of the error, metres.
        collided: Share that collided.
        route: Its name.
    """
    walls = f", {percent(collided)} collided" if collided else ""
    return f"{route}: {percent(lost)} of {runs} runs lost{walls}, {ERROR} {error:.2f} m."


def sentence(verdict: Verdict, route: str, baseline: str) -> str:
    """Describe how a route compares with another in a sentence.

    Args:
        verdict: Verdict on the route.
        route: Its name.
        baseline: Name of the other.
    """
    if _has_same_runs(verdict):
        return f"{route} gives exactly the same runs as {baseline}: it is the same path."
    opening = {
        "better": f"{route} is better than {baseline}",
        "worse": f"{route} is worse than {baseline}",
        "mixed": f"{route} is better than {baseline} in one respect and worse in another",
        "none": f"{route} makes no difference to {baseline} that {verdict.runs} runs show",
    }[verdict.effect]
    parts = [f"lost {_share(verdict.lost)}", f"{ERROR} {_metres(verdict.error)}"]
    if verdict.collided.ours.value or verdict.collided.theirs.value:
        parts.append(f"collided {_share(verdict.collided)}")
    parts.append(f"the route is {length_text(verdict.length)}")
    return f"{opening}: {'; '.join(parts)}. {_judged(verdict, baseline)}"


def floor_sentence(ours: BadFloor, theirs: BadFloor | None = None) -> str:
    """Describe the planned metres in corridor and open zones in a sentence.

    Args:
        ours: Bad floor on the route.
        theirs: Bad floor on the baseline; None for that one itself.
    """
    zones = [
        ("corridor", ours.corridor, ours.longest_corridor),
        ("open zones", ours.open, ours.longest_open),
    ]
    instead = ["", ""]
    if theirs is not None:
        instead = [
            f" instead of {metres:.1f} m ({longest:.1f} m)"
            for metres, longest in (
                (theirs.corridor, theirs.longest_corridor),
                (theirs.open, theirs.longest_open),
            )
        ]
    parts = [
        f"{metres:.1f} m in {zone} (longest stretch {longest:.1f} m){than}"
        for (zone, metres, longest), than in zip(zones, instead, strict=True)
    ]
    note = unexplored_note(ours)
    return f"Planned with {' and '.join(parts)}{f'; {note}' if note else ''}."


def headline(verdicts: Mapping[str, Verdict], baseline: str) -> str:
    """Summarize all routes of a pair in one sentence.

    Args:
        verdicts: Verdicts by the routes' names, without the baseline.
        baseline: Its name.
    """
    if not verdicts:
        return f"{baseline} is the only route; there is nothing to compare."
    named: dict[str, list[str]] = {"same": []}
    for route, verdict in verdicts.items():
        named.setdefault("same" if _has_same_runs(verdict) else verdict.effect, []).append(route)
    met = [route for route, verdict in verdicts.items() if verdict.outcome == "met"]
    short = [route for route in named.get("better", []) if route not in met]
    clauses = []
    first = next(iter(verdicts.values()))
    if first.easy:
        error = first.error.theirs.value
        clauses.append(
            f"nothing to gain, since on {baseline} no robot was lost and the {ERROR} is "
            f"{error:.3f} m"
        )
    if met:
        clauses.append(f"{listed(met)} {_verb(met, 'meets', 'meet')} the criterion")
    if short:
        clauses.append(
            f"{listed(short)} {_verb(short, 'is', 'are')} better than {baseline}"
            + (
                ""
                if verdicts[short[0]].easy
                else f" but {_verb(short, 'misses', 'miss')} the criterion"
            )
        )
    for kind, single, several, suffix in (
        ("mixed", "is", "are", f"better than {baseline} in one respect and worse in another"),
        ("none", "makes", "make", "no difference"),
        ("worse", "is", "are", f"worse than {baseline}"),
        ("same", "is", "are", f"the same path as {baseline}"),
    ):
        if named.get(kind):
            clauses.append(f"{listed(named[kind])} {_verb(named[kind], single, several)} {suffix}")
    collided = {baseline: first.collided.theirs.value}
    collided |= {route: verdict.collided.ours.value for route, verdict in verdicts.items()}
    at_walls = [f"{percent(share)} on {name}" for name, share in collided.items() if share >= WALLS]
    if at_walls:
        clauses.append(f"but walls end runs early ({listed(at_walls)})")
    text = "; ".join(clauses)
    return f"{text[0].upper() if clauses[0].startswith('nothing') else text[0]}{text[1:]}."


def length_text(ratio: float) -> str:
    """Describe a ratio of lengths in words."""
    extra = 100.0 * (ratio - 1.0)
    if abs(extra) < 0.05:
        return "as long"
    # A little more than the whole percentage that a criterion allows reads as more.
    digits = 2 if round(extra, 1) == round(extra) != round(extra, 9) else 1
    return f"{abs(extra):.{digits}f} % {'longer' if extra > 0.0 else 'shorter'}"


def _has_same_runs(verdict: Verdict) -> bool:
    # The interval of shares stays open however many runs are alike; that of the errors closes.
    error = verdict.error.difference
    shares = verdict.lost.difference.value, verdict.collided.difference.value
    return (
        abs(verdict.length - 1.0) < 1e-9
        and error.low == error.value == error.high == 0.0
        and shares == (0.0, 0.0)
    )


def _share(change: Change) -> str:
    spread = _interval(change.difference, 100.0, 0)
    ours, theirs = (100.0 * value.value for value in (change.ours, change.theirs))
    return f"{ours:.0f} instead of {theirs:.0f} % ({spread} points)"


def _metres(change: Change) -> str:
    spread = _interval(change.difference, 1.0, 2)
    return f"{change.ours.value:.2f} instead of {change.theirs.value:.2f} m ({spread})"


def _interval(interval: Interval, scale: float, digits: int) -> str:
    value, low, high = (
        _signed(scale * f, digits) for f in (interval.value, interval.low, interval.high)
    )
    return value if math.isnan(interval.low) else f"{value} [{low}, {high}]"


def _signed(value: float, digits: int) -> str:
    if math.isnan(value):
        return "-"
    # Enough digits for what is not 0 to read as such.
    while value != 0.0 and round(value, digits) == 0.0 and digits < MOST_DIGITS:
        digits += 1
    rounded = round(value, digits) + 0.0
    return f"{rounded:+.{digits}f}" if rounded else f"{rounded:.{digits}f}"


def _judged(verdict: Verdict, baseline: str) -> str:
    if verdict.easy:
        return f"There was nothing to gain: {baseline} is easy."
    if verdict.outcome == "met":
        return "The criterion is met."
    criterion = verdict.criterion
    missed = [
        text
        for met, text in (
            (verdict.lost_met, f"lost more than {percent(criterion.lost)} as often"),
            (verdict.error_met, f"error above {percent(criterion.error)}"),
            (verdict.length_met, f"more than {percent(criterion.extra)} longer"),
            (
                verdict.walls_met,
                "collides more often"
                if verdict.collided.more
                else f"walls end {100.0 * verdict.collided.ours.value:.0f} % of its runs",
            ),
        )
        if not met
    ]
    return f"The criterion is not met ({', '.join(missed)})."


def _verb(names: Sequence[str], singular: str, more: str) -> str:
    return singular if len(names) == 1 else more
