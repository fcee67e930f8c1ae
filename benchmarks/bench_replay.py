"""Logs of real robots replayed through Monte Carlo localization.

The hall (mrpt_uwb_hall) has a map and ground truth of its own. Of the other logs a map is made of
every second scan at the log's corrected poses, and the scans between them are replayed on it; the
errors are against the corrected poses, which are estimates themselves. Every log goes through
odometry alone, AMCL's defaults and `SPARSE_SCANS`, started 10 cm and 3 degrees (one deviation)
about its first pose.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from harness import arguments, data_file, kept_or_made, option, report, table

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import between, compose
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.parameters import MclParameters
from ambinav.logs.carmen import read_carmen
from ambinav.logs.grid_map import map_from_log
from ambinav.logs.localize import SPARSE_SCANS, START_STD, localize
from ambinav.logs.log import Log
from ambinav.logs.registration import register
from ambinav.logs.replay import Replay

LIBRARIES = ("ambinav", "numba", "numpy", "scipy")
HALL = "mrpt_uwb_hall"
HALL_MOUNT = (0.095, 0.0, 0.0)
CORRECTED = (
    "intel", "aces", "freiburg-079", "belgioioso", "edmonton", "infinite-corridor",
)  # fmt: skip
# Freiburg's odometry has no sign; up to here its robot backs up in four single steps only.
FORWARD = {"freiburg-079": 400}
ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
LOCALIZERS = {
    "AMCL's defaults": MclParameters(),
    "... with its alphas": MclParameters(**{key: getattr(SPARSE_SCANS, key) for key in ALPHAS}),
    "... with its beams": replace(SPARSE_SCANS, **dict.fromkeys(ALPHAS, MclParameters().alpha1)),
    "SPARSE_SCANS": SPARSE_SCANS,
}
# A step back by the poses, metres, that is more than the jitter of theirs.
BACK = 0.05
HEADER = (
    "log", "localizer", "median m", "95 % m", "max m", "heading: median deg", "95 % deg",
    "scans lost %", "runs ever lost", "updates/s",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A log to replay, and its map."""

    name: str
    log: Log
    environment: Environment
    field: LikelihoodField
    seconds: float


def cases_of(name: str) -> list[Case]:
    """Read a log and make its map."""
    begin = time.perf_counter()
    if name == HALL:
        log = read_carmen(data_file(f"logs/{HALL}_gt.log.gz"), mount=HALL_MOUNT)
        environment = load_environment(data_file(f"maps/{HALL}.yaml"))
    else:
        full_log = read_carmen(data_file(f"logs/{name}-corrected.log.gz"))
        first, log = full_log.every(2)
        environment = map_from_log(first)
    field = LikelihoodField.of(environment)
    seconds = time.perf_counter() - begin
    out = [Case(name, log, environment, field, seconds)]
    if name in FORWARD:
        beginning = log.chosen(slice(0, FORWARD[name]))
        out.append(Case(f"{name}, first {beginning.scans}", beginning, environment, field, seconds))
    return out


def odometry_alone(log: Log) -> Replay:
    """Replay a log by odometry alone, from its first pose."""
    estimates = compose(log.poses[0], between(log.odometry[0], log.odometry))
    return Replay(log, estimates[None], np.zeros((1, log.scans), dtype=np.bool_), 0.0)


def figures(replay: Replay) -> tuple[str, ...]:
    """Return the errors of a replay, as cells of the table."""
    e = replay.errors()
    lost = replay.lost
    rate = replay.updated.sum() / replay.seconds if replay.seconds > 0.0 else math.nan
    return (
        *(f"{v:.3f}" for v in (e.position_median, e.position_95, e.position_max)),
        *(f"{math.degrees(v):.2f}" for v in (e.heading_median, e.heading_95)),
        f"{100.0 * lost.mean():.1f}",
        f"{int(lost.any(axis=1).sum())} of {len(lost)}",
        "" if math.isnan(rate) else f"{rate:.0f}",
    )


