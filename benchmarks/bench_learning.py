"""Learning curves of Stable-Baselines3's PPO, with nothing of ambinav but an id.

Algorithm, network and all settings are its defaults, the environment's are those of the id. Each
seed trains for some minutes, and is judged without exploration in buildings that it has not seen,
by the first episodes of each robot. Seeds that are in the folder already are not trained again.
"""

from __future__ import annotations

import csv
import time
from pathlib import Path
from typing import Final

import numpy as np
from harness import ROOT, arguments, option, report, table

from ambinav.drive.bootstrap import share

LIBRARIES = ("ambinav", "stable_baselines3", "torch", "numpy", "numba")
CURVES: Final = ROOT / "benchmarks" / "results" / "learning"
ENVS, UNSEEN, EACH = 64, 1_000_000, 3
ENDS = ("arrived", "missed", "collided", "timeout")


def train(name: str, seed: int, minutes: float, threads: int, window: bool, file: Path) -> None:
    """Train and judge one seed; write its curve, and in the last row how judged episodes ended."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback

    from ambinav_envs.sb3 import make_sb3

    torch.set_num_threads(threads)
    rows: list[tuple[int, int, float, float]] = []

    class Count(BaseCallback):
        """Counts how many of a rollout's episodes have arrived, and ends the training in time."""

        def _on_rollout_start(self) -> None:
            self.ends: list[bool] = []

        def _on_step(self) -> bool:
            for info, done in zip(self.locals["infos"], self.locals["dones"], strict=True):
                if done:
                    self.ends.append(info["is_success"])
            return time.perf_counter() - began < 60.0 * minutes

        def _on_rollout_end(self) -> None:
            arrived = float(np.mean(self.ends)) if self.ends else 0.0
            seconds = time.perf_counter() - began
            rows.append((self.num_timesteps, len(self.ends), arrived, seconds))

    began = time.perf_counter()
    model = PPO("MultiInputPolicy", make_sb3(name, seed=seed, window=window), seed=seed)
    model.learn(10**9, callback=Count())
    envs = make_sb3(name, ENVS, seed=0, first_building=UNSEEN, window=window)
    seen, ended, how = envs.reset(), np.zeros(ENVS, dtype=int), []
    while (ended < EACH).any():
        seen, _, done, infos = envs.step(model.predict(seen, deterministic=True)[0])
        how += [infos[i]["outcome"] for i in np.flatnonzero(done & (ended < EACH))]
        ended += done
    with file.open("w", encoding="utf-8") as out:
        csv.writer(out).writerows(
            [("steps", "episodes", "arrived", "seconds"), *rows, [how.count(end) for end in ENDS]]
        )


def draw(curves: list[np.ndarray], name: str, out: Path) -> None:
    """Plot the share of arrivals in training over time, a curve a seed, and their median."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.4, 3.6))
    for curve in curves:
        axis.plot(curve[:, 3] / 60.0, 100.0 * curve[:, 2], color="#56b4e9", linewidth=1)
    axis.plot([], [], color="#56b4e9", linewidth=1, label="one seed")
    last = min(curve[-1, 3] for curve in curves)
    times = np.linspace(max(curve[0, 3] for curve in curves), last, 100)
    each = [np.interp(times, curve[:, 3], curve[:, 2]) for curve in curves]
    axis.plot(
        times / 60.0, 100.0 * np.median(each, axis=0), color="#0072b2", linewidth=2,
        label=f"median of {len(curves)}",
    )  # fmt: skip
    axis.axhline(90.0, color="#d55e00", linestyle="--", linewidth=1)
    axis.text(0.1, 91.0, "90 %", color="#d55e00", fontsize=9)
    axis.set(xlabel="training time (min)", ylabel="arrived (%)", ylim=(0, 100), title=name)
    axis.set_xlim(left=0)
    axis.grid(alpha=0.3)
    axis.legend(loc="lower right")
    figure.tight_layout()
    figure.savefig(out, dpi=110)


def main() -> None:
    """Train what is missing, draw and report."""
    options = arguments(
        __doc__,
        id="ambinav/Procedural-v1",
        folder=option(CURVES, "where curves are kept"),
        seeds=5,
        first=option(1, "the first seed"),
        minutes=10.0,
        threads=option(2, "of torch; NUMBA_NUM_THREADS has those of the environments"),
        window=option(
            False, "observe the window of the map too, 512 more numbers", action="store_true"
        ),
        picture=option(None, "draw the curves into this PNG", type=Path),
    )
    name = options.id.rpartition("/")[2]
    options.folder.mkdir(parents=True, exist_ok=True)
    rows, curves, judged = [], [], []
    for seed in range(options.first, options.first + options.seeds):
        file = options.folder / f"{name}-{seed}.csv"
        if not file.is_file():
            train(options.id, seed, options.minutes, options.threads, options.window, file)
        *lines, ends = file.read_text(encoding="utf-8").splitlines()[1:]
        curve = np.array([[float(number) for number in line.split(",")] for line in lines])
        counts = np.array([int(number) for number in ends.split(",")])
        curves.append(curve)
        judged.append(counts)
        good = curve[:, 2] >= 0.9
        reached = f"{curve[good.argmax(), 3] / 60.0:.1f}" if good.any() else "not"
        shares = [f"{100.0 * count / counts.sum():.0f}" for count in counts]
        rows.append(
            (str(seed), f"{curve[-1, 0]:.0f}", f"{100.0 * curve[-1, 2]:.0f}", reached, *shares)
        )
        print(*rows[-1], flush=True)
    if options.picture is not None:
        draw(curves, name, options.picture)
    header = (
        "seed", "steps", "in training (%)", "90 % in training after (min)",
        *(f"{end} (%)" for end in ENDS),
    )  # fmt: skip
    arrived = [np.arange(counts.sum()) < counts[0] for counts in judged]
    group = np.repeat(np.arange(len(judged)), [len(each) for each in arrived])
    total = share(np.concatenate(arrived), group=group).scaled(100.0)
    body = (
        f"`{options.id}`, window={options.window}, {options.minutes:g} minutes a seed. *In "
        "training* is the share of the last round's episodes, with exploration; the ends are "
        f"without, of {EACH * ENVS} episodes a seed in buildings that it has not seen. Over all "
        f"seeds {total.value:.1f} % arrive ({total.low:.1f} to {total.high:.1f}, by seeds).\n\n"
        f"{table(header, rows, 1)}"
    )
    report("Learning curves of plain PPO", LIBRARIES, body, options.out)


if __name__ == "__main__":
    main()
