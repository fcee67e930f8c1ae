"""Milliseconds of the first layers of a policy's network, forward and backward.

Beside those of `ambinav_envs.training.features` stand the two narrow convolutions that one writes
first, of 8 and 16 channels and 3 beams or 3 x 3 cells each.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from gymnasium import spaces
from harness import add_out, interleave, report, spread, table
from torch import nn

from ambinav_envs.training.features import NavigationFeatures

LIBRARIES = ("ambinav", "torch", "stable-baselines3")
BEAMS, CELLS, FEATURES, WIDTH = 60, 16, 64, 128


def main() -> None:
    """Time each layer in turn."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--observations", type=int, default=2048, help="in one batch")
    parser.add_argument("--repeats", type=int, default=15)
    add_out(parser)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    generator = np.random.default_rng(0)
    runs: dict[str, Callable[[], object]] = {}
    for name, (layers, size) in contestants().items():
        rows = torch.from_numpy(generator.random((args.observations, size), dtype=np.float32))
        runs[name] = partial(forward_and_back, layers, rows)
    rows_of = [
        (name, spread([1e3 * second for second in timing.seconds], 1))
        for name, timing in interleave(runs, args.repeats).items()
    ]
    title = f"Layers of a policy, {args.observations} observations forward and back on one thread"
    report(title, LIBRARIES, table(("layers", "ms"), rows_of), args.out)


def contestants() -> dict[str, tuple[nn.Module, int]]:
    """Return the layers by name, and how many numbers they take."""
    scan, window = spaces.Box(0.0, 1.0, (BEAMS,)), spaces.Box(0.0, 1.0, (2 * CELLS**2,))
    by_name: dict[str, tuple[nn.Module, int]] = {}
    for kind in ("conv", "dense"):
        features = NavigationFeatures(
            spaces.Dict({"scan": scan, "window": window}), scan=kind, window=kind,
            scan_features=FEATURES, window_features=FEATURES,
        )  # fmt: skip
        by_name[f"scan, {kind}"] = features.parts["scan"], BEAMS
        by_name[f"window, {kind}"] = features.parts["window"], 2 * CELLS**2
    by_name["scan, two narrow convolutions"] = narrow(BEAMS), BEAMS
    by_name["window, two narrow convolutions"] = narrow(2 * CELLS**2, plane=True), 2 * CELLS**2
    by_name[f"two layers of {WIDTH} after them"] = (
        nn.Sequential(
            nn.Linear(2 * FEATURES, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh()
        ),
        2 * FEATURES,
    )
    return dict(sorted(by_name.items(), key=lambda item: item[0].partition(",")[0]))


def narrow(size: int, plane: bool = False) -> nn.Module:
    """Return two convolutions of small kernels, with strides of one and two, and a dense layer."""
    if plane:
        start: nn.Module = nn.Unflatten(1, (2, CELLS, CELLS))
        layer: nn.Module = nn.Conv2d(2, 8, 3, padding=1)
        two: nn.Module = nn.Conv2d(8, 16, 3, stride=2, padding=1)
    else:
        start = nn.Unflatten(1, (1, BEAMS))
        layer = nn.Conv1d(1, 8, 3, padding=1)
        two = nn.Conv1d(8, 16, 3, stride=2, padding=1)
    layers = nn.Sequential(start, layer, nn.ReLU(), two, nn.ReLU(), nn.Flatten())
    width = layers(torch.zeros(1, size)).shape[1]
    return layers.extend([nn.Linear(width, FEATURES), nn.ReLU()])


def forward_and_back(layers: nn.Module, rows: torch.Tensor) -> None:
    """Run the layers forward and backward, as gradient descent does."""
    layers.zero_grad()
    layers(rows).sum().backward()


if __name__ == "__main__":
    main()
