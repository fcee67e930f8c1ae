"""Results of methods without learning in the tasks and the plain ids, and the room that is left.

Each drives the same episodes. The room for learning is what the oracle arrives more often than the
best baseline, that under the same rules what a follower does that knows when its estimate is right;
a task with less than 10 points of it gets no id, nor does one that memory or a map of the floor
solves. The plain ids are no tasks: what room they have stands beside.
"""

from __future__ import annotations

import math
import time
from typing import Any

from harness import arguments, option, report, table
from task_baselines import BASELINES, Baseline, baseline

from ambinav.drive.bootstrap import paired_share, share
from ambinav_envs.evaluation import Episodes, evaluate_in
from ambinav_envs.scenario import source_of
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, MISSED, TIMEOUT
from ambinav_envs.tasks import HARD_TASKS, VARIANTS
from ambinav_envs.tasks import SUITES_WITH_IDS as SUITES

LIBRARIES = ("ambinav", "gymnasium", "numba", "numpy")
# Value of the criterion, points of 100.
ROOM = 10.0
# Which baselines see more than the task gives, so that their rows stand apart.
WAYPOINTS = [name for name, who in BASELINES.items() if "waypoint" in who.seeing]
NOT_GIVEN = {"no waypoint": (*WAYPOINTS, "replanner", "vfh", "vfh-aware", "vfh-paced")}
# Tasks that were tried and have no id.
TRIED: dict[str, dict[str, Any]] = {
    "closed door": {
        "buildings": VARIANTS, "suite": "procedural", "closed_door": 1.0, "detour": [1.3, 3.0],
        "shortest": 4.0, "longest": 12.0, "max_steps": 500,
    },
    "half a turn": {
        "buildings": VARIANTS, "suite": "hall", "scanner": {"beams": 60, "aperture": math.pi},
        "odometry_scale": 2.0, "shortest": 4.0, "longest": 15.0, "max_steps": 400,
    },
    "slippery floor": {
        "buildings": VARIANTS, "suite": "hall", "slip": 1.0, "slip_radius": 3.0,
        "shortest": 6.0, "longest": 20.0, "max_steps": 400,
    },
    "no waypoint": {
        "buildings": VARIANTS, "suite": "procedural", "waypoint": False, "window_cells": 24,
        "shortest": 6.0, "longest": 20.0, "max_steps": 400,
    },
}  # fmt: skip


PLAIN: dict[str, dict[str, Any]] = {
    f"{name.capitalize()}-v1": {"buildings": VARIANTS, "suite": name} for name in SUITES
}
TASKS = {spec.name.partition("/")[2]: dict(spec.arguments) for spec in HARD_TASKS}
# Tasks in which a robot may call for help besides.
HELP = {
    f"{name}, help": {**TASKS[name], "declare": ["arrived", "lost"]}
    for name in ("Kidnapped-v1", "UnknownStart-v1", "LandmarkDetour-v1")
}
EVERYTHING = TASKS | HELP | TRIED | PLAIN
ORACLES = [name for name, who in BASELINES.items() if who.kind == "oracle"]
USUAL = (
    *(name for name in BASELINES if name not in ORACLES),
    "vfh",
    "vfh-aware",
    "vfh-paced",
    *ORACLES,
)
FEW = (
    "random",
    "standing",
    "spinning",
    "circling",
    "ramming",
    "vfh",
    "vfh-aware",
    "vfh-paced",
    "oracle",
)
"""Default baselines for the tasks, and for the plain ids."""


def drive(arguments: dict[str, Any], who: Baseline, episodes: int, seed: int) -> Episodes:
    """Run episodes of one baseline in one task."""
    source, parameters = source_of({**arguments, **who.seeing})
    return evaluate_in(
        who.make(parameters), source, parameters, episodes, seed, chunk=min(episodes, 200)
    )


