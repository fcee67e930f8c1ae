"""Tables of `study_beams.py`: losses by number of beams, greedy against exact, drives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from harness import table
from localizers import WHAT
from numpy.typing import NDArray

from ambinav.maps.zones import ZONES

QUARTER, LIMIT, PLACES, RUNS = 90, 5.0, 800, 30
WITHIN = 0.1
"""Share by which the localizer's error may differ."""
DRAWS = 4000
ALL_BEAMS = "product, all beams"
DRIVE_LOCALIZERS = ("kalman", "product", ALL_BEAMS)
AS_MAPPED, WARPED = "as mapped", "off the map by map_std"
KEY = ("map", "pair", "walls", "odometry", "beams", "localizer")
"""Columns that identify a drive."""
KINDS = ("exact", "forward", "backward", "even")
Row = dict[str, Any]


def maps_part(case: Row, scanner: str) -> str:
    """Return the table of losses on the held-out maps."""
    subsets = [name for name in next(iter(case["held_out"].values())) if name != "full"]
    rows = [
        (
            name,
            " / ".join(f"{share:.0f}" for share in row["full"]),
            *(f"{row[subset][0]:.2f} / {row[subset][1]:.2f}" for subset in subsets),
        )
        for name, row in case["held_out"].items()
    ]
    high = {subset: max(row[subset][0] for row in case["held_out"].values()) for subset in subsets}
    verdict = ", ".join(
        f"{subset} {'holds' if value <= LIMIT else 'DOES NOT HOLD'} ({value:.2f})"
        for subset, value in high.items()
    )
    curves = [
        (
            size,
            *(f"{row[place]:.1f}" for row in (even, greedy) for place in (1, 4)),
            f"{np.median(drawn):.1f} ({min(drawn):.1f} to {max(drawn):.1f})",
        )
        for size, even, greedy, drawn in zip(
            case["sizes"],
            *(case["curves"][subset] for subset in ("even", "greedy")),
            case["random"],
            strict=True,
        )
    ]
    header = ("held-out map", f"{' / '.join(ZONES)}, %", *subsets)
    beams = ("beams", "even: chosen on", "held out", "greedy: chosen on", "held out", "random")
    fewest = case["fewest"]
    return f"""## {scanner}

The fewest beams within {LIMIT:g} points on every map that was chosen on: {len(case["chosen"])}
({case["method"]}). Even spacing needs {fewest["even"]}, greedy search
{fewest["greedy"] or "more than were followed"}. It took {case["seconds"]:.0f} s, greedy search
up to {QUARTER} beams {case["quarter_seconds"]:.0f} s, on a machine with other work.

Whole maps of the other half, points off those of all 360 beams: the largest change of a zone's
share / 100 times the mean difference of the level. At most {LIMIT:g} points of any zone: {verdict}.

{table(header, rows, words=2)}

Points lost on the worst map, by number of beams ({PLACES} places of each map that nothing was
chosen on); random: median, least and most of those drawn, held out.

{table(beams, curves)}"""


def small_part(rows: Sequence[Row], places: int) -> str:
    """Return the comparison of greedy search with the best of all subsets."""
    body = [
        (row["map"], row["beams"], *(f"{row[k]:.2f} ({row[f'{k} checked']:.2f})" for k in KINDS))
        for row in rows
    ]
    gaps = {kind: [row[kind] / row["exact"] - 1.0 for row in rows] for kind in KINDS[1:]}
    text = ", ".join(
        f"{kind} {100 * np.median(gap):.0f} % (at most {100 * max(gap):.0f} %)"
        for kind, gap in gaps.items()
    )
    exact = sum(gap < 1e-4 for gap in gaps["forward"])
    checked = {kind: np.mean([row[f"{kind} checked"] for row in rows]) for kind in KINDS}
    checked_text = ", ".join(f"{kind} {value:.2f}" for kind, value in checked.items())
    return f"""## Greedy search against the exact optimum

A ring of 16 sonars, {places} places of a map: what the search makes small (100 times the mean
difference of the level) with the best of all subsets of a size, with greedy search that adds from
nothing (`forward`) and that removes from all (`backward`), and with even spacing; in brackets on
{places} other places. Above the optimum, median over maps and sizes: {text}; forward search is
the optimum itself in {exact} of {len(rows)} cases. On the other places, mean: {checked_text}.

{table(("map", "beams", *KINDS), body)}"""