def sentence_of_lost(name: str, replay: Replay) -> str:
    """Say in which direction the error lies where the robot is lost; empty if it never is."""
    lost = replay.lost
    if not lost.any():
        return ""
    off = np.abs(
        between(np.broadcast_to(replay.log.poses, replay.estimates.shape), replay.estimates)
    )
    along, across = np.median(off[lost][:, :2], axis=0)
    return f"- {name}: {along:.2f} m along the robot's heading, {across:.2f} m across"


def row_of_log(case: Case) -> tuple[str, ...]:
    """Describe a log: steps, odometry, and the fit of its scans to the map."""
    log = case.log
    steps, odometry = (between(p[:-1], p[1:]) for p in (log.poses, log.odometry))
    wrong = np.hypot(*(odometry - steps)[:, :2].T)
    turn = np.degrees(np.abs(between(steps, odometry)[:, 2]))
    back = steps[:, 0] < -BACK
    return (
        case.name,
        str(log.scans),
        f"{np.median(np.hypot(*steps[:, :2].T)):.2f}",
        f"{np.median(wrong):.3f} ({np.quantile(wrong, 0.95):.2f})",
        f"{np.median(turn):.1f} ({np.quantile(turn, 0.95):.1f})",
        str(int(back.sum())),
        str(int((odometry[:, 0] < -BACK).sum())),
        str(int((back & (odometry[:, 0] > BACK)).sum())),
        str(len(case.environment.segments)),
        f"{case.seconds:.1f}",
    )


