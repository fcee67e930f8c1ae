"""Results in the five levels of TwinRooms: scripts, planners over hypotheses, and learners.

Each method drives the same episodes. The score of an episode is the task's reward without its
shaping: 1 for arriving, -1 for a collision, -1 for a false declaration and -0.01 for each second,
or what the level's reward says instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from belief_methods import BELIEF_METHODS
from harness import arguments, kept_or_made, option, report, table
from numpy.typing import NDArray
from study_tasks import drive
from task_baselines import Baseline, baseline

from ambinav.drive.bootstrap import share
from ambinav_envs.evaluation import UNSEEN
from ambinav_envs.registration import IDS
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, MISSED, TIMEOUT
from ambinav_envs.tasks import TWIN_ROOMS

LIBRARIES = ("ambinav", "gymnasium", "numba", "numpy")
LEVELS = {str(k): spec.name for k, spec in enumerate(TWIN_ROOMS, 1)}
UNSEEN_BUILDINGS: dict[str, Any] = {"first_building": UNSEEN, "buildings": 32}
HEADER = (
    "method", "kind", "drives", "arrived %", "missed %", "collided %", "timeout %", "seconds",
    "score",
)  # fmt: skip


class Driven(NamedTuple):
    """How E episodes ended, shape (E,): a code of `layout.OUTCOMES`, and after how many seconds."""

    outcome: NDArray[np.int64]
    seconds: NDArray[np.float64]

    def ended(self, code: int) -> NDArray[np.bool_]:
        """Return which episodes ended with this outcome."""
        return np.asarray(self.outcome == code, dtype=np.bool_)


def driven_by(
    who: Baseline, key: Mapping[str, Any], options: dict[str, Any], kept: Path | None
) -> Driven:
    """Drive episodes, or read them from the file `kept` if the same code has driven them before."""

    def rows() -> dict[str, Any]:
        episodes = drive(options, who, key["episodes"], key["seed"])
        return {"outcome": episodes.outcome.tolist(), "seconds": episodes.seconds.tolist()}

    row = rows() if kept is None or who.kind == "learner" else kept_or_made(kept, key, rows)
    return Driven(np.array(row["outcome"]), np.array(row["seconds"]))


def scores(episodes: Driven, reward: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the score of each episode, by the weights of the task's reward."""
    ends = (
        reward["arrival"] * episodes.ended(ARRIVED)
        - reward["missed"] * episodes.ended(MISSED)
        - reward["collision"] * episodes.ended(COLLIDED)
    )
    return np.asarray(ends - reward["time"] * episodes.seconds)


def with_error(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return a mean and its half interval at 95 %."""
    return float(values.mean()), 1.96 * float(values.std(ddof=1)) / math.sqrt(len(values))


def section(
    level: str,
    whom: dict[str, Baseline],
    place: dict[str, Any],
    episodes: int,
    seed: int,
    kept: Path | None = None,
    against: str | None = None,
) -> str:
    """Return the table of a level, and paired leads.

    These are of the best of each kind; or of one method over each other one, if that is named.
    """
    rows, scored = [], {}
    options = {**IDS[LEVELS[level]], **place}
    if "map" in place:
        del options["suite"], options["buildings"]
    for name, who in whom.items():
        key = {"level": level, "method": name, "place": place, "episodes": episodes, "seed": seed}
        driven = driven_by(who, key, options, kept)
        scored[name] = scores(driven, options["reward"])
        often, (mean, error) = share(driven.ended(ARRIVED)).scaled(100.0), with_error(scored[name])
        rows.append([
            name, _kind(who), who.text, f"{often.value:.0f} ({often.low:.0f} to {often.high:.0f})",
            *(f"{100 * driven.ended(code).mean():.0f}" for code in (MISSED, COLLIDED, TIMEOUT)),
            f"{driven.seconds.mean():.0f}", f"{mean:.2f} ± {error:.2f}",
        ])  # fmt: skip
        print(level, *rows[-1], sep=" | ", flush=True)
    where = place.get("map", "buildings that no policy has seen")
    text = f"## {LEVELS[level].removeprefix('ambinav/')}, {where}\n\n{table(HEADER, rows, 3)}\n\n"
    if against is not None:
        for rival in scored:
            if rival != against:
                lead, error = with_error(scored[against] - scored[rival])
                text += f"- {against} over {rival}: {lead:.2f} ± {error:.2f}\n"
        return text
    best = {
        kind: max(
            (n for n, who in whom.items() if _kind(who) == kind), key=lambda n: scored[n].mean()
        )
        for kind in dict.fromkeys(map(_kind, whom.values()))
    }
    for kind, name in best.items():
        for rival_kind, rival in best.items():
            if kind != rival_kind and scored[name].mean() > scored[rival].mean():
                lead, error = with_error(scored[name] - scored[rival])
                text += f"- {name} ({kind}) over {rival} ({rival_kind}): {lead:.2f} ± {error:.2f}\n"
    return text


def _kind(who: Baseline) -> str:
    return {"baseline": "script", "oracle": "true pose"}.get(who.kind, who.kind)


def main() -> None:
    """Parse arguments, drive, report."""
    args = arguments(
        __doc__,
        level=option(None, "default: all", action="append", choices=tuple(LEVELS)),
        method=option(None, "default: all", action="append", choices=tuple(BELIEF_METHODS)),
        map=option(None, "a building in the place of drawn ones, repeatable", action="append"),
        policy=option(None, "NAME=FILE of a trained policy, repeatable", action="append"),
        episodes=100,
        seed=1,
        kept=option(None, "file of JSON lines to keep episodes in, and read them from", type=Path),
        against=option(None, "a method whose lead over each other one is given"),
    )
    whom = {name: BELIEF_METHODS[name] for name in args.method or BELIEF_METHODS}
    for policy in args.policy or ():
        name, _, file = policy.partition("=")
        who = baseline(file)
        whom[name] = Baseline(f"trained: {name}", who.make, who.seeing, "learner")
    places = [{"map": name} for name in args.map or ()] or [UNSEEN_BUILDINGS]
    parts = [
        section(level, whom, place, args.episodes, args.seed, args.kept, args.against)
        for place in places
        for level in args.level or LEVELS
    ]
    report("Twin rooms", LIBRARIES, "\n".join(parts), args.out)


if __name__ == "__main__":
    main()
