"""Training of a policy from a configuration, in a folder of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numba
import torch

from ambinav.runtime.errors import InputError
from ambinav_envs.training import folder as files
from ambinav_envs.training.checkpoints import checkpoints
from ambinav_envs.training.config import Training
from ambinav_envs.training.config_file import difference, load_training_config
from ambinav_envs.training.progress import read_rows
from ambinav_envs.training.run import Run, StatusCallback


def train(
    config: Training,
    folder: Path,
    *,
    resume: bool = False,
    command: Sequence[str] = (),
    callback: StatusCallback | None = None,
) -> dict[str, Any]:
    """Train a policy, and write all results to a folder.

    Ctrl-C and termination take effect between two rounds: a checkpoint is written and the exception
    is raised again.

    Args:
        config: Configuration, from `load_training_config` or `parse_config`.
        folder: Output folder; docs/training.md describes its content.
        resume: Continue from the latest checkpoint there.
        command: Command by which it was called, for the record.
        callback: Called after every round.

    Returns:
        Figures of the training as plain values.

    Raises:
        InputError: there is a training in the folder (or none, to resume), its configuration is
            another, a checkpoint is damaged, or an argument cannot be used.
    """
    check_folder(config, folder, resume)
    threads = torch.get_num_threads(), numba.get_num_threads()
    assert config.threads is not None
    torch.set_num_threads(config.threads)
    numba.set_num_threads(config.threads)
    try:
        with files.FOLDER.hold(folder):
            run = Run(config, folder, resume, command, callback or (lambda status: None))
            return run.go()
    finally:
        torch.set_num_threads(threads[0])
        numba.set_num_threads(threads[1])


def check_folder(config: Training, folder: Path, resume: bool) -> None:
    """Check that a training can begin or resume in a folder.

    Raises:
        InputError: it cannot; one sentence says why.
    """
    written = folder / files.CONFIG
    if not resume:
        if written.is_file():
            raise InputError(
                f"{folder}: a training is there already; add --resume to go on with it, or choose "
                "another output."
            )
        files.FOLDER.check(folder)
        return
    if not written.is_file():
        raise InputError(f"{folder}: no training is there to be resumed; leave out --resume.")
    changed = difference(config, load_training_config(written))
    if changed is not None:
        raise InputError(
            f"{folder}: the configuration has changed: {changed}; put it back to resume, or choose "
            "another output."
        )
    # Steps were made, but their results are lost.
    table = folder / files.PROGRESS
    if not checkpoints(folder / files.CHECKPOINTS) and table.is_file() and read_rows(table):
        raise InputError(
            f"{folder}: no checkpoint is left to resume from; train anew, without --resume, in a "
            "new folder."
        )
