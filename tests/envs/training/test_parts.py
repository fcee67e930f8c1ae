"""Curriculum, figures of episodes, schedules, the table and the picture of progress."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav_envs.evaluation import Episodes
from ambinav_envs.simulation.layout import OUTCOMES
from ambinav_envs.training.config import StagePart
from ambinav_envs.training.progress import COLUMNS, Progress

pytest.importorskip("stable_baselines3")

from ambinav_envs.training.curriculum import RECENT, Curriculum
from ambinav_envs.training.curve import plot_curve
from ambinav_envs.training.episode_stats import figures_of, figures_of_evaluation
from ambinav_envs.training.schedules import LinearSchedule
from ambinav_envs.training.vec import TrainingEnvs
from tests.envs.training.cases import tiny

EPISODES: list[dict[str, Any]] = [
    {"r": 4.0, "outcome": "arrived", "was_lost": False, "exposure": 1.0, "travelled": 4.0,
     "shortest": 2.0},
    {"r": -2.0, "outcome": "collided", "was_lost": True, "exposure": 3.0, "travelled": 4.0,
     "shortest": 8.0},
]  # fmt: skip


def test_figures_of_training_and_evaluation_mean_the_same() -> None:
    known = {name: np.array([one[name] for one in EPISODES]) for name in EPISODES[0]}
    nothing = np.zeros(2)
    codes = np.array([OUTCOMES.index(name) for name in known.pop("outcome")])
    rewards = known.pop("r")
    names = ("error_max", "error_mean", "seconds", "cost", "lost_at_end", "lost_seconds")
    others = dict.fromkeys(names, nothing)
    keys, seeds = np.array(["a", "b"]), np.arange(2)
    both = Episodes(
        outcome=codes, reward=rewards, building=keys, seed=seeds, **known, **others
    )  # fmt: skip
    wanted = {
        "episodes": 2.0, "arrived": 0.5, "missed": 0.0, "collided": 0.5, "timeout": 0.0,
        "lost": 0.5, "length": 2.0, "exposure": 0.5, "reward": 1.0,
    }  # fmt: skip
    assert figures_of(EPISODES) == pytest.approx(wanted)
    assert figures_of_evaluation(both) == pytest.approx(wanted)


def test_figures_of_nothing() -> None:
    figures = figures_of([])
    assert figures["episodes"] == 0.0 and math.isnan(figures["arrived"])
    assert math.isnan(figures_of(EPISODES[1:])["length"])


@pytest.mark.slow
def test_the_curriculum_reaches_the_simulation() -> None:
    envs = TrainingEnvs(tiny())
    stages = Curriculum([StagePart(longest=3.0, share=0.5), StagePart(longest=5.0, arrival=0.9)])
    lengths = []
    for share, arrived in ((0.0, []), (0.5, []), (0.6, [True] * RECENT)):
        stages.advance(share, arrived)
        longest = stages.apply(envs.simulation, 8.0)
        envs.outer.reset()
        drawn = envs.simulation.state["shortest"]
        assert drawn.max() <= longest and drawn.min() >= 2.0
        lengths.append(float(drawn.max()))
    assert stages.number == 2 and not stages.advance(1.0, [True] * RECENT)
    assert lengths[1] > 3.0 or lengths[2] > 3.0
    envs.close()


def test_a_stage_ends_by_share_or_by_arrival() -> None:
    stages = Curriculum([StagePart(longest=3.0, share=0.5, arrival=0.9)])
    assert not stages.advance(0.4, [True] * (RECENT - 1))
    assert not stages.advance(0.4, [False] * RECENT + [True] * (RECENT // 2))
    assert stages.advance(0.4, [False] * RECENT + [True] * RECENT)
    assert Curriculum(stages.stages).advance(0.5, [])


def test_falling() -> None:
    rate = LinearSchedule(1.0, 0.5)
    assert rate(0.3) == 1.0
    rate.share = 0.5
    assert rate(0.3) == 0.75
    rate.share = 2.0
    assert rate(1.0) == 0.5


def row(steps: float, arrived: float) -> dict[str, float | None]:
    figures = {"episodes": 10.0, "arrived": arrived, "collided": 1.0 - arrived}
    both = {f"{kind}_{key}": value for kind in ("train", "eval") for key, value in figures.items()}
    return {"steps": steps, "seconds": steps / 1e3, "longest": 3.0 + (steps > 2000), **both}


def test_the_table_goes_on_from_a_checkpoint(tmp_path: Path) -> None:
    table = Progress(tmp_path / "progress.csv")
    for steps in (1000.0, 2000.0, 3000.0):
        table.add(row(steps, steps / 4000.0) | {"eval_length": math.nan})
    again = Progress(tmp_path / "progress.csv", 2000.0)
    assert [one["steps"] for one in again.rows] == [1000.0, 2000.0]
    assert again.rows[0].keys() == set(COLUMNS)
    assert again.rows[1]["eval_arrived"] == 0.5 and again.rows[1]["eval_length"] is None
    assert (tmp_path / "progress.csv").read_text().count("\n") == 3


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 1, 5])
def test_the_picture(tmp_path: Path, count: int) -> None:
    table = Progress(tmp_path / "progress.csv")
    for k in range(count):
        table.add(row(1000.0 * k, k / 10.0))
    plot_curve(table.rows, tmp_path / "curve.png")
    assert (tmp_path / "curve.png").read_bytes()[1:4] == b"PNG"
