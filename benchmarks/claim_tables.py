"""Tables of `bench_claim.py`: lost rates and errors of pairs of routes, with intervals."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from harness import table
from numpy.typing import NDArray

from ambinav.drive.bootstrap import paired_share
from ambinav.studies.compare.criterion import CRITERION

LIMITS = (0.0, 4.0, 8.0, np.inf)
"""Ends of the ranges of a longest stretch, metres; before them is none at all."""
SHORTEST_NONE = 0.05
"""A stretch below this is none, metres: half a cell."""
DRAWS = 2000
STRETCHES = {
    "longest_open": "longest open stretch",
    "longest_corridor": "longest corridor stretch",
    "longest_bad": "longest stretch of either",
}

SAME = ("environment", "scanner", "pair", "odometry")
"""Columns that identify a pair."""

Pair = dict[str, Any]
Floats = NDArray[np.float64]

ROUTE_HEADER = (
    "pairs", "length", "corridor, m", "longest", "open, m", "longest", "exposure",
)  # fmt: skip
DRIVE_HEADER = (
    "pairs", "lost, shortest", "lost, aware", "difference, points", "95 % error, shortest",
    "aware", "ratio", "collided, shortest / aware", "claim",
)  # fmt: skip


def of(pairs: Sequence[Pair], route: str, name: str) -> Floats:
    """Return a figure of all runs, shape (pairs, runs)."""
    return np.array([pair[route][name] for pair in pairs], dtype=np.float64)


def mean_of(pairs: Sequence[Pair], route: str, name: str) -> float:
    """Return the mean of a figure over pairs and runs."""
    return float(of(pairs, route, name).mean())


def resampled(pairs: Sequence[Pair], name: str, kind: str) -> tuple[float, ...]:
    """Return the difference or ratio of a figure, aware to shortest, with its interval of 95 %.

    Of a ratio pairs are drawn, and within each its paired seeds.
    """
    ours, theirs = of(pairs, "aware", name), of(pairs, "shortest", name)
    if kind == "difference":
        pair = np.repeat(np.arange(len(ours)), ours.shape[1])
        difference = paired_share(ours.ravel(), theirs.ravel(), group=pair)
        return difference.value, difference.low, difference.high
    rng = np.random.default_rng(5)
    count, runs = ours.shape
    rows = rng.integers(count, size=(DRAWS, count, 1))
    columns = rng.integers(runs, size=(DRAWS, count, runs))
    a = np.append(ours[rows, columns].mean(axis=(1, 2)), ours.mean())
    b = np.append(theirs[rows, columns].mean(axis=(1, 2)), theirs.mean())
    # 0 / 0 counts as no change.
    values = np.where(b > 0.0, a / np.where(b > 0.0, b, 1.0), np.where(a > 0.0, np.inf, 1.0))
    low, high = np.quantile(values[:-1], (0.025, 0.975))
    return float(values[-1]), float(low), float(high)


def gains_apart(first: Sequence[Pair], second: Sequence[Pair]) -> tuple[float, ...]:
    """Return the difference of two localizers' gains in lost robots, with its interval of 95 %.

    The same pairs and seeds of both are drawn together.
    """

    def change(pairs: Sequence[Pair]) -> Floats:
        ordered = sorted(pairs, key=lambda pair: [str(pair[name]) for name in SAME])
        return of(ordered, "aware", "lost") - of(ordered, "shortest", "lost")

    difference = change(first) - change(second)
    rng = np.random.default_rng(5)
    count, runs = difference.shape
    rows = rng.integers(count, size=(DRAWS, count, 1))
    columns = rng.integers(runs, size=(DRAWS, count, runs))
    low, high = np.quantile(difference[rows, columns].mean(axis=(1, 2)), (0.025, 0.975))
    return float(difference.mean()), float(low), float(high)


def span(values: tuple[float, ...], digits: int = 2, sign: str = "") -> str:
    """Format a value and its interval."""
    value, low, high = (format(number, f"{sign}.{digits}f") for number in values)
    return f"{value} ({low} to {high})"


def route_line(words: Sequence[str], pairs: Sequence[Pair]) -> list[object]:
    """Return the routes' figures, shortest to aware, means over the pairs."""
    if not pairs:
        return [*words, 0, *[""] * (len(ROUTE_HEADER) - 1)]

    def change(name: str) -> str:
        return " to ".join(f"{mean_of(pairs, route, name):.1f}" for route in ("shortest", "aware"))

    longer = mean_of(pairs, "aware", "length") / mean_of(pairs, "shortest", "length") - 1.0
    figures = ("corridor", "longest_corridor", "open", "longest_open", "exposure")
    return [*words, len(pairs), f"{100 * longer:+.1f} %", *[change(name) for name in figures]]