def rows_of_frames(case: Case) -> list[tuple[str, ...]]:
    """Return a log's registration to its map by its scans: by all of them, and by each half."""
    n = case.log.scans
    rows = []
    parts = {"all": (0, n), "first half": (0, n // 2), "second half": (n // 2, n)}
    for name, (first, last) in parts.items():
        part = case.log.chosen(slice(first, last))
        registration = register(part, case.environment)
        middle = part.poses[:, :2].mean(axis=0)
        x, y, _ = compose(registration.motion, (*middle, 0.0))
        rows.append(
            (
                case.name, name, f"{math.degrees(registration.motion[2]):.2f}",
                f"{100.0 * (x - middle[0]):.1f}", f"{100.0 * (y - middle[1]):.1f}",
                f"{100.0 * registration.before:.1f}", f"{100.0 * registration.after:.1f}",
            )
        )  # fmt: skip
    return rows


def rows_of_hall(case: Case, replay: Replay) -> list[tuple[str, ...]]:
    """Return the hall's errors, by the frame of its ground truth."""
    half = case.log.scans // 2
    frame = register(case.log.chosen(slice(0, half)), case.environment)
    laid = replace(replay, log=frame.applied(case.log))
    rows = []
    for name, replayed, first in (
        ("as published, all scans", replay, 0),
        ("as published, second half", replay, half),
        ("laid on the map by the scans of the first half, second half", laid, half),
        ("laid on the estimates (as evo_ape --align), all scans", replay.aligned(), 0),
    ):
        e = replayed.errors(first)
        metres = (e.position_median, e.position_95, e.position_max)
        turns = (e.heading_median, e.heading_95)
        rows.append(
            (name, *(f"{v:.3f}" for v in metres), *(f"{math.degrees(v):.2f}" for v in turns))
        )
    return rows


def replayed(name: str, runs: int, seed: int) -> dict[str, Any]:
    """Return the rows of the tables for one log, with each localizer."""
    rows: list[tuple[str, ...]] = []
    hall: list[tuple[str, ...]] = []
    frames: list[tuple[str, ...]] = []
    lost, about = [], []
    for case in cases_of(name):
        # Compile first, so that updates per second exclude it.
        few = case.log.chosen(slice(0, 3))
        for parameters in LOCALIZERS.values():
            localize(
                few, case.environment, parameters, rng=np.random.default_rng(0), runs=runs,
                field=case.field,
            )  # fmt: skip
        rows.append((case.name, "odometry alone", *figures(odometry_alone(case.log))))
        for localizer, parameters in LOCALIZERS.items():
            replay = localize(
                case.log, case.environment, parameters, rng=np.random.default_rng(seed),
                runs=runs, field=case.field,
            )  # fmt: skip
            rows.append((case.name, localizer, *figures(replay)))
            if parameters is SPARSE_SCANS:
                lost.append(sentence_of_lost(case.name, replay))
            if case.name == HALL and parameters is SPARSE_SCANS:
                hall = rows_of_hall(case, replay)
        if case.name in (HALL, "intel", "aces"):
            frames += rows_of_frames(case)
        about.append(row_of_log(case))
    print(f"replayed: {name}", file=sys.stderr, flush=True)
    return {"rows": rows, "hall": hall, "frames": frames, "lost": lost, "about": about}


def body_of(logs: list[dict[str, Any]], runs: int) -> str:
    """Compose the report."""
    rows, frames, lost, odometry = (
        [row for each in logs for row in each[part]] for part in ("rows", "frames", "lost", "about")
    )
    hall = next((each["hall"] for each in logs if each["hall"]), [])
    about = table(
        ("log", "scans", "m between scans", "odometry off, m: median (95 %)", "degrees",
         "steps back", "by odometry", "forward by odometry", "segments", "s to read and map"),
        odometry,
    )  # fmt: skip
    sections = [
        f"{runs} runs of each log on {numba.get_num_threads()} threads; the errors are over all "
        "scans and runs. A scan is lost if it and one next to it are off by more than 0.5 m or 30 "
        "degrees. `SPARSE_SCANS` (`ambinav.logs.localize`) is AMCL with the beams multiplied "
        "(likelihood_field_prob, importance_factor 0.3) and alphas of 0.01 instead of 0.2; it was "
        "chosen by trying on these logs. The two rows between change only one of the two.",
        table(HEADER, rows, words=2),
        "Medians of how far off the robot is where `SPARSE_SCANS` loses it (in a long corridor "
        "it is along it that scans tell least):",
        "\n".join(filter(None, lost)) or "- it loses none of these",
        f"## The logs\n\nOdometry is compared from one replayed scan to the next. In the "
        "`corrected` logs it is put together from the steps between the ODOM lines, which start "
        f"anew at each corrected pose. Steps back are those of more than {BACK:g} m by the poses, "
        "and by odometry; then those by the poses that odometry calls as much forward. The "
        "odometry of freiburg-079 never goes back: it gives distances without their sign, and "
        "where its robot backs up the localizer is led astray.",
        about,
    ]
    if hall:
        sections += [
            "## The hall's frames\n\nWanted: a median error of at most 10 cm. As published it is "
            "above that, because the published ground truth is not in the frame of the published "
            "map. The scans at its poses say so by themselves, without a localizer (`register`): "
            "the motion that lays them on the map is nearly the same for either half of the log, "
            "while the logs whose maps are made of their own poses need none. With what the "
            "first half says, the error in the second is:",
            table(("ground truth", *HEADER[2:7]), hall),
            "The motion by the scans, at the middle of the poses, and the median distance from "
            "the end of a beam to the nearest wall:",
            table(
                ("log", "scans", "turn deg", "x cm", "y cm", "before cm", "after cm"),
                frames,
                words=2,
            ),
        ]
    deviations = f"{START_STD[0]:g} m, {START_STD[1]:g} m, {math.degrees(START_STD[2]):.1f} degrees"
    return "\n\n".join([*sections, f"Deviations of the first estimate: {deviations}."])


def main() -> None:
    """Measure and report."""
    args = arguments(
        __doc__,
        runs=10,
        seed=1,
        logs=option((HALL, *CORRECTED), choices=(HALL, *CORRECTED), metavar="LOG"),
        folder=option(Path("out/replay"), "keeps what this code replayed"),
    )
    rows = []
    for name in args.logs:
        key = {"log": name, "runs": args.runs, "seed": args.seed}
        make = partial(replayed, name, args.runs, args.seed)
        rows.append(kept_or_made(args.folder / "logs.jsonl", key, make))
    body = body_of(rows, args.runs)
    report("Logs of real robots, replayed", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
