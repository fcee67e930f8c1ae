"""Policies in conditions that they were not trained in: localizer, scanner and odometry.

Each of `ROBOTS` differs from the first in one thing. For each, plain PPO (Stable-Baselines3, all
settings its defaults) drives in drawn buildings alone, some seeds. Every policy is then judged with
every robot, in drawn buildings that it has not seen and on recorded maps. VFH+, which learns
nothing, drives the same episodes. Policies that are in the folder already are not trained again.

    AMBINAV_DATA=/data python benchmarks/study_transfer.py --out results/transfer-matrix.md
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from bench_transfer import JUDGED
from harness import arguments, environment_path, option, report, table

from ambinav.drive.bootstrap import paired_share, share
from ambinav_envs import Episodes, Policy, evaluate, load_policy
from ambinav_envs.evaluation import joined
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED

LIBRARIES: Final = ("ambinav", "stable_baselines3", "torch", "numpy", "numba")
TASK: Final = "ambinav/Procedural-v1"
MAP_TASK: Final = "ambinav/Navigation-v1"
ROBOTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "plain": {},
    "Monte Carlo": {"localizer": "mcl"},
    "8 m of range": {"scanner": {"max_range": 8.0}},
    "odometry x 2": {"odometry_scale": 2.0},
}
"""The first: a Kalman filter, 60 beams of 4 m, and odometry that errs as the filter assumes."""
SEEN: Final[Mapping[str, Any]] = {"window": False}


def train(robot: str, seed: int, steps: int, file: Path) -> None:
    """Train with a robot in drawn buildings, and save what Stable-Baselines3 saves."""
    import torch
    from stable_baselines3 import PPO

    from ambinav_envs.sb3 import make_sb3

    torch.set_num_threads(1)
    model = PPO(
        "MultiInputPolicy", make_sb3(TASK, seed=seed, **SEEN, **ROBOTS[robot]), seed=seed,
        device="cpu",
    )  # fmt: skip
    model.learn(steps)
    model.save(file)


def drive(policy: Policy, robot: str, maps: list[str], episodes: int, seed: int) -> list[Episodes]:
    """Return episodes on all maps, and as many in drawn buildings."""
    changed = {**SEEN, **ROBOTS[robot]}
    places = [{"map": environment_path(name)} for name in maps]
    recorded = [evaluate(policy, MAP_TASK, episodes, seed, **changed, **place) for place in places]
    return [joined(recorded), evaluate(policy, TASK, episodes * len(maps), seed, **changed)]


def tables(driven: Mapping[str, Mapping[str, Episodes]]) -> str:
    """Return arrivals by training and by robot, and differences to training with that robot.

    Args:
        driven: Episodes by training and robot; of a training in `ROBOTS` those of all seeds, and of
            VFH+ as many by repetition, so that all are paired.
    """
    shares, differences = [], []
    for trained, by_robot in driven.items():
        cells = []
        for episodes in by_robot.values():
            rate = share(episodes.ended(ARRIVED), group=episodes.building).scaled(100.0)
            collided = 100.0 * float(np.mean(episodes.ended(COLLIDED)))
            cells.append(f"{rate.value:.0f} [{rate.low:.0f}, {rate.high:.0f}], {collided:.0f}")
        shares.append((trained, *cells))
        row_cells = []
        for robot, episodes in by_robot.items():
            at_home = driven[robot][robot].ended(ARRIVED)
            points = paired_share(episodes.ended(ARRIVED), at_home, group=episodes.building).scaled(
                100.0
            )
            text = f"{points.value:+.0f} [{points.low:+.0f}, {points.high:+.0f}]"
            bold = f"**{text}**" if points.low > 0.0 or points.high < 0.0 else text
            row_cells.append("-" if trained == robot else bold)
        differences.append((trained, *row_cells))
    header = ("trained with", *(f"driven with {name}" for name in ROBOTS))
    return (
        f"Arrived in %, collided in %:\n\n{table(header, shares, 1)}\n\nArrived, less the policy "
        f"trained with the robot that drives, points:\n\n{table(header, differences, 1)}"
    )


def main() -> None:
    """Train what is missing, drive, and report."""
    chosen = arguments(
        __doc__,
        seeds=5,
        steps=option(300_000, "of each training"),
        episodes=option(64, "of each map"),
        seed=option(40, "of the episodes"),
        maps=option(JUDGED, nargs="*"),
        work=Path("out/transfer-matrix"),
    )
    chosen.work.mkdir(parents=True, exist_ok=True)
    trained: dict[str, list[Policy]] = {name: [] for name in ROBOTS}
    for seed in range(chosen.seeds):
        for robot, policies in trained.items():
            file = chosen.work / f"{robot.replace(' ', '-')}-{seed}.zip"
            if not file.is_file():
                train(robot, seed, chosen.steps, file)
            environment = {"id": TASK, **SEEN, **ROBOTS[robot]}
            policies.append(load_policy(file, trust=True, environment=environment))
            print(file, flush=True)
    trained["vfh"] = [load_policy("vfh")] * chosen.seeds
    driven = {
        name: {
            robot: [
                drive(policy, robot, chosen.maps, chosen.episodes, chosen.seed)
                for policy in policies
            ]
            for robot in ROBOTS
        }
        for name, policies in trained.items()
    }
    sections = []
    for place, title in enumerate(("Recorded maps", "Drawn buildings")):
        pooled = {
            name: {robot: joined([each[place] for each in seeds]) for robot, seeds in by.items()}
            for name, by in driven.items()
        }
        count = chosen.episodes * len(chosen.maps)
        sections.append(f"## {title}, {count} episodes a seed\n\n{tables(pooled)}")
    about = "\n\n".join(str(__doc__).split("\n\n")[1:-1])
    body = (
        f"{about}\n\n`{TASK}` without the window, {chosen.seeds} seeds of {chosen.steps} steps "
        f"each; maps: {', '.join(chosen.maps)}. In brackets: 95 % intervals by building; bold "
        "differences exclude 0."
    )
    report("Transfer between robots", LIBRARIES, "\n\n".join([body, *sections]), chosen.out)


if __name__ == "__main__":
    main()
