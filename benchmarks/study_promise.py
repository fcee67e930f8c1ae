"""Routes that `plan --max-lost 0.05` gives in buildings that nothing was fitted to, driven afresh.

Buildings are drawn (numbers 11 and up of seven suites; the classes were fitted to 1 to 6), pairs of
places the ends of the longest of eight sampled routes. Scanner and odometry change from pair to
pair. Robots have the localizer of the class `product`. On each route:

- promised: what `route_within` gives; 64 fresh drives;
- shortest, and the cheapest of some weights: 64 drives each, half of which choose the pairs of the
  second table and the other half are reported there;
- promised and shortest once more in closed loop, where the robot steers by its estimate, on the map
  and in an aged world (walls off by 3 cm, new boxes): 16 drives each.

Intervals of 95 %: of lost shares score intervals with buildings as groups (`drive.shares`), of
differences and of the mixture of two weights by the bootstrap over buildings.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from harness import commits, kept_rows, option, parser_of, report, run_script, table
from lost_case import DRAWN
from numpy.typing import NDArray
from promise_case import CLOSED, DRIVEN, MAX_LOST, RUNS

from ambinav.drive.bootstrap import grouped_weights, share
from ambinav_planners.promise import SEARCH

Floats = NDArray[np.float64]
Row = dict[str, Any]
SEED = 5
MIXTURE = "cost of equal mean length"
"""Routes of two neighbouring weights, mixed so that their mean length is that of the promised."""


def main() -> None:
    """Drive what is missing, and report."""
    parser = parser_of(
        __doc__,
        first=option(11, "first number of the buildings of each suite"),
        last=option(20, "last number"),
        folder=option(Path("out/promise"), "keeps what this code computed", type=Path),
        kept=option(False, "drive nothing"),
    )
    args = parser.parse_args()
    names = [f"{suite}-{k}" for k in range(args.first, args.last + 1) for suite in DRAWN]
    if not args.kept:
        words = ["--folder", str(args.folder)]
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda name: run_script("promise_case.py", name, *words), names))
    rows = [row for name in names for row in kept_rows(args.folder / f"{name}.jsonl")]
    report("Routes that keep a promise", ("numpy", "numba", "ompl"), body_of(rows), args.out)


def body_of(rows: list[Row]) -> str:
    """Compose the report."""
    rng = np.random.default_rng(SEED)
    solved = [row for row in rows if row["kept"]]
    risky = [row for row in solved if candidate(row, 0.0)["lost"][0] > MAX_LOST * RUNS]
    searched = [row for row in solved if row["found_by"] == SEARCH]
    broken = sum(sum(row["fresh_lost"]) > MAX_LOST * 2 * RUNS for row in solved)
    shorter = [
        1.0 - row["length"] / min(fits)
        for row in searched
        if (fits := [c["length"] for c in row["candidates"] if fit(c)])
    ]
    return "\n\n".join(
        [
            f"{len(rows)} pairs in {len({row['building'] for row in rows})} buildings "
            f"({commits(rows)}); a route is given for {len(solved)} of them, and for the others a "
            "sentence says that none keeps to it.",
            f"## All pairs with a route ({len(solved)})\n\n{comparison(solved, rng, slice(0, 2))}",
            f"## Where more than {100 * MAX_LOST:g} % get lost on the shortest ({len(risky)})"
            f"\n\n{comparison(risky, rng, slice(1, 2))}",
            f"Of these routes {broken} lost more than {100 * MAX_LOST:g} % of fresh drives; "
            f"{len(searched)} come from the search over place and belief, {len(shorter)} of them "
            "where a weight's route is forecast to keep to the share too: by "
            f"{100 * np.median(shorter) if shorter else np.nan:.0f} % (median) shorter than that. "
            f"Median of planning, forecasts and drives: "
            f"{np.median([row['seconds'] for row in rows]):.1f} s, 95 % "
            f"{np.quantile([row['seconds'] for row in rows], 0.95):.0f} s; drives of the route: "
            f"{np.median([row['drives'] for row in solved]):.0f}.",
            f"## Closed loop, {CLOSED} drives each\n\n{closed_loop(solved)}",
        ]
    )


def candidate(row: Row, weight: float) -> Row:
    """Return the route of a weight."""
    return next(c for c in row["candidates"] if c["weight"] == weight)


def fit(route: Row) -> bool:
    """Return whether the forecast of a weight's route keeps to the share."""
    return bool(route["forecast"] <= MAX_LOST)


