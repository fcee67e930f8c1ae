"""Verdict and tables of `study_reflector_drives.py`: where robots are lost, by which layout."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from harness import commits, table
from numpy.typing import NDArray

from ambinav.drive.bootstrap import Interval, grouped_weights, paired_share, percentiles, share
from ambinav.studies.design.reflectors.study import GOOD, STATES

LAYOUTS = ("planned", "for two", "random", "none")
"""`for two`: planned for two reflectors in view instead of three."""
IN_VIEW = ("0", "1", "2", "3 or more")
STRETCHES = (0.0, 2.0, 5.0, 10.0, 20.0)
"""Bounds of the longest stretch of a route that is not navigable, metres."""
SURE = 0.25
"""A robot that is lost, and claims a smaller standard deviation of its position, metres."""
NO_EVENT = 3.7
"""Upper end of the interval of a Poisson mean without an event, where resampling gives a point."""
Row = dict[str, Any]
Floats = NDArray[np.float64]


def body(about: str, rows: Sequence[Row]) -> str:
    """Return the report's text and tables; `about` says what was done."""
    seeing = [row for row in rows if row["layout"] != "none"]
    navigable = [row for row in seeing if row["stretch"] == 0.0]
    times = hazard_ratio(seeing)
    wide = interval_of(navigable)
    gains = (percent(difference(rows, arm)) for arm in LAYOUTS[:2])
    parts = [
        about.strip(),
        f"Driven at: {commits(rows)}.",
        "## Verdict",
        f"- In a metre of floor that the layer does not call navigable robots lose themselves "
        f"{times.value:.0f} times as often ({times.low:.0f} to {times.high:.0f}) as in one that it "
        f"does.\n- On the {len(navigable)} drives of routes that are navigable throughout "
        f"{percent(wide)} of the robots are lost.\n- Lost with planned layouts, less lost with "
        f"random ones, in points: {'; for two in view '.join(gains)}.",
        "## Where robots lose themselves, all layouts together",
        hazards(seeing, "state", STATES),
        hazards(seeing, "view", IN_VIEW),
        "Of routes, by their longest stretch that is not navigable:",
        stretches(seeing),
        "## Layouts",
        layouts(rows),
        f"*Sure*: share of the lost robots that then claim a position's deviation below {SURE} m. "
        "*Error*: median over the robots that are never 0.5 m or 30 degrees off.",
        arms(rows),
    ]
    return "\n\n".join(parts)


def lost_of(rows: Sequence[Row]) -> tuple[NDArray[np.bool_], NDArray[np.str_]]:
    """Return whether each run was lost, and its building; its route if all are of one building."""
    lost = np.array([lost for row in rows for lost in row["lost"]], dtype=np.bool_)
    by = "route" if len({row["building"] for row in rows}) == 1 else "building"
    return lost, np.array([str(row[by]) for row in rows for _ in row["lost"]], dtype=np.str_)


def interval_of(rows: Sequence[Row]) -> Interval:
    """Return the share of lost robots."""
    lost, group = lost_of(rows)
    return share(lost, group=group)


def percent(interval: Interval) -> str:
    """Format a share with its interval."""
    value, low, high = (100.0 * v for v in (interval.value, interval.low, interval.high))
    return f"{value:.1f} % ({low:.1f} to {high:.1f})"


def difference(rows: Sequence[Row], layout: str) -> Interval:
    """Return the share of robots lost with a kind of layouts, less that with random ones."""
    (ours, group), (theirs, _) = (
        lost_of([row for row in rows if row["layout"] == arm]) for arm in (layout, "random")
    )
    return paired_share(ours, theirs, group=group)


def resampled(rows: Sequence[Row], figure: Callable[[Floats], Floats]) -> Interval:
    """Return a figure of weights (D, N) of the rows with its interval."""
    group = np.array([row["building"] for row in rows])
    weights = np.concatenate(list(grouped_weights(group, np.random.default_rng(1))))
    return percentiles(float(figure(np.ones((1, len(rows))))[0]), figure(weights), len(rows))


