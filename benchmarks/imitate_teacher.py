"""Train the network that corrects VFH+ to imitate a teacher who knows the localization error.

The teacher drives at the pace of `policies.corrected`, slower the larger the error of the estimate,
and faster where it is small; when its time runs out it no longer slows down. The network does not
see the error; it learns to tell it from scan, window, uncertainty and motion, by regression, in
the environments of `configs/corrected-vfh.yaml`. The teacher drives first; then the network does,
and is told what the teacher would have done (DAgger: Ross, Gordon and Bagnell 2011).

    python benchmarks/imitate_teacher.py --out out/corrected-vfh.zip
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from harness import ROOT, arguments
from numpy.typing import NDArray

from ambinav.geometry.frames import wrap_angles
from ambinav_envs.policies import save_policy
from ambinav_envs.policies.corrected import FASTER, MOTION
from ambinav_envs.training.config_file import load_training_config
from ambinav_envs.training.models import make_model
from ambinav_envs.training.vec import TrainingEnvs

CONFIG: Final = ROOT / "configs" / "corrected-vfh.yaml"
MOST: Final = 1.6
LEAST: Final = 0.25
"""What the teacher multiplies the pace with: without an error, and at most so little with one."""
METRES: Final = 0.1
RADIANS: Final = 0.08
"""Each of these errors takes 1 off."""
PATIENT: Final = (0.45, 0.8)
"""From the first to the second share of the time the teacher ceases to slow down."""
BATCH: Final = 1024

Floats = NDArray[np.float32]


def wanted(envs: TrainingEnvs, gone: Floats) -> Floats:
    """Return the teacher's corrections, shape (N, 2), for shares of the time, shape (N,)."""
    state = envs.simulation.state
    off = state["mean"] - state["truth"]
    turned = np.abs(wrap_angles(off[:, 2]))
    error = np.maximum(np.hypot(off[:, 0], off[:, 1]) / METRES, turned / RADIANS)
    speed = np.log(np.clip(MOST - error, LEAST, MOST)) / np.log(FASTER)
    patience = np.clip((PATIENT[1] - gone) / (PATIENT[1] - PATIENT[0]), 0.0, 1.0)
    speed = np.where(speed < 0.0, patience * speed, speed)
    return np.stack([np.zeros_like(speed), speed], axis=1).astype(np.float32)


def collect(
    model: Any, envs: TrainingEnvs, seen: Any, count: int, by_network: bool
) -> tuple[Any, dict[str, NDArray[np.float16]], Floats]:
    """Drive for a number of corrections; return the last observation, and all with targets."""
    parts: dict[str, list[NDArray[np.float16]]] = {name: [] for name in seen}
    targets = []
    for _ in range(count):
        target = wanted(envs, seen[MOTION][:, 2])
        for name, part in seen.items():
            parts[name].append(part.astype(np.float16))
        targets.append(target)
        chosen = model.predict(seen, deterministic=True)[0] if by_network else target
        seen, *_ = envs.outer.step(np.clip(chosen, -1.0, 1.0))
    return (
        seen,
        {name: np.concatenate(part) for name, part in parts.items()},
        np.concatenate(targets),
    )


def fit(
    model: Any, data: dict[str, NDArray[np.float16]], targets: Floats, epochs: int,
    rng: np.random.Generator, rate: float,
) -> float:  # fmt: skip
    """Regress the mean action on the targets; return the explained share of their variance."""
    policy = model.policy
    optimizer = torch.optim.Adam(policy.parameters(), lr=rate)
    losses: list[float] = []
    for _ in range(epochs):
        order, losses = rng.permutation(len(targets)), []
        for first in range(0, len(order) - BATCH + 1, BATCH):
            rows = order[first : first + BATCH]
            batch = {
                name: torch.from_numpy(part[rows].astype(np.float32)) for name, part in data.items()
            }
            mean = policy.get_distribution(batch).distribution.mean
            loss = ((mean - torch.from_numpy(targets[rows])) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(2.0 * float(loss.detach()))
    return 1.0 - float(np.mean(losses)) / float(targets[:, 1].var())


def main() -> None:
    """Collect, fit, collect with the network, fit; write the policy file."""
    chosen = arguments(
        __doc__, rounds=(250, 150, 100), epochs=6, seed=0, out=Path("out/corrected-vfh.zip")
    )
    torch.set_num_threads(1)
    config = load_training_config(CONFIG, seed=chosen.seed)
    envs = TrainingEnvs(config)
    model: Any = make_model(config, envs.outer)
    # Evaluate it by whole episodes.
    environment = {**config.environment, **config.arguments, "end_when_lost": False}
    rng = np.random.default_rng(chosen.seed)
    seen: Any = envs.outer.reset()
    samples: dict[str, NDArray[np.float16]] = {}
    targets = np.empty((0, 2), np.float32)
    for number, count in enumerate(chosen.rounds):
        seen, data, new = collect(model, envs, seen, count, number > 0)
        samples = {
            name: np.concatenate([samples[name], part]) if samples else part
            for name, part in data.items()
        }
        targets = np.concatenate([targets, new])
        explained = fit(model, samples, targets, chosen.epochs, rng, 1e-3 if number == 0 else 5e-4)
        model.num_timesteps = len(targets)
        save_policy(
            model, chosen.out, environment=environment,
            notes={"imitated": "benchmarks/imitate_teacher.py", "explained": explained},
            base=config.base,
        )  # fmt: skip
        print(
            f"{time.strftime('%H:%M:%S')} {len(targets)} corrections, explained {explained:.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
