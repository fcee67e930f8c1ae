"""Advice for an audit: evaluate possible changes and choose the best ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ambinav.drive.bootstrap import Interval
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.reports.number_text import metres2, percent
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent, within
from ambinav.studies.audit.audit import Audit
from ambinav.studies.audit.counterfactual.posts import could_pay, find_posts
from ambinav.studies.audit.counterfactual.search import (
    PAYS,
    Counterfactual,
    as_good,
    by_effort,
    find_counterfactuals,
)
from ambinav.studies.audit.counterfactual.trips import find_trips
from ambinav.studies.audit.gate_check import GateCheck
from ambinav.studies.audit.post_search import PostSearch
from ambinav.studies.audit.verdict import Verdict

LITTLE: Final = 0.01
"""Share of the judged floor up to which bad floor is not worth a change."""
UNKNOWN_GATE: Final = " Only an audit with that change shows whether the gate then passes."
"""Ends the sentence where conditions are on figures that are not known of a change."""
SEED: Final = 0
"""Seed of the sampled places, so that the same audit gives the same verdict."""


def advise(
    result: Audit,
    *,
    posts: int | None = None,
    gate: GateCheck | None = None,
    progress: Progress = silent,
) -> Audit:
    """Return the audit with a verdict, and with posts if they can help.

    Args:
        result: The audit.
        posts: Number of posts to place in any case, 0 for none; None: three if they may remove
            more than other scanners and routes do.
        gate: The gate that the audit is to pass; None: there is none.
        progress: Called with the share done.
    """
    if posts is not None and posts < 0:
        raise InputError(f"posts: {posts} is negative; give 0 or more.")
    before = result.shares[CORRIDOR].area + result.shares[OPEN].area
    if not result.area:
        return replace(result, verdict=Verdict("unknown", _unexplored_sentence(result), before))
    little = before <= LITTLE * result.area
    if gate is not None:
        little = not gate.failing or (little and gate.is_fixed) or not before > 0.0
    nothing = Verdict("nothing", _nothing_to_do(result, before, gate), before)
    if little and not posts:
        return replace(result, verdict=nothing)
    rng = np.random.default_rng(SEED)
    trips = find_trips(result.amap, rng)
    tried = find_counterfactuals(
        result.amap, result.environment, result.scanner, rng, trips,
        within(progress, 0.0, 0.7),
    )  # fmt: skip
    helps = result.helps
    gain = max((change.removed for change in tried), default=0.0)
    try_posts = posts if posts is not None else could_pay(result.amap, result.scanner, gain)
    if try_posts:
        helps = find_posts(
            result.environment, result.scanner, result.amap, result.reach, posts or 3, trips, rng,
            within(progress, 0.7, 1.0),
        )  # fmt: skip
        tried = tuple(
            sorted((*tried, *_post_changes(helps, before)), key=lambda change: change.after.value)
        )
    progress(1.0)
    verdict = replace(nothing, tried=tried) if little else decide(result, before, tried, gate)
    return replace(result, verdict=verdict, helps=helps)


def decide(
    result: Audit, before: float, tried: Sequence[Counterfactual], gate: GateCheck | None
) -> Verdict:
    """Choose the verdict from the changes that were tried.

    What reaches the gate comes first, and of it the least work; else what removes nearly as much
    as the best, and of it the least work.
    """
    reaching = [change for change in tried if gate is not None and _passes(gate, change)]
    paying = [change for change in tried if change.removed >= PAYS * before]
    gated = bool(reaching)
    candidates = as_good(paying)
    if gated:
        candidates = by_effort(reaching)
    if not candidates:
        return Verdict("none", _no_remedy(result, before, tried), before, tried=tuple(tried))
    first = candidates[0]
    by_kind: dict[str, Counterfactual] = {}
    # In the order of the trials: that of a set would depend on addresses in memory.
    for change in sorted(
        dict.fromkeys((*paying, *reaching)), key=lambda change: change.after.value
    ):
        if change.kind != first.kind:
            by_kind.setdefault(change.kind, change)
    sentence = (
        f"{first.title}: floor where {result.scanner.name} leaves the robot lost falls from "
        f"{metres2(before)} to {_area_text(first.after)} of {metres2(result.area)}."
    )
    if first.kind == "routes":
        sentence = (
            f"{first.title}: {metres2(before)} of {metres2(result.area)} leave the robot lost with "
            f"{result.scanner.name}. {first.detail}"
        )
    if gated:
        sentence += " Then the gate passes."
    elif gate is not None:
        is_open = _passes(gate, first) is None
        sentence += UNKNOWN_GATE if is_open else " The gate fails even then."
    return Verdict(first.kind, sentence, before, (first, *by_kind.values()), tuple(tried), gated)


def _passes(gate: GateCheck, change: Counterfactual) -> bool | None:
    """Return whether a gate passes after a change; None if that is not known."""
    # Other routes leave the floor as it is.
    return change.zones is not None and gate.passes(change.zones)


def _post_changes(helps: PostSearch, before: float) -> list[Counterfactual]:
    """Return the counterfactual of the placed posts; empty if no post was placed."""
    if helps.remedy is None or not helps.left:
        return []
    count = len(helps.remedy.placement.placed)
    where = ", ".join(
        "({:.1f}, {:.1f})".format(*post.candidate.middle) for post in helps.remedy.placement.placed
    )
    after = Interval(helps.left[-1], helps.left[-1], helps.left[-1], 0)
    title = f"Place {count} post{'s' if count > 1 else ''}"
    detail = f"At x, y = {where} m."
    return [Counterfactual("building", title, detail, before, after, helps.improved, helps.zones)]


def _area_text(after: Interval) -> str:
    """Format an area, with its interval if it is an estimate."""
    if after.high - after.low < 0.05:
        return metres2(after.value)
    return f"{metres2(after.value)} (between {metres2(after.low)} and {metres2(after.high)})"


def _well_localized(result: Audit) -> str:
    bad = result.shares[CORRIDOR].share + result.shares[OPEN].share
    share = percent(bad)
    most = "all" if bad == 0.0 else "almost all" if share == percent(0.0) else f"all but {share}"
    return (
        f"with {result.scanner.name} a robot of radius {result.reach.radius:.2f} m can tell its "
        f"position on {most} of the {metres2(result.area)} that it can reach in "
        f"{result.environment.name}"
    )


def _nothing_to_do(result: Audit, before: float, gate: GateCheck | None) -> str:
    if gate is None:
        return f"Nothing to do: {_well_localized(result)}."
    if not gate.failing:
        return f"Nothing to do: the gate passes; {metres2(before)} of floor leave the robot lost."
    well = _well_localized(result)
    names = " and ".join(dict.fromkeys(condition.quantity.name for condition in gate.failing))
    return f"{well[0].upper()}{well[1:]}, but the gate fails on other figures: {names}."


def _no_remedy(result: Audit, before: float, tried: Sequence[Counterfactual]) -> str:
    best = min(tried, key=lambda change: change.after.value, default=None)
    sentence = (
        f"Floor of {metres2(before)} leaves {result.scanner.name} lost, and no tested change "
        "removes a tenth of it"
    )
    if best is None or best.removed <= 0.0:
        around = "" if any(change.kind == "routes" for change in tried) else "plan around it, or "
        return f"{sentence}: {around}use another kind of sensor."
    return (
        f"{sentence}; the best one is to {best.title[0].lower()}{best.title[1:]}, which leaves "
        + (f"{_area_text(best.after)}.")
    )


def _unexplored_sentence(result: Audit) -> str:
    if not result.parts.unexplored.any():
        return (
            f"Close the building first: all floor that the robot can reach in "
            f"{result.environment.name} is outside of it or at the border of the map."
        )
    return (
        f"Map the building first: none of the floor that the robot can reach in "
        f"{result.environment.name} is explored."
    )
