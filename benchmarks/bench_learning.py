"""Learning curves of plain PPO: code that uses nothing of ambinav but the ids.

Two of those: `examples/06_plain_ppo.py`, PPO in one file, for every id; and Stable-Baselines3's PPO
with its own hyperparameters, its own network and `make_sb3` alone, for the suites. Each training is
one seed. It is judged without exploration in buildings that it has not seen, the first episodes of
each robot. What is there already in the folder is not trained again.
"""

from __future__ import annotations

import csv
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from harness import ROOT, arguments, option, report, table

from ambinav_envs.tasks import HARD_TASKS
from ambinav_envs.tasks import SUITES_WITH_IDS as SUITES

LIBRARIES = ("ambinav", "stable_baselines3", "torch", "numpy", "numba")
CURVES: Final = ROOT / "benchmarks" / "results" / "learning"
EXAMPLE = ROOT / "examples" / "06_plain_ppo.py"
IDS: Final = (
    *(f"{name.capitalize()}-v1" for name in SUITES),
    *(spec.name.partition("/")[2] for spec in HARD_TASKS),
)
ENVS, UNSEEN, EACH = 64, 1_000_000, 3
WINDOW = 40_000
"""Steps over which a curve is smoothed."""


def one_file(name: str, steps: int, seed: int, folder: Path) -> None:
    """Train with the example script, in a separate process."""
    command = [
        sys.executable, str(EXAMPLE), f"ambinav_envs:ambinav/{name}", "--steps", str(steps),
        "--seed", str(seed), "--curve", str(folder / f"{name}.csv"),
    ]  # fmt: skip
    log = folder / f"{name}.log"
    with log.open("w", encoding="utf-8") as out:
        subprocess.run(command, check=True, stdout=out, env=os.environ)


def stable_baselines(name: str, steps: int, seed: int, folder: Path) -> None:
    """Train with Stable-Baselines3's PPO and its defaults."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback

    from ambinav_envs.sb3 import make_sb3

    rows: list[tuple[int, int, float, float]] = []
    began = time.perf_counter()

    class Count(BaseCallback):
        """Counts how many of a rollout's episodes have arrived."""

        def _on_rollout_start(self) -> None:
            self.ends: list[bool] = []

        def _on_step(self) -> bool:
            self.ends += [
                info["is_success"]
                for info, done in zip(self.locals["infos"], self.locals["dones"], strict=True)
                if done
            ]
            return True

        def _on_rollout_end(self) -> None:
            share = float(np.mean(self.ends)) if self.ends else 0.0
            seconds = time.perf_counter() - began
            rows.append((self.num_timesteps, len(self.ends), share, seconds))

    envs = make_sb3(f"ambinav/{name}", ENVS, seed=seed)
    model = PPO("MultiInputPolicy", envs, n_steps=128, batch_size=256, seed=seed, device="cpu")
    model.learn(steps, callback=Count())
    envs = make_sb3(f"ambinav/{name}", ENVS, seed=0, first_building=UNSEEN)
    seen, ended, how = envs.reset(), np.zeros(ENVS, dtype=int), []
    while (ended < EACH).any():
        seen, _, done, infos = envs.step(model.predict(seen, deterministic=True)[0])
        how += [infos[i]["outcome"] for i in np.flatnonzero(done & (ended < EACH))]
        ended += done
    (folder / f"{name}.log").write_text(format_ends(how), encoding="utf-8")
    with (folder / f"{name}.csv").open("w", encoding="utf-8") as out:
        csv.writer(out).writerows([("steps", "episodes", "arrived", "seconds"), *rows])


def format_ends(how: list[str]) -> str:
    """Format the ends of episodes in one line, as the example does."""
    return f"of {len(how)} episodes " + ", ".join(
        f"{how.count(outcome)} {outcome}" for outcome in sorted(set(how))
    )


KINDS: Final[dict[str, Any]] = {"one file": one_file, "stable-baselines3": stable_baselines}