def drives_part(rows: Sequence[Row], subsets: Sequence[str], scanner: str) -> str:
    """Return the errors in paired drives."""
    rows_by_key = {tuple(row[name] for name in KEY): row for row in rows}
    maps = list(dict.fromkeys(row["map"] for row in rows))
    driven = {(row["walls"], row["odometry"], row["localizer"]) for row in rows}
    conditions = sorted({case[:2] for case in driven})
    meanings = {**WHAT, ALL_BEAMS: "the same with every beam of a scan (max_beams: all of them)"}
    meanings["product"] += "; of 360 beams it takes 60, of 90 and fewer all"
    names = "\n".join(f"- `{kind}`: {meanings[kind]}" for kind in DRIVE_LOCALIZERS)
    parts = [
        f"""## Drives on held-out maps, {scanner}

{RUNS} seeds a route. Mean over runs of the root mean square error of the position; its ratio with
its interval of 95 %, by resampling routes and, within a route, its paired seeds. "Neither lost":
of the runs in which the robot was lost with neither scanner.

{names}"""
    ]
    header = (
        "localizer", "beams", "map", "routes", "RMSE with all, cm", "with fewer", "ratio",
        "ratio, neither lost", "lost with all / fewer, %",
    )  # fmt: skip
    table_rows = [
        (walls, f"{18 * scale:g}", kind, beams, *cells[3:])
        for walls, scale in conditions
        for kind in DRIVE_LOCALIZERS
        if (walls, scale, kind) in driven
        for beams in subsets
        for cells in [_compared(rows_by_key, (walls, scale), beams, kind, "")]
    ]
    heads = ("walls", "odometry, degrees a metre", "localizer", "beams", *header[6:])
    parts.append(f"### All routes\n\n{table(heads, table_rows, words=4)}")
    for walls, scale in conditions:
        body = [
            (
                kind,
                beams,
                where or "all",
                *_compared(rows_by_key, (walls, scale), beams, kind, where),
            )
            for kind in DRIVE_LOCALIZERS
            if (walls, scale, kind) in driven
            for beams in subsets
            for where in (*maps, "")
        ]
        odometry = f"odometry of {18 * scale:g} degrees and {24 * scale:g} cm in a metre"
        parts.append(f"### Walls {walls}, {odometry}\n\n{table(header, body, words=3)}")
    return "\n\n".join(parts)


def _compared(
    rows_by_key: dict[tuple[Any, ...], Row],
    case: tuple[str, float],
    beams: str,
    kind: str,
    where: str,
) -> tuple[object, ...]:
    """Return the cells of a row that compares drives with fewer beams with those with all."""
    pairs = [
        (row, rows_by_key[(name, pair, *case, beams, kind)])
        for (name, pair, *row_case), row in rows_by_key.items()
        if row_case == [*case, "all", kind]
        and where in (name, "")
        and (name, pair, *case, beams, kind) in rows_by_key
    ]
    full, fewer = (np.array([pair[k]["rmse"] for pair in pairs]) for k in (0, 1))
    lost = [np.array([pair[k]["lost"] for pair in pairs], dtype=bool) for k in (0, 1)]
    return (
        len(pairs), f"{100 * full.mean():.2f}", f"{100 * fewer.mean():.2f}",
        _ratio(full, fewer, np.ones_like(lost[0])), _ratio(full, fewer, ~(lost[0] | lost[1])),
        " / ".join(f"{100 * values.mean():.1f}" for values in lost),
    )  # fmt: skip


def _ratio(
    full: NDArray[np.float64], fewer: NDArray[np.float64], counted: NDArray[np.bool_]
) -> str:
    """Return the ratio of the means over the counted runs, with its interval.

    Routes, and then paired seeds, are drawn with replacement. Arrays of shape (routes, runs).
    """
    rng = np.random.default_rng(5)
    routes, runs = full.shape
    rows = rng.integers(routes, size=(DRAWS, routes, 1))
    columns = rng.integers(runs, size=(DRAWS, routes, runs))
    sums = [(values * counted)[rows, columns].sum(axis=(1, 2)) for values in (fewer, full)]
    drawn = sums[1] > 0.0  # some draws may hold no run that counts
    low, high = np.percentile(sums[0][drawn] / sums[1][drawn], (2.5, 97.5))
    value = (fewer * counted).sum() / (full * counted).sum()
    if low >= 1.0 - WITHIN and high <= 1.0 + WITHIN:
        verdict = "within 10 %"
    elif high <= 1.0 + WITHIN:
        verdict = "within 10 % or better"
    else:
        verdict = "more" if low > 1.0 + WITHIN else "not shown"
    return f"{value:.3f} ({low:.3f} to {high:.3f}), {verdict}"


def times_part(rows: Sequence[Sequence[Any]]) -> str:
    """Return the time of an update."""
    body = [
        (beams, localizer, f"{full:.3f}", f"{few:.3f}", f"{ratio:.2f} ({low:.2f} to {high:.2f})")
        for beams, localizer, full, few, ratio, low, high in rows
    ]
    return f"""## Time of an update

Milliseconds of processor time of one robot, all 360 beams and fewer in turns in one run: median,
and the least and greatest ratio of a round. Neither localizer leaves beams out by itself here.

{table(("beams", "localizer", "all", "fewer", "ratio"), body, words=2)}"""
