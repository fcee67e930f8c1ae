"""Checkpoints: all state that a training needs to continue as if it had never stopped."""

from __future__ import annotations

import json
import pickle
import random
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import holding_interrupts, replacing
from ambinav_envs.training.config import Training
from ambinav_envs.training.models import load_model
from ambinav_envs.training.vec import TrainingEnvs

MODEL: Final = "model.zip"
MEMORY: Final = "memory.pkl"
COUNTERS: Final = "counters.json"
REPLAY: Final = "replay.pkl"


@dataclass(frozen=True)
class Restored:
    """The content of a checkpoint.

    Attributes:
        envs: The environments in their saved state.
        model: With its optimizer.
        counters: The counters given to `save_checkpoint`.
    """

    envs: TrainingEnvs
    model: Any
    counters: dict[str, Any]


def save_checkpoint(
    path: Path, model: Any, envs: TrainingEnvs, counters: Mapping[str, Any]
) -> None:
    """Write a checkpoint, which is a folder, atomically.

    Between two calls of `learn`: what an algorithm collects in the middle of one is lost.

    Args:
        path: The folder.
        model: The model in training.
        envs: The training environments.
        counters: Plain values to be given back.
    """
    memory = {
        "envs": envs.state(),
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),
        "actions": model.action_space,
        "lstm": getattr(model, "_last_lstm_states", None),
    }
    with replacing(path) as fresh:
        fresh.mkdir()
        # Of an interrupt in the middle of it torch makes an error about the file's positions.
        with holding_interrupts():
            model.save(fresh / MODEL)
        (fresh / MEMORY).write_bytes(pickle.dumps(memory, protocol=pickle.HIGHEST_PROTOCOL))
        if getattr(model, "replay_buffer", None) is not None:
            model.save_replay_buffer(fresh / REPLAY)
        (fresh / COUNTERS).write_text(json.dumps(counters, indent=2) + "\n", encoding="utf-8")


def load_checkpoint(path: Path, config: Training) -> Restored:
    """Restore the state of a checkpoint, the random numbers of the process included.

    It holds pickled objects: load what you trust alone.

    Raises:
        InputError: it is damaged or lacks what the algorithm remembers, or a package is missing.
    """
    try:
        counters = json.loads((path / COUNTERS).read_text(encoding="utf-8"))
        memory = pickle.loads((path / MEMORY).read_bytes())
        envs = TrainingEnvs(config, memory["envs"])
        model: Any = load_model(config, envs.outer, path / MODEL)
        if hasattr(model, "replay_buffer"):
            # Without it a model would learn only from new steps.
            model.load_replay_buffer(path / REPLAY)
        model.action_space = memory["actions"]
        if memory["lstm"] is not None:
            model._last_lstm_states = memory["lstm"]
        python, numpy, torch_state = memory["random"]
    except (InputError, MemoryError, PermissionError):
        # No damage: the message says what to do.
        raise
    except Exception as error:
        # What is inside was pickled, and may fail in any way.
        message = " ".join(str(error).split())[:200]
        raise InputError(
            f"{path}: the checkpoint is damaged ({type(error).__name__}: {message}); "
            f"{_remedy(path, config)}."
        ) from error
    random.setstate(python)
    np.random.set_state(numpy)
    torch.set_rng_state(torch_state)
    return Restored(envs, model, counters)


def _remedy(path: Path, config: Training) -> str:
    """Return advice on how to go on without this checkpoint."""
    needed = [MODEL, MEMORY, COUNTERS, *([REPLAY] if config.algorithm == "sac" else [])]
    for candidate in reversed(checkpoints(path.parent)):
        if candidate != path and all((candidate / name).is_file() for name in needed):
            return f"remove this folder to resume from the one of step {int(candidate.name):,}"
    return "there is no other one to resume from, so train anew, without --resume, in a new folder"


def checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints in a folder, the latest one last."""
    return sorted(path for path in folder.glob("[0-9]*") if path.is_dir())


def keep_latest(folder: Path, count: int) -> None:
    """Remove all but the latest `count` checkpoints, and all but the latest replay buffer."""
    saved = checkpoints(folder)
    for path in saved[:-count]:
        shutil.rmtree(path, ignore_errors=True)
    for path in saved[-count:-1]:
        (path / REPLAY).unlink(missing_ok=True)
