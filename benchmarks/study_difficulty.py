"""Results of reactive baselines and a blind follower at each difficulty, in suites and maps.

At one level all drive the same episodes, and buildings are the same at all levels. Levels must be
worth their name: with each of them, all suites together, nobody is to arrive more often.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numba
import numpy as np
from bench_env import Driving, rates
from harness import arguments, environment_path, option, report, table

from ambinav.drive import bootstrap
from ambinav.drive.shares import evidence_of, newcombe
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.difficulty import LEVELS
from ambinav_envs.evaluation import UNSEEN, EpisodeDriver, Episodes, evaluate_in, joined
from ambinav_envs.leaderboard.methods import PLANNERS, SHORTEST, STEERS, planner_method
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.policy import Policy
from ambinav_envs.scenario import scenario
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, MISSED, TIMEOUT
from ambinav_envs.tasks import SUITES_WITH_IDS as SUITES

LIBRARIES = ("ambinav", "gymnasium", "numba", "numpy")
REACTIVE = ("vfh", "vfh-aware")
DRIVERS = (SHORTEST, *REACTIVE)
HEADER = (
    "where", "drives", "difficulty", "arrived %", "ever lost %", "lost at the end %", "collided %",
    "missed %", "timeout %", "error (m)",
)  # fmt: skip
Driver = EpisodeDriver | Policy
SOURCES: dict[tuple[str | None, Path | None], BuildingSource] = {}


def places(names: list[str]) -> dict[str, tuple[str | None, Path | None]]:
    """Return suites, or files of recorded maps, by name."""
    return {
        name: (name, None) if name in SUITES else (None, environment_path(name)) for name in names
    }


def drive(
    suite: str | None, path: Path | None, who: str, level: int, episodes: int, buildings: int,
    seed: int, options: Mapping[str, float],
) -> Episodes:  # fmt: skip
    """Run episodes of one driver in one suite or map.

    Args:
        suite: Suite of buildings; None: a map.
        path: Or in which map.
        who: One of `DRIVERS`.
        level: Difficulty.
        episodes: Number of episodes.
        buildings: Number of buildings of the suite.
        seed: Seed of the episodes.
        options: Arguments besides.
    """
    policy = load_policy(who) if who in REACTIVE else None
    seeing = {**STEERS, "window": False} if policy is None else policy.seeing
    fresh, parameters = scenario(
        suite, path, buildings if suite else None, UNSEEN if suite else 0, None,
        {**seeing, **options, "difficulty": level},
    )  # fmt: skip
    # Shared by all, because it holds the maps.
    source = SOURCES.setdefault((suite, path), fresh)
    make: Callable[[NavigationParameters], Driver] = planner_method(
        SHORTEST, PLANNERS[SHORTEST]
    ).make
    return evaluate_in(
        make(parameters) if policy is None else policy, source, parameters, episodes, seed,
        chunk=min(episodes, 128),
    )  # fmt: skip


def share(which: np.ndarray) -> str:
    """Format a share with its interval, per cent."""
    interval = bootstrap.share(which).scaled(100.0)
    return f"{interval.value:.0f} ({interval.low:.0f} to {interval.high:.0f})"


def row(where: str, who: str, level: str, episodes: Episodes) -> list[str]:
    """Return a line of the table."""
    return [
        where, who, level, share(episodes.ended(ARRIVED)), share(episodes.was_lost),
        share(episodes.lost_at_end), share(episodes.ended(COLLIDED)),
        *(f"{100 * episodes.ended(code).mean():.0f}" for code in (MISSED, TIMEOUT)),
        f"{episodes.error_mean.mean():.3f}",
    ]  # fmt: skip


def difference(first: Episodes, second: Episodes) -> tuple[float, float, float]:
    """Return the difference of arrival rates in points, with Newcombe's interval."""
    a, b = (episodes.ended(ARRIVED).astype(float) for episodes in (first, second))
    evidence = [evidence_of(arrived, None, bootstrap.LEVEL) for arrived in (a, b)]
    low, high = newcombe(float(a.mean()), float(b.mean()), *evidence)
    return 100.0 * float(a.mean() - b.mean()), 100.0 * low, 100.0 * high