def read_curve(path: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Read steps, share of arrivals (smoothed by episodes), and total seconds."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    wide = max(1, round(WINDOW / rows[0, 0]))
    kernel = np.ones(wide)
    episodes = np.convolve(rows[:, 1], kernel)[: len(rows)]
    arrived = np.convolve(rows[:, 1] * rows[:, 2], kernel)[: len(rows)]
    return rows[:, 0], arrived / np.maximum(episodes, 1.0), float(rows[-1, 3])


def ends_of(path: Path) -> dict[str, int]:
    """Read from the last line of a log how the evaluated episodes ended."""
    last = path.read_text(encoding="utf-8").strip().splitlines()[-1]
    total, _, parts = last.removeprefix("of ").partition(" episodes ")
    counts = {name: int(count) for count, name in (part.split() for part in parts.split(", "))}
    return {"episodes": int(total), **counts}


def draw(folder: Path, out: Path) -> None:
    """Plot a small chart for each id with both learning curves."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    rows, columns = math.ceil(len(IDS) / 5), 5
    figure, axes = plt.subplots(
        rows, columns, figsize=(11, 2.2 * rows), sharex=True, sharey=True, squeeze=False
    )
    for axis in axes.flat[len(IDS) :]:
        axis.set_visible(False)
    for axis, name in zip(axes.flat, IDS, strict=False):
        for (kind, _), colour, style in zip(
            KINDS.items(), ("#0072b2", "#d55e00"), ("-", "--"), strict=True
        ):
            path = folder / kind / f"{name}.csv"
            if path.is_file():
                steps, arrived, _ = read_curve(path)
                axis.plot(steps / 1e3, 100.0 * arrived, style, color=colour, label=kind)
        axis.set_title(name.removesuffix("-v1"), fontsize=9)
        axis.set_ylim(0, 100)
        axis.grid(alpha=0.3)
    for axis in axes.flat[len(IDS) - columns : len(IDS)]:
        axis.set_xlabel("steps (thousands)")
        axis.tick_params(labelbottom=True)
    for axis in axes[:, 0]:
        axis.set_ylabel("arrived (%)")
    figure.tight_layout()
    # In the space of the unused axes.
    lines, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(lines, names, loc="lower right", bbox_to_anchor=(0.9, 0.12))
    figure.savefig(out, dpi=110)


def main() -> None:
    """Train what is missing, draw and report."""
    options = arguments(
        __doc__,
        folder=option(CURVES, "where curves are kept"),
        steps=500000,
        seed=1,
        picture=option(None, "draw the curves into this PNG", type=Path),
    )
    rows = []
    for kind, train in KINDS.items():
        folder = options.folder / kind
        folder.mkdir(parents=True, exist_ok=True)
        for name in IDS if kind == "one file" else IDS[: len(SUITES)]:
            if not (folder / f"{name}.csv").is_file():
                train(name, options.steps, options.seed, folder)
            _, arrived, seconds = read_curve(folder / f"{name}.csv")
            ends = ends_of(folder / f"{name}.log")
            shares = [
                f"{100.0 * ends.get(end, 0) / ends['episodes']:.0f}"
                for end in ("arrived", "missed", "collided", "timeout")
            ]
            rows.append((name, kind, f"{100.0 * arrived[-1]:.0f}", *shares, f"{seconds:.0f}"))
            print(*rows[-1], flush=True)
    if options.picture is not None:
        draw(options.folder, options.picture)
    header = (
        "id", "code", "in training (%)", "arrived (%)", "missed (%)", "collided (%)", "timeout (%)",
        "seconds",
    )  # fmt: skip
    body = (
        f"{options.steps} steps of 64 robots, one seed, default arguments. *In training* is the "
        f"share of the last {WINDOW} steps' episodes, with exploration; the rest without, on "
        f"{EACH * ENVS} episodes in buildings that it has not seen.\n\n{table(header, rows, 2)}"
    )
    report("Learning curves of plain PPO", LIBRARIES, body, options.out)


if __name__ == "__main__":
    main()