def comparison(rows: list[Row], rng: np.random.Generator, part: slice) -> str:
    """Return the table of lengths and lost shares, by a part of the two halves of the drives."""
    if not rows:
        return "None."
    shortest = np.array([candidate(row, 0.0)["length"] for row in rows])
    drives = RUNS * len(range(2)[part])
    routes: dict[str, tuple[Floats, Floats]] = {
        "promised": column(
            rows, lambda row: (row["length"], np.mean(row["fresh_lost"][part]) / RUNS)
        )
    }
    for weight in DRIVEN:
        name = f"weight {weight:g}" if weight else "shortest"
        routes[name] = column(
            rows,
            lambda row, w=weight: (
                candidate(row, w)["length"],
                np.mean(candidate(row, w)["lost"][part]) / RUNS,
            ),
        )
    length, lost = equal_length(routes, routes["promised"][0].mean())
    routes[MIXTURE] = length, lost
    lines = [
        [
            name, f"{lengths.mean():.2f}", f"{100 * (lengths / shortest - 1).mean():.1f}",
            over_buildings(rows, 100.0 * shares, rng) if name == MIXTURE
            else lost_share(rows, shares, drives),
            "" if name == MIXTURE else int((shares > MAX_LOST).sum()),
            over_buildings(rows, 100.0 * (shares - routes["promised"][1]), rng),
        ]
        for name, (lengths, shares) in routes.items()
    ]  # fmt: skip
    header = ["route", "m", "longer, %", "lost, %", f"routes > {MAX_LOST:g}", "more than promised"]
    return table(header, lines)


def column(rows: list[Row], of: Callable[[Row], tuple[float, float]]) -> tuple[Floats, Floats]:
    """Return lengths and lost shares of one route of each pair."""
    pairs = np.array([of(row) for row in rows])
    return pairs[:, 0], pairs[:, 1]


def equal_length(routes: dict[str, tuple[Floats, Floats]], metres: float) -> tuple[Floats, Floats]:
    """Return the mixture of routes of two neighbouring weights that has this mean length."""
    weighted = [routes[f"weight {w:g}" if w else "shortest"] for w in DRIVEN]
    means = [length.mean() for length, _ in weighted]
    k = int(np.clip(np.searchsorted(means, metres) - 1, 0, len(means) - 2))
    span = means[k + 1] - means[k]
    part = float(np.clip((metres - means[k]) / span, 0.0, 1.0)) if span > 0.0 else 0.0
    (a, lost_a), (b, lost_b) = weighted[k], weighted[k + 1]
    return (1.0 - part) * a + part * b, (1.0 - part) * lost_a + part * lost_b


def closed_loop(rows: list[Row]) -> str:
    """Return the table of lost shares in closed loop."""
    lines = []
    for world in ("map", "aged"):
        driven = [
            row for row in rows if None not in (row[f"promised_{world}"], row[f"shortest_{world}"])
        ]
        shares = [
            np.array([row[f"{which}_{world}"] / CLOSED for row in driven])
            for which in ("promised", "shortest")
        ]
        cells = [lost_share(driven, route_shares, CLOSED) for route_shares in shares]
        lines.append([world, len(driven), *cells])
    return table(["world", "pairs", "promised: lost, %", "shortest: lost, %"], lines)


def lost_share(rows: list[Row], shares: Floats, drives: int) -> str:
    """Return the lost share of all drives in percent, with its interval.

    Args:
        rows: The pairs.
        shares: Lost share of each pair's drives, shape (pairs,).
        drives: Number of drives of each pair.
    """
    counts = np.rint(shares * drives).astype(np.int64)
    lost = np.arange(drives) < counts[:, None]
    names = np.repeat([row["building"] for row in rows], drives)
    value = share(lost.ravel(), group=names).scaled(100.0)
    return f"{value.value:.1f} [{value.low:.1f}, {value.high:.1f}]"


def over_buildings(rows: list[Row], values: Floats, rng: np.random.Generator) -> str:
    """Return a mean with its interval over buildings."""
    names = np.array([row["building"] for row in rows])
    drawn = [
        np.average(values, weights=w)
        for w in np.concatenate(list(grouped_weights(names, rng, 1000)))
        if w.sum() > 0.0
    ]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{values.mean():.1f} [{low:.1f}, {high:.1f}]"


if __name__ == "__main__":
    main()