def hazard_ratio(rows: Sequence[Row]) -> Interval:
    """Return how much more often robots lose themselves in a metre that is not navigable."""
    good = np.arange(len(STATES)) == GOOD

    def figure(weights: Floats) -> Floats:
        bad_rate, good_rate = (per_metre(rows, "state", weights, kind) for kind in (~good, good))
        return bad_rate / good_rate

    with np.errstate(divide="ignore", invalid="ignore"):
        return resampled(rows, figure)


def per_metre(rows: Sequence[Row], name: str, weights: Floats, kind: Any) -> Floats:
    """Return how many robots lose themselves in a metre of some kind of floor, shape (D,)."""
    metres, onsets = (
        np.array([np.sum(np.array(row[f"{name}_{quantity}"])[kind]) for row in rows])
        for quantity in ("metres", "onsets")
    )
    return np.asarray((weights @ onsets) / (weights @ metres))


def hazards(rows: Sequence[Row], name: str, kinds: Sequence[str]) -> str:
    """Return a table of the robots that lose themselves in 100 m of each kind of floor."""
    lines = []
    for k, kind in enumerate(kinds):
        metres = sum(row[f"{name}_metres"][k] for row in rows)
        onsets = sum(row[f"{name}_onsets"][k] for row in rows)
        rate = "not driven"
        if metres and not onsets:
            rate = f"0.00 (below {100.0 * NO_EVENT / metres:.2f})"
        elif metres:
            with np.errstate(divide="ignore", invalid="ignore"):
                figure = resampled(rows, lambda w, k=k: 100.0 * per_metre(rows, name, w, k))
            rate = f"{figure.value:.2f} ({figure.low:.2f} to {figure.high:.2f})"
        lines.append((kind, f"{metres / 1000.0:.1f}", onsets, rate))
    head = (
        "floor" if name == "state" else "in view",
        "driven, km",
        "lost there",
        "per 100 m (95 %)",
    )
    return table(head, lines)


def stretches(rows: Sequence[Row]) -> str:
    """Return a table of lost robots by the longest stretch of a route that is not navigable."""
    lines = []
    for low, high in itertools.pairwise((-1.0, *STRETCHES, np.inf)):
        part = [row for row in rows if low < row["stretch"] <= high]
        text = (
            "none"
            if high == 0.0
            else f"{low:g} to {high:g} m"
            if high < np.inf
            else f"over {low:g} m"
        )
        lines.append((text, len(part), percent(interval_of(part)) if part else ""))
    return table(("longest stretch", "routes and layouts", "lost"), lines)


def layouts(rows: Sequence[Row]) -> str:
    """Return a table of lost robots by building and layout."""
    lines = []
    for name in (*dict.fromkeys(row["building"] for row in rows), "all"):
        part = [row for row in rows if name in (row["building"], "all")]
        by_arm = {arm: [row for row in part if row["layout"] == arm] for arm in LAYOUTS}
        lost = [np.mean(lost_of(by_arm[arm])[0]) for arm in LAYOUTS]
        gains = (percent(difference(part, arm)) for arm in LAYOUTS[:2])
        lines.append((name, len(by_arm["none"]), *(f"{value:.0%}" for value in lost), *gains))
    head = ("building", "routes", *(f"lost, {arm}" for arm in LAYOUTS),
            "planned less random, points", "for two less random")  # fmt: skip
    return table(head, lines)


def arms(rows: Sequence[Row]) -> str:
    """Return a table of all robots by layout."""
    lines = []
    for arm in LAYOUTS:
        part = [row for row in rows if row["layout"] == arm]
        lost, _ = lost_of(part)
        sure = sum(sum(row["sure"]) for row in part) / max(lost.sum(), 1)
        error = np.median([error for row in part for error in row["rmse"]] or [np.nan])
        floor = ["", ""]
        if arm != "none":
            metres = sum(row["length"] for row in part)
            floor = [f"{sum(row[k] for row in part) / metres:.0%}" for k in ("navigable", "unseen")]
        lines.append(
            (arm, len(lost), *floor, percent(interval_of(part)), f"{sure:.0%}", f"{error:.3f}")
        )
    head = ("layout", "robots", "route navigable", "none in view", "lost", "sure", "error, m")
    return table(head, lines)
