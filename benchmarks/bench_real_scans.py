"""Ambiguity predicted from maps against ambiguity measured by the scans of real robots.

The path of a log is parted into stretches that go to two parts (or more) in turn. For each part a
map is made of the other stretches at the log's corrected poses, and judged by the part's scans.
What is measured, and how, is in docs/real-scans.md. No parameter of the model is fitted; how a
scan's surfaces are read was chosen on the logs of `CHOSEN_ON`.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
import warnings
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from harness import arguments, data_file, kept_or_made, option, report, table
from real_scans.plot_real_log import plot_real_log
from real_scans.rank_agreement import RankAgreement, floor_squares, rank_agreement, spearman
from real_scans.real_log import PAIR_RADIUS, STRETCH, RealLog, study_log

from ambinav.logs.carmen import read_carmen
from ambinav.logs.log import Log
from ambinav.plotting.canvas import save_figure
from ambinav.runtime.errors import InputWarning

LIBRARIES = ("ambinav", "numba", "numpy", "scipy")
LOGS = ("intel", "aces", "freiburg-079", "infinite-corridor", "belgioioso", "edmonton")
CHOSEN_ON = ("intel", "aces")
RANGES = (None, 4.0)
TARGET = 0.6
# Logs with more scans are thinned.
MOST_SCANS = 2000
# Draws of the bootstrap over pairs, which are many.
PAIR_DRAWS = 200
# Side of the squares of floor that the bootstrap draws, metres.
SQUARE = 5.0
SEED = 0
# Where the scan shows a weak direction: major less minor is at least this.
WEAK = 0.3
PAIR_COLUMNS = (
    "log", "range", "pairs", "poses", "ambiguity of a pose", "of explained beams",
    "by their number alone", "at equal number", "level of a pose", "pairs",
    "pairs, by distance alone", "pairs at equal distance", "poses at equal distance",
)  # fmt: skip
POSE_COLUMNS = (
    "log", "range", "poses", "level", "major", "minor", "median level map / scan",
    "weak direction off by, degrees (poses)", "map's level, pairs at equal distance",
)  # fmt: skip
LOG_COLUMNS = ("log", "scans", "path m", "median step m", "no return", "segments", "scans not free")


def read(name: str) -> Log:
    """Read a log."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        log = read_carmen(data_file(f"logs/{name}-corrected.log.gz"))
    return log.thinned(math.ceil(log.scans / MOST_SCANS))


def label(name: str) -> str:
    """Return the log's name, marked where choices were made on it."""
    return f"{name} *" if name in CHOSEN_ON else name


def far(max_range: float | None) -> str:
    """Return the range in words."""
    return "full" if max_range is None else f"{max_range:g} m"


def same_pairs(study: RealLog) -> dict[str, RankAgreement]:
    """Compare predicted with measured ambiguity over the same pairs."""
    rng = np.random.default_rng(SEED)
    pairs = study.pairs
    of_pair = floor_squares(*study.place(pairs.first), SQUARE)
    of_scan = floor_squares(*study.place(study.scans), SQUARE)
    scans, measured_rank = pairs.mean_by_scan(pairs.measured_rank)
    _, predicted_rank = pairs.mean_by_scan(pairs.predicted_rank)
    of_rank = floor_squares(*study.place(scans), SQUARE)
    return {
        "pairs": rank_agreement(pairs.predicted, pairs.measured, of_pair, rng, draws=PAIR_DRAWS),
        "pairs, equal": rank_agreement(
            pairs.predicted_rank, pairs.measured_rank, of_pair, rng, draws=PAIR_DRAWS
        ),
        "ambiguity": rank_agreement(
            study.predicted["ambiguity"], study.measured["ambiguity"], of_scan, rng
        ),
        "known": rank_agreement(
            study.predicted["ambiguity"], study.known["ambiguity"], of_scan, rng
        ),
        "level": rank_agreement(study.predicted["level"], study.measured["level"], of_scan, rng),
        "equal": rank_agreement(predicted_rank, measured_rank, of_rank, rng),
    }


def own_map(study: RealLog) -> dict[str, RankAgreement]:
    """Compare the map's own figures at the pose with the scan's own, and with the pairs."""
    rng = np.random.default_rng(SEED)
    square = floor_squares(*study.place(study.alone), SQUARE)
    agreements = {
        name: rank_agreement(study.map_says[name], study.scan_says[name], square, rng)
        for name in ("level", "major", "minor", "ambiguity")
    }
    scans, rank = study.pairs.mean_by_scan(study.pairs.measured_rank)
    at = {int(k): i for i, k in enumerate(study.alone)}
    row = np.array([at[int(k)] for k in scans])
    agreements["pairs"] = rank_agreement(
        study.map_says["level"][row], rank, floor_squares(*study.place(scans), SQUARE), rng
    )
    return agreements


def direction_error(study: RealLog) -> tuple[float, int]:
    """Return the median angle between weak directions of map and scan, degrees, and the count."""
    predicted, seen = study.map_says, study.scan_says
    weak = (seen["major"] - seen["minor"] >= WEAK) & np.isfinite(predicted["direction"])
    if not weak.any():
        return math.nan, 0
    angle = (
        np.mod(predicted["direction"] - seen["direction"] + 0.5 * math.pi, math.pi) - 0.5 * math.pi
    )
    return math.degrees(float(np.median(np.abs(angle[weak])))), int(weak.sum())