def drive_line(words: Sequence[str], pairs: Sequence[Pair]) -> list[object]:
    """Return the drives' results on the routes of some pairs."""
    if not pairs:
        return [*words, 0, *[""] * (len(DRIVE_HEADER) - 1)]
    fewer = tuple(100 * value for value in resampled(pairs, "lost", "difference"))
    walls = [f"{100 * mean_of(pairs, route, 'collided'):.0f}" for route in ("shortest", "aware")]
    return [
        *words,
        len(pairs),
        f"{100 * mean_of(pairs, 'shortest', 'lost'):.1f} %",
        f"{100 * mean_of(pairs, 'aware', 'lost'):.1f} %",
        span(fewer, 1, "+"),
        f"{mean_of(pairs, 'shortest', 'position_p95'):.2f} m",
        f"{mean_of(pairs, 'aware', 'position_p95'):.2f} m",
        span(resampled(pairs, "position_p95", "ratio")),
        f"{' / '.join(walls)} %",
        outcome(pairs),
    ]


def outcome(pairs: Sequence[Pair]) -> str:
    """Return the outcome of the claim."""
    lost = [mean_of(pairs, route, "lost") for route in ("aware", "shortest")]
    error = [mean_of(pairs, route, "position_p95") for route in ("aware", "shortest")]
    walls = resampled(pairs, "collided", "difference")
    if lost[1] == 0.0 and error[1] < CRITERION.easy:
        return "easy: nothing to gain"
    parts = []
    if lost[0] > CRITERION.lost * lost[1]:
        parts.append("lost")
    if error[0] > CRITERION.error * error[1]:
        parts.append("error")
    if walls[1] > 0.0:
        parts.append("collisions")
    return "met" if not parts else f"not met: {', '.join(parts)}"


def ranges() -> list[tuple[float, float, str]]:
    """Return the ranges of a longest stretch and their names."""
    bounds = [(-np.inf, SHORTEST_NONE, "none")]
    for low, high in itertools.pairwise(LIMITS):
        name = f"{low:g} m and more" if high == np.inf else f"{low:g} to {high:g} m"
        bounds.append((max(low, SHORTEST_NONE), high, name.replace("0 to", "up to")))
    return bounds


def within(pairs: Sequence[Pair], name: str, low: float, high: float) -> list[Pair]:
    """Return the pairs whose shortest route has its longest stretch in a range."""
    return [pair for pair in pairs if low <= pair["shortest"][name] < high]


def crossed(pairs: Sequence[Pair]) -> str:
    """Return lost robots on the shortest route, by its longest open and corridor stretches."""
    rows = []
    for low, high, name in ranges():
        inside = within(pairs, "longest_open", low, high)
        cells = [within(inside, "longest_corridor", first, last) for first, last, _ in ranges()]
        rows.append([name, *[_rate(cell) for cell in cells], _rate(inside)])
    names = [f"corridor: {name}" for *_, name in ranges()]
    return table(("open", *names, "all"), rows)


def _rate(pairs: Sequence[Pair]) -> str:
    return f"{100 * mean_of(pairs, 'shortest', 'lost'):.1f} % ({len(pairs)})" if pairs else ""