def row(name: str, who: Baseline, driven: Episodes, seconds: float) -> list[str]:
    """Return a line of the table."""
    count = len(driven)
    arrived = driven.ended(ARRIVED)
    often = share(arrived).scaled(100.0)
    shares = [f"{100 * driven.ended(code).mean():.0f}" for code in (MISSED, COLLIDED, TIMEOUT)]
    priced = "ambiguity_weight" in who.seeing
    error = 1.96 * driven.reward.std(ddof=1) / math.sqrt(count)
    return [
        name, who.text, f"{often.value:.0f} ({often.low:.0f} to {often.high:.0f})", *shares,
        f"{100 * driven.was_lost.mean():.0f}",
        "other prices" if priced else f"{driven.reward.mean():.1f} ± {error:.1f}",
        f"{driven.seconds.mean():.0f}", f"{seconds:.0f}",
    ]  # fmt: skip


def room(oracle: Episodes, best: Episodes) -> tuple[float, float, float]:
    """Return the oracle's lead in arrivals, in points, and its paired interval."""
    gain = paired_share(oracle.ended(ARRIVED), best.ended(ARRIVED)).scaled(100.0)
    return gain.value, gain.low, gain.high


HEADER = (
    "name", "drives", "arrived %", "missed %", "collided %", "timeout %", "ever lost %", "return",
    "seconds", "took s",
)  # fmt: skip


def section(name: str, arguments: dict[str, Any], whom: list[str], episodes: int, seed: int) -> str:
    """Return the table of one task, and the room for learning."""
    rows, driven = [], {}
    for label in whom:
        who, begin = baseline(label), time.perf_counter()
        driven[label] = drive(arguments, who, episodes, seed)
        rows.append(row(label, who, driven[label], time.perf_counter() - begin))
        print(name, *rows[-1], sep=" | ", flush=True)
    excluded = NOT_GIVEN.get(name, ())
    kinds = {label: BASELINES[label].kind if label in BASELINES else "baseline" for label in driven}
    usual = {o: d for o, d in driven.items() if kinds[o] != "oracle" and o not in excluded}
    text = f"## {name}\n\n`{arguments}`\n\n{table(HEADER, rows, 2)}\n"
    if "oracle" in driven and usual:
        best = max(usual, key=lambda o: usual[o].ended(ARRIVED).mean())
        gain, low, high = room(driven["oracle"], usual[best])
        text += f"\nRoom for learning: {gain:.0f} points ({low:.0f} to {high:.0f}) over {best}"
        informed = [o for o in driven if kinds[o] == "oracle" and o != "oracle"]
        if informed:
            knows = max(informed, key=lambda o: driven[o].ended(ARRIVED).mean())
            score, least, highest = room(driven[knows], usual[best])
            text += f"; under the same rules {score:.0f} ({least:.0f} to {highest:.0f}) by {knows}"
        verdict = "has an id" if name in TASKS else "may have one" if gain >= ROOM else "has none"
        text += ".\n" if name in PLAIN else f"; {ROOM:.0f} are asked for, so it {verdict}.\n"
    if excluded:
        excluded_names = ", ".join(label for label in driven if label in excluded)
        text += f"\nNot counted, since they see a waypoint: {excluded_names}.\n"
    return text


def main() -> None:
    """Parse arguments, drive, report."""
    args = arguments(
        __doc__,
        task=option(None, "default: all", action="append", choices=tuple(EVERYTHING)),
        baseline=option(
            None,
            f"{', '.join(BASELINES)}, or what `ambinav evaluate` takes; default: all of these and "
            "VFH+, in plain ids fewer",
            action="append",
        ),
        episodes=200,
        seed=1,
    )
    parts = []
    for name in args.task or EVERYTHING:
        whom = args.baseline or list(FEW if name in PLAIN else USUAL)
        parts.append(section(name, EVERYTHING[name], whom, args.episodes, args.seed))
    report("Tasks that a follower cannot do", LIBRARIES, "\n".join(parts), args.out)


if __name__ == "__main__":
    main()