def distance_alone(study: RealLog) -> float:
    """Return the rank correlation of the pairs' distance alone, without any map."""
    return spearman(-study.pairs.distance, study.pairs.measured)


def number_alone(study: RealLog) -> tuple[float, float]:
    """Return rank correlations for the number of explained beams, and for the map at equal number.

    Returns:
        Rank correlation of the number with the measured ambiguity, and the partial one of
        predicted with measured ambiguity at equal number.
    """
    scans, beams = study.pairs.mean_by_scan(study.pairs.beams)
    order = np.argsort(study.scans)
    assert np.array_equal(study.scans[order], scans)
    known, predicted = study.known["ambiguity"][order], study.predicted["ambiguity"][order]
    alone, of_prediction = spearman(-beams, known), spearman(-beams, predicted)
    together = spearman(predicted, known)
    scale = math.sqrt((1.0 - alone * alone) * (1.0 - of_prediction * of_prediction))
    return alone, (together - alone * of_prediction) / scale


def rows_of(name: str, max_range: float | None, args: argparse.Namespace) -> dict[str, Any]:
    """Return the rows of the tables for one log and range, as text."""
    log = read(name)
    begin = time.perf_counter()
    study = study_log(log, max_range, spacing=args.spacing, stretch=args.stretch, parts=args.parts)
    seconds = time.perf_counter() - begin
    same, from_map = same_pairs(study), own_map(study)
    angle, weak = direction_error(study)
    key = (label(name), far(max_range))
    first = (
        *key, len(study.pairs.first) // 2, len(study.scans),
        same["ambiguity"], same["known"], *(f"{v:.2f}" for v in number_alone(study)),
        same["level"], same["pairs"], f"{distance_alone(study):.2f}",
        same["pairs, equal"], same["equal"],
    )  # fmt: skip
    predicted, seen = study.map_says["level"], study.scan_says["level"]
    good = np.isfinite(predicted)
    second = (
        *key, from_map["level"].count, from_map["level"], from_map["major"], from_map["minor"],
        f"{np.median(predicted[good]):.2f} / {np.median(seen[good]):.2f}",
        f"{angle:.1f} ({weak})", from_map["pairs"],
    )  # fmt: skip
    missed = [
        f"{name}, {far(max_range)}: {title} {agreement}"
        for title, agreement in (
            ("same pairs, ambiguity", same["ambiguity"]),
            ("same pairs, ambiguity of explained beams", same["known"]),
            ("same pairs at equal distance", same["equal"]),
            ("map's level against the scan's", from_map["level"]),
        )
        if not agreement.value >= TARGET
    ]
    print(name, far(max_range), f"{seconds:.0f} s", file=sys.stderr)
    poses = log.required_poses()
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    about = (
        label(name), log.scans, f"{steps.sum():.0f}", f"{np.median(steps):.2f}",
        f"{np.isposinf(log.ranges).mean():.1%}",
        " / ".join(str(len(m.segments)) for m in study.maps),
        log.scans - len(study.alone),
    )  # fmt: skip
    if args.images is not None and max_range == RANGES[-1]:
        args.images.mkdir(parents=True, exist_ok=True)
        save_figure(plot_real_log(study), args.images / f"real-scans-{name}.png")
    return {
        "first": [str(cell) for cell in first],
        "second": [str(cell) for cell in second],
        "about": [str(cell) for cell in about],
        "missed": missed,
    }


def main() -> None:
    """Run what is missing, and report."""
    args = arguments(
        __doc__,
        logs=option(LOGS, choices=LOGS),
        spacing=option(0.2, "of the maps, metres"),
        parts=option(2, "of the path"),
        stretch=option(STRETCH, "of the path, metres"),
        full=option(False, "leave out the shorter range"),
        images=option(None, "folder for the pictures", type=Path),
        folder=option(Path("out/real-scans"), "keeps what this code computed"),
    )
    rows = []
    for name, max_range in product(args.logs, RANGES[:1] if args.full else RANGES):
        key = {
            "log": name, "range": max_range, "spacing": args.spacing, "parts": args.parts,
            "stretch": args.stretch, "images": str(args.images),
        }  # fmt: skip
        make = partial(rows_of, name, max_range, args)
        rows.append(kept_or_made(args.folder / "cases.jsonl", key, make))
    first_rows, second_rows = ([row[part] for row in rows] for part in ("first", "second"))
    log_rows = [row["about"] for row in rows if row["range"] is None]
    missed = [line for row in rows for line in row["missed"]]
    body = f"""
Stretches of {args.stretch:g} m of the path in {args.parts} parts, each judging a map of all the
others; ambiguity maps of {args.spacing:g} m. Rank correlations (Spearman) with intervals of 95 %
from {SQUARE:g} m squares of floor drawn with replacement. * how scans are read was chosen on this
log.
What each column means is in docs/real-scans.md.

## The same pairs: real scans, and the scans that the map predicts at the same poses

Pairs within {PAIR_RADIUS:g} m and 60 degrees of heading, no wall between them, neither scan in the
map that predicts.

{table(PAIR_COLUMNS, first_rows, 2)}

## The map's own figures at the pose, against those of the scan alone

{table(POSE_COLUMNS, second_rows, 2)}

## Below {TARGET:g}

{chr(10).join(f"- {line}" for line in missed) or "None of the four main comparisons."}

## The logs

{table(LOG_COLUMNS, log_rows)}
"""
    report("Real scans: predicted against measured ambiguity", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
