"""What the ambiguity reward does to a policy: trained without and with it, judged on what happens.

Each arm is trained with the same seeds by `ambinav train` (benchmarks/ablation.yaml, another weight
of the term `ambiguity`, and another `ambiguity_weight` where one is named; nothing else). Its last
policy, not its best, then drives episodes in halls that no agent has seen, the same for all;
planners follow their routes in them too. Written down before the first run: the arms are compared
by the share of episodes in which the robot was ever lost, and by the length of the path of those
that arrive; wanted is half the share for at most 10 % more length.

In a first run, weight 2 alone was lost 0.69 times as often (0.53 to 0.87) as weight 0, for 3 % more
length: it sees no farther than its window, and its waypoint led it along the shortest path.
`ambiguity_weight` came after that. That 3 is a weight to try was found in the halls of training,
where a robot that drives from waypoint to waypoint was lost 0.50 times as often with it for 10 %
more length. In a second run, weight 1 with `ambiguity_weight` 3 was lost 0.515 times as often (0.38
to 0.66) for 1 % more length. Weight 5, at which the path is the one that the reward of weight 1
asks for, came after that: 0.512 (0.37 to 0.68) for 4 %. Trained again when waypoints led round
corners in wider turns: 0.520 (0.37 to 0.69) for 4 %.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from harness import ROOT, add_out, report, table
from numpy.typing import NDArray

from ambinav.drive.bootstrap import Interval, grouped_weights, percentiles
from ambinav.reports.table import interval_text
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.evaluation import UNSEEN, Episodes, evaluate
from ambinav_envs.leaderboard.figures import FIGURES, ratios
from ambinav_envs.leaderboard.methods import RouteFollower
from ambinav_envs.leaderboard.routes import PlannerChoice
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies import Policy, load_policy
from ambinav_envs.rewards import PRESETS
from ambinav_envs.scenario import scenario
from ambinav_envs.training.folder import CONFIG as CONFIG_FILE

CONFIG = ROOT / "benchmarks" / "ablation.yaml"
LIBRARIES = ("ambinav", "stable_baselines3", "torch", "numpy")
# How many buildings the episodes are in, and the seed of the episodes.
BUILDINGS, SEED = 100, 7
# Environment i of a training starts from its seed + i.
APART = 1000
SETTINGS: dict[str, dict[str, Any]] = {
    "as trained: boxes that the map lacks, odometry twice as bad as assumed": {},
    "known: no boxes, odometry as assumed": {"obstacles": 0, "odometry_scale": 1.0},
}
PLANNERS = {
    "planner, shortest": PlannerChoice("reference", 0.0),
    "planner, weight 2": PlannerChoice("reference", 2.0),
    "planner, weight 5": PlannerChoice("reference", 5.0),
}
OF_EACH_SEED = ("lost", "arrived", "collided", "timeout", "length")
SHOWN = ("lost", "arrived", "missed", "collided", "timeout", "error", "length", "exposure")
TITLES = {figure.key: f"{figure.title} {figure.unit}".strip() for figure in FIGURES}
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """One weight of the term `ambiguity` and one `ambiguity_weight`, trained with some seeds."""

    weight: float
    ambiguity_weight: float
    seeds: Sequence[int]
    folder: Path

    @property
    def name(self) -> str:
        """In tables."""
        return f"PPO, weight {self.weight:g}" + (
            f", way {self.ambiguity_weight:g}" if self.ambiguity_weight else ""
        )

    @property
    def _stem(self) -> str:
        """Of its files."""
        return f"weight-{self.weight:g}" + (
            f"-way-{self.ambiguity_weight:g}" if self.ambiguity_weight else ""
        )

    @cached_property
    def config(self) -> Path:
        """Its configuration, written to the folder."""
        settings = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
        settings["environment"]["reward"] = {**PRESETS["shortest"], "ambiguity": self.weight}
        settings["environment"]["ambiguity_weight"] = self.ambiguity_weight
        path = self.folder / f"{self._stem}.yaml"
        path.write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")
        return path

    def run_folder(self, seed: int) -> Path:
        """Where a seed is trained."""
        return self.folder / f"{self._stem}-seed-{seed}"


def train(arm: Arm, seed: int) -> None:
    """Train a policy, or go on with it; nothing if it is there."""
    folder = arm.run_folder(seed)
    if (folder / "final.zip").is_file():
        return
    command = [sys.executable, "-m", "ambinav.cli", "train", str(arm.config), "-o", str(folder)]
    command += [
        "--seed",
        str(seed),
        "--json",
        *(["--resume"] if (folder / CONFIG_FILE).is_file() else []),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{folder}: {done.stderr}")
    print(f"trained: {folder.name}", file=sys.stderr, flush=True)


class Course:
    """The episodes: the halls that nobody has seen, held for all who drive there.

    Args:
        settings: The environment of training.
        episodes: How many.
    """

    def __init__(self, settings: Mapping[str, Any], episodes: int) -> None:
        self._arguments = {
            key: one for key, one in settings.items() if key not in ("id", "buildings")
        }
        self._episodes = episodes
        self._source, _ = self._scenario({})

    def _scenario(self, changed: Mapping[str, Any]) -> tuple[BuildingSource, NavigationParameters]:
        return scenario("hall", None, BUILDINGS, UNSEEN, None, {**self._arguments, **changed})

    def driven(self, driver: Any, changed: Mapping[str, Any]) -> Episodes:
        """What a policy or a planner makes of the episodes; a policy sees what it is used to."""
        seeing = driver.seeing if isinstance(driver, Policy) else {}
        _, parameters = self._scenario({**changed, **seeing})
        print(f"driven: {getattr(driver, 'name', 'route')}", file=sys.stderr, flush=True)
        return evaluate(driver, self._source, parameters, self._episodes, SEED)


def parts_of(runs: Sequence[Episodes], key: str) -> tuple[Floats, Floats]:
    """What a figure is the ratio of the sums of, by seed and episode: two of shape (S, E)."""
    figure = next(figure for figure in FIGURES if figure.key == key)
    above, below = zip(*(figure.parts(run) for run in runs), strict=True)
    return np.array(above), np.array(below)


def drawn(runs: Sequence[Episodes], parts: Sequence[Floats]) -> list[Floats]:
    """Sums of each part, (S, E), over draws of seeds and, the same for all, of episodes: (D,).

    Buildings are drawn first, then episodes in them; of all methods the same.
    """
    rng = np.random.default_rng(SEED)
    weights = np.vstack(list(grouped_weights(runs[0].building, rng)))
    count = len(runs)
    seeds = rng.multinomial(count, np.full(count, 1.0 / count), size=len(weights))
    return [((seeds @ part) * weights).sum(axis=1) for part in parts]


def interval(runs: Sequence[Episodes], key: str) -> str:
    """A figure over seeds and episodes, and its interval."""
    parts = parts_of(runs, key)
    above, below = (np.array(part.sum()) for part in parts)
    count = np.count_nonzero(parts[1])
    found = percentiles(float(ratios(above, below)), ratios(*drawn(runs, parts)), count)
    return interval_text(found, next(figure.digits for figure in FIGURES if figure.key == key))


def ratio(ours: Sequence[Episodes], theirs: Sequence[Episodes], key: str) -> Interval:
    """Ratio of a figure; of seeds and episodes that have one on both sides."""
    parts = [*parts_of(ours, key), *parts_of(theirs, key)]
    both = (parts[1] > 0.0) & (parts[3] > 0.0)
    parts = [np.where(both, part, 0.0) for part in parts]
    whole = [np.array(part.sum()) for part in parts]
    rate, draws = (
        ratios(ratios(*one[:2]), ratios(*one[2:])) for one in (whole, drawn(ours, parts))
    )
    return percentiles(float(rate), draws, np.count_nonzero(both))


def compared(ours: Sequence[Episodes], theirs: Sequence[Episodes]) -> str:
    """How a method does by another one, in words."""
    return "; ".join(
        f"{word} {interval_text(ratio(ours, theirs, key), 3)}"
        for key, word in (("lost", "lost"), ("length", "way"))
    )


def body(found: dict[str, dict[str, list[Episodes]]], arms: list[Arm], episodes: int) -> str:
    """The report."""
    settings = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    seeds = arms[0].seeds
    shared = len(seeds) > 1 and seeds[1] - seeds[0] < settings["envs"]
    parts = [
        f"`{CONFIG.relative_to(ROOT)}`: {settings['algorithm']}, {settings['steps']:,} steps, "
        "seeds "
        f"{', '.join(map(str, seeds))} in each arm; {episodes} episodes each, in {BUILDINGS} "
        "unseen halls. In brackets: 95 % intervals by the bootstrap over seeds, buildings and "
        "episodes in them. Error: mean of a drive; length ratio: path by shortest path, of those "
        "that arrived; exposure: of all episodes by all metres. Ratios of paths are of the seeds "
        "and episodes that arrived on both sides.",
        f"{len(seeds)} seeds are few: percentile intervals of so few groups hold less than the "
        "95 % that they say."
        + (
            f" And environment i of a training starts from its seed + i, of {settings['envs']}: "
            "trainings with neighbouring seeds share most of their random numbers, so that they "
            "differ less than others would."
            if shared
            else ""
        ),
    ]
    for setting, methods in found.items():
        rows = [(name, *(interval(runs, key) for key in SHOWN)) for name, runs in methods.items()]
        parts += [f"## {setting[0].upper()}{setting[1:]}"]
        parts += [table(("", *(TITLES[key] for key in SHOWN)), rows)]
        base, shortest = methods[arms[0].name], methods[next(iter(PLANNERS))]
        lines = [
            f"- {arm.name} by {arms[0].name}: {compared(methods[arm.name], base)}"
            for arm in arms[1:]
        ]
        lines += [
            f"- {name} by shortest: {compared(methods[name], shortest)}"
            for name in list(PLANNERS)[1:]
        ]
        parts += ["\n".join(lines), "Each seed:"]
        of_each = [
            (f"{arm.name}, seed {seed}", *(_figure(run, key) for key in OF_EACH_SEED))
            for arm in arms
            for seed, run in zip(arm.seeds, methods[arm.name], strict=True)
        ]
        parts += [table(("", *(TITLES[key] for key in OF_EACH_SEED)), of_each)]
    return "\n\n".join(parts)


def _figure(run: Episodes, key: str) -> str:
    """A figure of one training."""
    figure = next(figure for figure in FIGURES if figure.key == key)
    above, below = (np.array(part.sum()) for part in figure.parts(run))
    return f"{float(ratios(above, below)):.{figure.digits}f}"


def main() -> None:
    """Train what is not there yet, judge, and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("out/ablation"), help="of trainings")
    parser.add_argument(
        "--arms", nargs="+", default=("0", "1:3", "1:5"), metavar="WEIGHT[:WAY]",
        help="of the term `ambiguity`, and `ambiguity_weight`",
    )  # fmt: skip
    parser.add_argument("--seeds", type=int, default=5, help="how many")
    parser.add_argument("--apart", type=int, default=APART, help="from one seed to the next")
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--jobs", type=int, default=2)
    add_out(parser)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    seeds = range(0, args.seeds * args.apart, args.apart)
    arms = []
    for arm in args.arms:
        weight, _, ambiguity_weight = arm.partition(":")
        arms.append(Arm(float(weight), float(ambiguity_weight or 0.0), seeds, args.folder))
    with ThreadPoolExecutor(args.jobs) as pool:
        runs = [(arm, seed) for seed, arm in product(seeds, arms)]
        list(pool.map(lambda run: train(*run), runs))
    course = Course(
        yaml.safe_load(CONFIG.read_text(encoding="utf-8"))["environment"], args.episodes
    )
    policies = {
        arm.name: [load_policy(arm.run_folder(seed) / "final.zip") for seed in seeds]
        for arm in arms
    }
    # Their routes hang on no setting.
    followers = {name: RouteFollower(choice) for name, choice in PLANNERS.items()}
    found: dict[str, dict[str, list[Episodes]]] = {}
    for setting, changed in SETTINGS.items():
        methods = found.setdefault(setting, {})
        for name, runs_of_arm in policies.items():
            methods[name] = [course.driven(one, changed) for one in runs_of_arm]
        for name, follower in followers.items():
            methods[name] = [course.driven(follower, changed)]
    report(
        "The ambiguity reward, with and without", LIBRARIES, body(found, arms, args.episodes),
        args.out,
    )  # fmt: skip


if __name__ == "__main__":
    main()
