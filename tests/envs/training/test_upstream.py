"""Why some of our code stands beside that of Stable-Baselines3 and Gymnasium; docs/training.md.

Each test pins what theirs does otherwise. Where one fails after an upgrade, ours may go.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from gymnasium.wrappers import vector as many
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, CheckpointCallback
from stable_baselines3.common.logger import CSVOutputFormat
from stable_baselines3.common.vec_env import VecNormalize

from ambinav_envs.sb3 import make_sb3
from ambinav_envs.training.curriculum import RECENT
from ambinav_envs.training.models import load_model, make_model
from ambinav_envs.training.vec import TrainingEnvs
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import room
from tests.envs.training.cases import tiny

SMALL: dict[str, Any] = {"map": room(), "longest": 8.0, "max_steps": 10, "window": False}


def small() -> Any:
    return make_sb3("ambinav/Navigation-v1", 2, seed=1, **SMALL)


def model(envs: Any) -> PPO:
    return PPO("MultiInputPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, device="cpu")


def test_gymnasium_refuses_the_mode_that_stable_baselines_needs() -> None:
    envs = NavigationVectorEnv(2, autoreset_mode="SameStep", **SMALL)
    with pytest.raises(ValueError, match="NEXT_STEP or DISABLED"):
        many.FilterObservation(envs, ["goal"])
    assert not hasattr(many, "FrameStackObservation")


def test_what_remains_is_counted_by_calls_of_learn() -> None:
    """So that a rate cannot fall over many of them, or over minutes."""
    learner = model(small())
    for _ in range(3):
        learner.learn(16, reset_num_timesteps=False)
        assert learner._current_progress_remaining == 0.0


def test_a_csv_logger_drops_what_a_table_held(tmp_path: Path) -> None:
    path = tmp_path / "progress.csv"
    path.write_text("steps\n1\n")
    CSVOutputFormat(str(path)).close()
    assert path.read_text() == ""


def test_a_checkpoint_callback_keeps_neither_environments_nor_random_numbers(
    tmp_path: Path,
) -> None:
    callback = CheckpointCallback(4, str(tmp_path), save_replay_buffer=True, save_vecnormalize=True)
    model(VecNormalize(small())).learn(16, callback)
    kinds = {path.name.split("_")[2] for path in tmp_path.iterdir()}
    assert kinds == {"8", "16", "vecnormalize"}


def test_a_pickled_normalisation_forgets_the_returns_so_far() -> None:
    envs = VecNormalize(small())
    envs.reset()
    envs.step(np.zeros((2, 2), dtype=np.float32))
    assert "returns" in vars(envs) and "returns" not in envs.__getstate__()


@pytest.mark.slow
def test_the_window_of_successes_is_that_of_the_curriculum(tmp_path: Path) -> None:
    """What we do lean on: it keeps the last ones of all environments, and goes with the model."""
    config = tiny()
    envs = TrainingEnvs(config)
    learner: Any = make_model(config, envs.outer)
    outcomes: list[bool] = []

    class Watch(BaseCallback):
        def _on_step(self) -> bool:
            ended = np.flatnonzero(self.locals["dones"])
            outcomes.extend(
                self.locals["infos"][i]["episode"]["outcome"] == "arrived" for i in ended
            )
            return True

    for _ in range(3):
        learner.learn(512, Watch(), reset_num_timesteps=False)
    assert isinstance(learner.ep_success_buffer, deque)
    assert learner.ep_success_buffer.maxlen == RECENT
    assert list(learner.ep_success_buffer) == outcomes[-RECENT:] and outcomes
    learner.save(tmp_path / "model.zip")
    again: Any = load_model(config, envs.outer, tmp_path / "model.zip")
    assert again.ep_success_buffer == learner.ep_success_buffer
    assert again.ep_success_buffer.maxlen == RECENT
    envs.close()
