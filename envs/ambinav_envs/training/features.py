"""Layers that process an observation before the shared layers of a policy's network."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from ambinav.config import nearest
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

LAYERS: Final = ("conv", "dense")
"""Kinds of layers for the scan and for the window.

Convolutions have few weights and find the same shape anywhere: wide ones, which go on in large
steps, since two narrow layers take several times as long. One dense layer is faster still.
"""

# Beams under a convolution, which goes on by half of them; cells along the edge of one of the
# window, which goes on by all.
_BEAMS: Final = 6
_CELLS: Final = 4
# Beams of a scanner that looks all around leave no gap larger than this many mean ones.
_GAP: Final = 1.5


class NavigationFeatures(BaseFeaturesExtractor):
    """Layers for an observation's scan and window; other parts pass unchanged.

    Works for any of the parts that `ambinav_envs.spaces.observation_space` lists; an observation of
    one row goes through as it is.

    Args:
        observation_space: A Dict of rows, or a row.
        scan: Kind of layers for the part `scan`, one of `LAYERS`.
        window: The same for the part `window`.
        scan_features: Number of features of the scan.
        window_features: Number of features of the window.
        circular: Whether the last beam is the first one's neighbour, see `looks_around`.

    Raises:
        InputError: there is no such kind of layers, or too few beams for convolutions.
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        scan: str = "conv",
        window: str = "conv",
        scan_features: int = 64,
        window_features: int = 64,
        circular: bool = True,
    ) -> None:
        single = {"observation": observation_space}
        parts = observation_space.spaces if isinstance(observation_space, spaces.Dict) else single
        sizes = {name: int(np.prod(part.shape or ())) for name, part in parts.items()}
        made = {"scan": scan_features, "window": window_features}
        super().__init__(
            observation_space, sum(made.get(name, size) for name, size in sizes.items())
        )
        self._rows = not isinstance(observation_space, spaces.Dict)
        self.parts = nn.ModuleDict()
        if "scan" in sizes:
            self.parts["scan"] = _scan_layers(scan, sizes["scan"], scan_features, circular)
        if "window" in sizes:
            self.parts["window"] = _window_layers(window, sizes["window"], window_features)
        self._names = tuple(sizes)

    def forward(self, observations: Any) -> torch.Tensor:
        """Return features, shape (N, `features_dim`), of a batch of observations."""
        if self._rows:
            return torch.flatten(observations, 1)
        made = [
            self.parts[name](observations[name]) if name in self.parts else observations[name]
            for name in self._names
        ]
        return torch.cat(made, dim=1)


def looks_around(scanner: RangeScanner) -> bool:
    """Return whether the beams cover a full turn in order, the last beside the first."""
    yaw = np.asarray(scanner.mounts)[:, 2]
    if len(yaw) < 2:
        return False
    turns = np.remainder(np.diff(np.append(yaw, yaw[0])), 2.0 * math.pi)
    steps = turns if turns.sum() < 2.0 * math.pi * 1.5 else 2.0 * math.pi - turns
    once = math.isclose(float(steps.sum()), 2.0 * math.pi, rel_tol=1e-6)
    return bool(once and steps.max() <= _GAP * steps.mean())


def check_layers(kind: str, where: str) -> str:
    """Return the kind of layers, checked to be one of `LAYERS`.

    Raises:
        InputError: it is none.
    """
    if kind not in LAYERS:
        raise InputError(f"{where}: {kind!r} is unknown; {nearest(str(kind), LAYERS)}.")
    return kind


def _scan_layers(kind: str, beams: int, features: int, circular: bool) -> nn.Sequential:
    if check_layers(kind, "scan") == "dense":
        return _dense(beams, features)
    if beams < _BEAMS:
        raise InputError(
            f"scan: convolutions need {_BEAMS} beams and there are {beams}; choose dense."
        )
    step = _BEAMS // 2
    # So that the convolution covers the last beams too.
    padding = -beams % step
    layers = nn.Sequential(
        nn.Unflatten(1, (1, beams)),
        nn.CircularPad1d((0, step + padding)) if circular else nn.ZeroPad1d((0, padding)),
        nn.Conv1d(1, 16, _BEAMS, stride=step),
        nn.ReLU(),
        nn.Flatten(),
    )
    return _with_dense_layer(layers, beams, features)


def _window_layers(kind: str, size: int, features: int) -> nn.Sequential:
    if check_layers(kind, "window") == "dense":
        return _dense(size, features)
    cells = math.isqrt(size // 2)
    padding = -cells % _CELLS
    layers = nn.Sequential(
        nn.Unflatten(1, (2, cells, cells)),
        nn.ZeroPad2d((0, padding, 0, padding)),
        nn.Conv2d(2, 16, _CELLS, stride=_CELLS),
        nn.ReLU(),
        nn.Flatten(),
    )
    return _with_dense_layer(layers, size, features)


def _dense(size: int, features: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(size, features), nn.ReLU())


def _with_dense_layer(layers: nn.Sequential, size: int, features: int) -> nn.Sequential:
    """Append a dense layer to the layers, and return them."""
    with torch.no_grad():
        width = layers(torch.zeros(1, size)).shape[1]
    return layers.extend(_dense(width, features))
