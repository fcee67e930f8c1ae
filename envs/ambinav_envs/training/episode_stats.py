"""Statistics of the episodes that end while a policy trains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from ambinav_envs.evaluation import Episodes, per_metre

FIGURES: Final = {
    "episodes": "how many",
    "arrived": "share",
    "missed": "share",
    "collided": "share",
    "timeout": "share",
    "lost": "share of those in which the robot was ever lost",
    "length": "path driven by shortest path, of those that arrived",
    "exposure": "ambiguity per metre driven, of all episodes together",
    "reward": "mean sum of rewards",
}
"""Figures of a number of episodes."""

Episode = Mapping[str, Any]
Figures = dict[str, float]


class EpisodeStatsCallback(BaseCallback):
    """Collects the ended episodes as reported by a `VecMonitor`.

    Attributes:
        fresh: Those since the last `take`; `ep_info_buffer` of Stable-Baselines3 drops some.
    """

    def __init__(self) -> None:
        super().__init__()
        self.fresh: list[Episode] = []

    def _on_step(self) -> bool:
        for i in np.flatnonzero(self.locals["dones"]):
            figures = self.locals["infos"][i]["episode"]
            self.fresh.append({key: _plain(figures[key]) for key in KEPT})
        return True

    def take(self) -> Figures:
        """Return the figures of the episodes since the last call."""
        made, self.fresh = figures_of(self.fresh), []
        return made


KEPT: Final = ("r", "outcome", "was_lost", "exposure", "travelled", "shortest")


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def figures_of(episodes: Sequence[Episode]) -> Figures:
    """Return figures of episodes as reported by a `VecMonitor`; nan where there are none."""
    count = len(episodes)
    if not count:
        return {"episodes": 0.0} | {name: math.nan for name in FIGURES if name != "episodes"}
    outcomes = [episode["outcome"] for episode in episodes]
    arrived = [episode for episode in episodes if episode["outcome"] == "arrived"]
    ratios = [e["travelled"] / e["shortest"] for e in arrived if e["shortest"] > 0.0]
    shares = ("arrived", "missed", "collided", "timeout")
    return {
        "episodes": float(count),
        **{name: outcomes.count(name) / count for name in shares},
        "lost": sum(episode["was_lost"] for episode in episodes) / count,
        "length": sum(ratios) / len(ratios) if ratios else math.nan,
        "exposure": per_metre(
            *([episode[key] for episode in episodes] for key in ("exposure", "travelled"))
        ),
        "reward": sum(episode["r"] for episode in episodes) / count,
    }


def figures_of_evaluation(episodes: Episodes) -> Figures:
    """Return the same figures of an evaluation."""
    summary = episodes.summary()
    renamed = {"lost": "was_lost", "length": "length_ratio", "exposure": "exposure_per_metre"}
    return {name: float(summary[renamed.get(name, name)]) for name in FIGURES}
