"""What the ambiguity reward does to a policy: trained without and with it, judged on what happens.

Each arm is trained with the same seeds by `ambinav train` (benchmarks/ablation.yaml, another weight
of the term `ambiguity`, nothing else). Its last policy, not its best, then drives episodes in halls
that no agent has seen, the same for all; planners follow their routes in them too. Written down
before the first run: the weights are compared by the share of episodes in which the robot was ever
lost, and by the length of the way of those that arrive; wanted is half the share for at most 10 %
more way.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
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

from ambinav.compare.leaderboard.figures import FIGURES
from ambinav.compare.leaderboard.methods import RouteFollower
from ambinav.compare.leaderboard.routes import PlannerChoice
from ambinav.drive.bootstrap import DRAWS, Interval
from ambinav_envs.evaluation import Episodes, evaluate
from ambinav_envs.policies import load_policy
from ambinav_envs.rewards import PRESETS
from ambinav_envs.scenario import scenario

CONFIG = ROOT / "benchmarks" / "ablation.yaml"
LIBRARIES = ("ambinav", "stable_baselines3", "torch", "numpy")
# Buildings that no training sees, as many as are drawn from, and the seed of the episodes.
UNSEEN = {"first_building": 1_000_000, "buildings": 100}
SEED = 7
SETTINGS: dict[str, dict[str, Any]] = {
    "as trained: boxes that the map lacks, odometry twice as bad as told": {},
    "known: no boxes, odometry as told": {"obstacles": 0, "odometry_scale": 1.0},
}
PLANNERS = {
    "planner, shortest": PlannerChoice("reference", 0.0),
    "planner, weight 2": PlannerChoice("reference", 2.0),
    "planner, weight 5": PlannerChoice("reference", 5.0),
}
SHOWN = ("lost", "arrived", "missed", "collided", "timeout", "error", "length", "exposure")
TITLES = {figure.key: f"{figure.title} {figure.unit}".strip() for figure in FIGURES}
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """One weight of the term `ambiguity`, trained with some seeds."""

    weight: float
    seeds: int
    folder: Path

    @property
    def name(self) -> str:
        """In tables."""
        return f"PPO, weight {self.weight:g}"

    @cached_property
    def config(self) -> Path:
        """Its configuration, written to the folder."""
        told = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
        told["environment"]["reward"] = {**PRESETS["shortest"], "ambiguity": self.weight}
        path = self.folder / f"weight-{self.weight:g}.yaml"
        path.write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")
        return path

    def run_folder(self, seed: int) -> Path:
        """Where a seed is trained."""
        return self.folder / f"weight-{self.weight:g}-seed-{seed}"


def train(arm: Arm, seed: int) -> None:
    """Train a policy, or go on with it; nothing if it is there."""
    folder = arm.run_folder(seed)
    if (folder / "final.zip").is_file():
        return
    command = [sys.executable, "-m", "ambinav.cli", "train", str(arm.config), "-o", str(folder)]
    command += ["--seed", str(seed), "--json", *(["--resume"] if folder.exists() else [])]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{folder}: {done.stderr}")
    print(f"trained: {folder.name}", file=sys.stderr, flush=True)


def driven(driver: Any, told: dict[str, Any], episodes: int) -> Episodes:
    """What a policy or a planner makes of the episodes."""
    arguments = {key: value for key, value in told.items() if key != "id"}
    drawn = arguments | {"suite": "hall"} | UNSEEN
    source, parameters = scenario(
        drawn.pop("suite"), None, drawn.pop("buildings"), drawn.pop("first_building"), None, drawn
    )
    return evaluate(driver, source, parameters, episodes, SEED)


def values(runs: list[Episodes], key: str) -> Floats:
    """A figure of each seed and episode, shape (S, E), nan where an episode has none."""
    figure = next(figure for figure in FIGURES if figure.key == key)
    return np.array([figure.values(run) for run in runs])


def resampled(rows: Floats, rng: np.random.Generator) -> Floats:
    """Means of draws of seeds and, the same for all of them, of episodes; shape (DRAWS,)."""
    seeds, episodes = rows.shape
    out = np.empty(DRAWS)
    for k in range(DRAWS):
        chosen = rows[rng.integers(seeds, size=seeds)][:, rng.integers(episodes, size=episodes)]
        out[k] = np.nanmean(chosen)
    return out


def interval(runs: list[Episodes], key: str) -> str:
    """Mean over seeds and episodes, and its interval."""
    rows = values(runs, key)
    if np.isnan(rows).all():
        return "-"
    digits = next(figure.digits for figure in FIGURES if figure.key == key)
    draws = resampled(rows, np.random.default_rng(SEED))
    low, high = np.quantile(draws, (0.025, 0.975))
    return f"{np.nanmean(rows):.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def ratio(ours: list[Episodes], theirs: list[Episodes], key: str) -> Interval:
    """Ratio of the means; both draw the same seeds and episodes."""
    draws = [resampled(values(runs, key), np.random.default_rng(SEED)) for runs in (ours, theirs)]
    rate = draws[0] / np.maximum(draws[1], 1e-9)
    low, high = np.quantile(rate, (0.025, 0.975))
    value = np.nanmean(values(ours, key)) / max(float(np.nanmean(values(theirs, key))), 1e-9)
    return Interval(float(value), float(low), float(high), len(ours))


def body(found: dict[str, dict[str, list[Episodes]]], arms: list[Arm], episodes: int) -> str:
    """The report."""
    told = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    parts = [
        f"`{CONFIG.relative_to(ROOT)}`: {told['algorithm']}, {told['steps']:,} steps, "
        f"{arms[0].seeds} seeds an arm; {episodes} episodes in unseen halls each. In brackets: "
        "95 % intervals by the bootstrap over seeds and episodes. Error: mean of a drive; length "
        "ratio: way by shortest way, of those that arrived."
    ]
    for setting, methods in found.items():
        rows = [(name, *(interval(runs, key) for key in SHOWN)) for name, runs in methods.items()]
        parts += [f"## {setting[0].upper()}{setting[1:]}"]
        parts += [table(("", *(TITLES[key] for key in SHOWN)), rows)]
        base = methods[arms[0].name]
        for arm in arms[1:]:
            said = [
                f"{word} {ratio(methods[arm.name], base, key)}"
                for key, word in (("lost", "lost"), ("length", "length ratio"))
            ]
            parts += [f"Weight {arm.weight:g} by weight {arms[0].weight:g}: {'; '.join(said)}."]
    return "\n\n".join(parts)


def main() -> None:
    """Train what is not there yet, judge, and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("out/ablation"), help="of trainings")
    parser.add_argument("--weights", type=float, nargs="+", default=(0.0, 1.0))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--jobs", type=int, default=2)
    add_out(parser)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    arms = [Arm(weight, args.seeds, args.folder) for weight in args.weights]
    with ThreadPoolExecutor(args.jobs) as pool:
        runs = [(arm, seed) for seed, arm in product(range(args.seeds), arms)]
        list(pool.map(lambda run: train(*run), runs))
    told = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))["environment"]
    found: dict[str, dict[str, list[Episodes]]] = {}
    for setting, changed in SETTINGS.items():
        methods = found.setdefault(setting, {})
        for arm in arms:
            policies = [
                load_policy(arm.run_folder(seed) / "final.zip") for seed in range(args.seeds)
            ]
            methods[arm.name] = [driven(one, told | changed, args.episodes) for one in policies]
        for name, choice in PLANNERS.items():
            methods[name] = [driven(RouteFollower(choice), told | changed, args.episodes)]
    report(
        "The ambiguity reward, with and without", LIBRARIES, body(found, arms, args.episodes),
        args.out,
    )  # fmt: skip


if __name__ == "__main__":
    main()