def judged(episodes: Mapping[tuple[str, int], Episodes]) -> str:
    """Say whether each level is harder than the one before."""
    lines = []
    for who in DRIVERS:
        steps = []
        for level in range(1, len(LEVELS)):
            gain, low, high = difference(episodes[who, level], episodes[who, level - 1])
            word = "fewer" if high < 0 else ("MORE" if low > 0 else "not shown")
            steps.append(f"{level - 1} to {level}: {gain:+.1f} ({low:+.1f} to {high:+.1f}) {word}")
        lines.append(f"- {who}: " + "; ".join(steps))
    return "\n".join(lines)


def section(title: str, names: list[str], arguments: argparse.Namespace) -> str:
    """Return the table of some suites or maps, and the verdict on all of them."""
    rows, parts = [], {}
    for name, (suite, path) in places(names).items():
        for who in DRIVERS:
            for level in range(len(LEVELS)):
                begin = time.perf_counter()
                driven = drive(
                    suite, path, who, level, arguments.episodes, arguments.buildings,
                    arguments.seed, {},
                )  # fmt: skip
                parts.setdefault((who, level), []).append(driven)
                rows.append(row(name, who, str(level), driven))
                took = f"{time.perf_counter() - begin:.0f} s"
                print(*rows[-1], took, sep=" | ", flush=True)
    together = {key: joined(each) for key, each in parts.items()}
    summary = [row("all", who, str(level), driven) for (who, level), driven in together.items()]
    return (
        f"## {title}\n\n{table(HEADER, summary, 3)}\n\nArrivals from level to level, points:\n\n"
        f"{judged(together)}\n\n{table(HEADER, rows, 3)}\n"
    )


def options_one_by_one(arguments: argparse.Namespace) -> str:
    """Measure the effect of each option alone, at its value of the highest level."""
    rows = []
    for name, value in [("as mapped", None), *LEVELS[-1].items()]:
        for who in REACTIVE[:1]:
            options = {} if value is None else {name: value}
            driven = joined(
                [
                    drive(
                        suite, None, who, 0, arguments.episodes, arguments.buildings,
                        arguments.seed, options,
                    )
                    for suite in SUITES
                ]
            )  # fmt: skip
            text = name if value is None else f"`{name}` {value:g}"
            rows.append(row(text, who, "0", driven))
            print(*rows[-1], sep=" | ", flush=True)
    return (
        f"## Each option alone, at the value of level 3, all suites\n\n{table(HEADER, rows, 3)}\n"
    )


def speeds(repeats: int = 9, steps: int = 60, robots: int = 64) -> str:
    """Return steps per processor second, on one thread, by level and by option."""
    numba.set_num_threads(1)
    cases: dict[str, dict[str, float]] = {
        f"difficulty {level}": {"difficulty": level} for level in range(len(LEVELS))
    }
    cases |= {f"`{name}` {value:g}": {name: value} for name, value in LEVELS[-1].items()}
    runs = {
        name: Driving(
            robots, steps,
            {"suite": "procedural", "buildings": 4, "window": False, **options}, time.process_time,
        )
        for name, options in cases.items()
    }  # fmt: skip
    rows = [(name, rate) for name, (rate, _) in rates(runs, repeats).items()]
    return (
        f"## Speed\n\nThousand steps a second of the processor, {robots} robots on one thread, "
        f"Kalman filter, no window; median and extremes of {repeats} rounds.\n\n"
        f"{table(('options', 'steps / s'), rows)}\n"
    )


def main() -> None:
    """Parse arguments, drive, report."""
    args = arguments(
        __doc__,
        suites=option(list(SUITES), nargs="*"),
        maps=option([], "names of harness.ENVIRONMENTS", nargs="*"),
        alone=option(False, "each option alone besides"),
        speed=option(False, "steps a second besides"),
        episodes=100,
        buildings=20,
        seed=0,
    )
    parts = []
    for title, names in (("Suites", args.suites), ("Recorded maps", args.maps)):
        if names:
            parts.append(section(title, names, args))
    if args.alone:
        parts.append(options_one_by_one(args))
    if args.speed:
        parts.append(speeds())
    report("Difficulty", LIBRARIES, "\n".join(parts), args.out)


if __name__ == "__main__":
    main()
