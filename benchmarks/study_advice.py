"""The audit's first advice against the best of all possible advice, computed in full.

For each map and preset the audit decides by samples of places. Here every scanner that it might
have named, every heading and other routes are computed at all places of the judged floor, and the
bad floor that the first advice removes is held against what the best of them removes. Posts are
left out. Large maps are cut to a piece; maps are coarser than an audit's, to get through all pairs.

    python benchmarks/study_advice.py --rows out/advice.jsonl           goes on where it was ended
    python benchmarks/study_advice.py --rows out/advice.jsonl --report --out FILE.md
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from harness import arguments, kept_rows, option, recorded_maps, report, table

import ambinav as an
from ambinav.demo import DEMO_BUILDING
from ambinav.drive.bootstrap import share
from ambinav.runtime.errors import InputError
from ambinav.sensing.presets import preset_names
from ambinav.studies.audit.advise import advise
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.counterfactual.alternatives import scanner_changes
from ambinav.studies.audit.counterfactual.sample import BAD, FloorSample

TITLE = "First advice of the audit against all counterfactuals"
SPACING, RADIUS = 0.25, 0.5
SIDE = 24.0
"""Metres of the piece that is cut out of a larger map."""


def buildings() -> Iterator[tuple[str, an.Environment]]:
    """Return all recorded maps, cut where they are large, and the bundled building."""
    yield "demo", an.load_environment(DEMO_BUILDING)
    for file in recorded_maps():
        env = an.load_environment(file)
        middle = env.free.representative_point()
        box = shapely.box(
            middle.x - SIDE / 2, middle.y - SIDE / 2, middle.x + SIDE / 2, middle.y + SIDE / 2
        )
        if not shapely.covers(box, shapely.box(*env.bounds)):
            pieces = list(shapely.get_parts(env.free.intersection(box)))
            env = an.environment_from_shapes(pieces, openings=[box.exterior], name=file.stem)
        yield file.stem, env


def case(env: an.Environment, scanner: an.RangeScanner) -> dict[str, Any] | None:
    """Study one building and scanner; None if the robot has no floor there."""
    try:
        amap = an.build_map(env, scanner, spacing=SPACING, radius=RADIUS, store=False)
        audit_result = audit(amap, env, scanner, places=0)
    except InputError:
        return None
    start = time.process_time()
    verdict = advise(audit_result, posts=0).verdict
    seconds = time.process_time() - start
    assert verdict is not None
    row: dict[str, Any] = {
        "area": audit_result.area, "bad": verdict.before, "decision": verdict.decision,
        "seconds": seconds,
    }  # fmt: skip
    if verdict.decision in ("nothing", "unknown"):
        return row
    floor = FloorSample.of(audit_result.amap, env, scanner)
    after = {}
    for change in scanner_changes(scanner, env):
        zone = floor.zones([change.scanner], floor.floor)[0]
        after[change.title] = float(np.isin(zone, BAD).sum()) * floor.cell_area
    exact = {trial.title: trial.after.value for trial in verdict.tried if trial.after.count == 0}
    sampled = [trial for trial in verdict.tried if trial.title in after and trial.after.count]
    row["held"] = [
        trial.after.low - 1e-6 <= after[trial.title] <= trial.after.high + 1e-6 for trial in sampled
    ]
    every = exact | after
    row["tried"] = len(every)
    row["best"], row["best_after"] = min(every.items(), key=lambda pair: pair[1])
    if verdict.advice:
        row["first"] = verdict.advice[0].title
        row["first_after"] = every[verdict.advice[0].title]
    return row


def run(path: Path, seconds: float) -> None:
    """Add rows to a file, in random order, until the time is over."""
    warnings.simplefilter("ignore")
    finished = {(row["map"], row["scanner"]) for row in kept_rows(path)}
    environments = dict(buildings())
    pairs = [(name, preset) for name in environments for preset in preset_names()]
    end = time.monotonic() + seconds
    for at in np.random.default_rng(0).permutation(len(pairs)):
        name, preset = pairs[at]
        if (name, preset) in finished:
            continue
        if time.monotonic() > end:
            break
        scanner = an.RangeScanner.from_preset(preset)
        row = None if scanner.upright.any() else case(environments[name], scanner)
        with path.open("a", encoding="utf-8") as out:
            out.write(json.dumps({"map": name, "scanner": preset, **(row or {})}) + "\n")


def text(rows: list[dict[str, Any]]) -> str:
    """Return the tables of the report."""
    decided = [row for row in rows if "decision" in row]
    advised = [row for row in decided if "first" in row]
    none = [row for row in decided if row["decision"] == "none"]
    ratio = np.array(
        [(row["bad"] - row["first_after"]) / (row["bad"] - row["best_after"]) for row in advised]
    )
    missed = [row for row in none if row["bad"] - row["best_after"] >= 0.1 * row["bad"]]
    useless = [row["bad"] - row["first_after"] < 0.1 * row["bad"] for row in advised]
    is_held_list = [is_held for row in decided for is_held in row.get("held", ())]
    seconds = np.median([row["seconds"] for row in advised])
    figures = [
        ("buildings", f"{len({row['map'] for row in decided})}"),
        ("presets", f"{len({row['scanner'] for row in decided})}"),
        ("pairs of both", f"{len(decided)}"),
        ("nothing to do", f"{sum(row['decision'] == 'nothing' for row in decided)}"),
        ("nothing explored", f"{sum(row['decision'] == 'unknown' for row in decided)}"),
        ("nothing that pays", f"{len(none)}"),
        ("of these something does, in full", f"{len(missed)}"),
        ("advice", f"{len(advised)}"),
        (
            "share of the best one's gain that the first advice has, median",
            f"{np.median(ratio):.2f}",
        ),
        ("the same, 5th percentile", f"{np.quantile(ratio, 0.05):.2f}"),
        ("the same, least", f"{ratio.min():.2f}"),
        ("first advice has 0.8 of it or more", f"{share(ratio >= 0.8)}"),
        ("first advice removes less than a tenth, in full", f"{share(useless)}"),
        ("95 % intervals that hold the figure in full", f"{share(is_held_list)}"),
        ("processor time where there is advice, s, median", f"{seconds:.2f}"),
    ]
    worst = sorted(zip(ratio.tolist(), advised, strict=True), key=lambda pair: pair[0])[:10]
    listed = [
        (row["map"], row["scanner"], f"{row['bad']:.0f}", row["first"], f"{row['first_after']:.0f}",
         row["best"], f"{row['best_after']:.0f}", f"{value:.2f}")
        for value, row in worst
    ]  # fmt: skip
    head = ("map", "scanner", "bad m²", "first advice", "then m²", "best", "then m²", "share")
    return "\n\n".join(
        (table(("figure", "value"), figures), "The ten worst:", table(head, listed, 2))
    )


def main() -> None:
    """Run or report."""
    args = arguments(
        __doc__,
        rows=option(None, "JSON lines, one a pair", type=Path, required=True),
        seconds=option(1000000000.0, "stop after so many"),
        report=option(False, "write the report of what is there"),
    )
    if not args.report:
        args.rows.parent.mkdir(parents=True, exist_ok=True)
        run(args.rows, args.seconds)
    report(TITLE, ("numpy", "numba", "shapely"), text(kept_rows(args.rows)), args.out)


if __name__ == "__main__":
    main()
