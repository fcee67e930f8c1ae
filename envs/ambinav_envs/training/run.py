"""The training loop: rounds of learning, and the work between them."""

from __future__ import annotations

import math
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import holding_interrupts
from ambinav_envs.arena import Arena
from ambinav_envs.policies import ModelPolicy, Normalization, Policy, read_card, save_policy
from ambinav_envs.policies.corrected import CorrectedPolicy
from ambinav_envs.scenario import source_of
from ambinav_envs.training import folder as files
from ambinav_envs.training.checkpoints import (
    checkpoints,
    keep_latest,
    load_checkpoint,
    save_checkpoint,
)
from ambinav_envs.training.config import Training
from ambinav_envs.training.config_file import write_config
from ambinav_envs.training.curriculum import RECENT, Curriculum
from ambinav_envs.training.curve import plot_curve
from ambinav_envs.training.episode_stats import EpisodeStatsCallback, Figures, figures_of_evaluation
from ambinav_envs.training.models import make_model, round_steps, schedules
from ambinav_envs.training.progress import Progress
from ambinav_envs.training.report import report_text
from ambinav_envs.training.vec import TrainingEnvs

PREPARED: Final = 1000
"""Number of buildings with maps made before the clock starts; others are made when drawn."""
DIGITS: Final = 12
"""Digits of the steps in a checkpoint's name, so that names sort as numbers."""


@dataclass(frozen=True)
class TrainingStatus:
    """Progress of a training.

    Attributes:
        share: Completed share, 0 to 1.
        steps: Steps so far.
        rate: Steps per second of the last round.
        train: Figures of the last row of training episodes.
        evaluation: Figures of an evaluation just made, else None.
        preparing: While the buildings' maps are made, before the first step.
    """

    share: float
    steps: int
    rate: float
    train: Figures | None
    evaluation: Figures | None
    preparing: bool = False


StatusCallback = Callable[[TrainingStatus], None]


class Run:
    """A running training.

    Args:
        config: Configuration of the training.
        folder: Output folder.
        resume: Whether to go on from the latest checkpoint.
        command: See `train`.
        callback: Likewise.
    """

    def __init__(
        self,
        config: Training,
        folder: Path,
        resume: bool,
        command: Sequence[str],
        callback: StatusCallback,
    ) -> None:
        self.config, self.folder, self._callback = config, folder, callback
        saved = checkpoints(folder / files.CHECKPOINTS) if resume else []
        counters: dict[str, Any] = {}
        self.model: Any
        if saved:
            restored = load_checkpoint(saved[-1], config)
            self.envs, self.model, counters = restored.envs, restored.model, restored.counters
        else:
            self.envs = TrainingEnvs(config)
            self.model = make_model(config, self.envs.outer)
        self._saved = self.model.num_timesteps if saved else -1
        self._before = float(counters.get("seconds", 0.0))
        self._next = dict(counters.get("next", self._periods()))
        best = folder / files.BEST
        # From the file itself, which may be newer than the checkpoint.
        self.best = best_of(best) if resume and best.is_file() else None
        self.episode_stats = EpisodeStatsCallback()
        self.episode_stats.fresh = list(counters.get("fresh", ()))
        if "stage" in counters:
            # A checkpoint from before Stable-Baselines3 stored them.
            self.model.ep_success_buffer = deque(counters["stage"], RECENT)
        self.curriculum = Curriculum(config.curriculum, int(counters.get("stage_number", 0)))
        arguments = config.given | config.judged_apart
        self._judged = Arena.of(config.environment["id"], arguments)
        self._check_evaluation()
        self._longest = source_of(config.arguments)[1].longest
        self._last: Figures | None = None
        self._clock = time.perf_counter()
        self._is_between_rounds = True
        self._begin(command)

    def _check_evaluation(self) -> None:
        """Begin an episode of the training and one of the evaluation, before hours are spent.

        Raises:
            InputError: the policy does not fit, or a building has no room for the task.
        """
        config, seed = self.config, self.config.evaluation.seed
        try:
            Arena.of(config.environment["id"], config.given).check(self._policy, seed)
            try:
                self._judged.check(self._policy, seed)
            except InputError as error:
                raise InputError(f"evaluation.environment: {error}") from error
        except InputError:
            self.envs.close()
            raise

    def _begin(self, command: Sequence[str]) -> None:
        """Write the files that exist before the first round."""
        folder, steps = self.folder, int(self.model.num_timesteps)
        about = folder / files.ABOUT
        record = files.read_json(about) if about.is_file() else files.about(self.config, command)
        session, finished = files.session(steps, command), self.share >= 1.0
        if finished and record["sessions"]:
            # Nothing is left to train: only the files of the end are written.
            session = record["sessions"].pop()
        elif record["sessions"] and record["sessions"][-1].get("code") != session["code"]:
            warnings.warn(
                f"{folder}: the training was begun by other code than what goes on with it now.",
                InputWarning,
                stacklevel=2,
            )
        record["sessions"].append(session)
        self.record = record
        files.write_json(about, record)
        write_config(self.config, folder / files.CONFIG)
        self.progress = Progress(folder / files.PROGRESS, steps)
        outputs: list[KVWriter] = []
        if find_spec("tensorboard") is not None:
            outputs.append(TensorBoardOutputFormat(str(folder / files.TENSORBOARD)))
        self.model.set_logger(Logger(str(folder), outputs))

    def _periods(self) -> dict[str, int]:
        """Return the intervals of the periodic work, steps."""
        config = self.config
        every = {"log": config.log, "evaluation": config.evaluation.every}
        return every | {"checkpoint": config.checkpoints.every}

    @property
    def seconds(self) -> float:
        """Duration so far, earlier sessions included, seconds."""
        return self._before + time.perf_counter() - self._clock

    @property
    def share(self) -> float:
        """Completed share of the training, 0 to 1, by the limit that comes first."""
        config = self.config
        shares: list[float] = []
        if config.steps is not None:
            shares.append(self.model.num_timesteps / config.steps)
        if config.minutes is not None:
            shares.append(self.seconds / (60.0 * config.minutes))
        return min(max(shares), 1.0)

    def go(self) -> dict[str, Any]:
        """Train to the end; see `train`."""
        try:
            self._prepare()
            self._clock = time.perf_counter()
            self._after_round()
            while self.share < 1.0:
                with holding_interrupts():
                    self._is_between_rounds = False
                    rate = self._round()
                    self._is_between_rounds = True
                self._after_round(rate)
            return self._end()
        except BaseException:
            # A second interrupt does not wait for the end of a round, whose beginning is lost.
            if self._is_between_rounds:
                self._checkpoint()
            raise
        finally:
            with holding_interrupts():
                self.model.logger.close()
            self.envs.close()

    def _prepare(self) -> None:
        """Build the maps before training, so that time limits do not depend on which are stored."""
        sources = [self.envs.simulation.source, self._judged.source]
        requests = [
            (source, source.first + k)
            for source in sources
            if source.count is not None and source.count <= PREPARED
            for k in range(source.count)
        ]
        for done, (source, number) in enumerate(requests):
            steps = int(self.model.num_timesteps)
            self._callback(
                TrainingStatus(done / len(requests), steps, math.nan, None, None, preparing=True)
            )
            source.get(number).amap  # noqa: B018 - made when it is asked for

    def _round(self) -> float:
        """Collect steps and learn from them; return steps per second."""
        for simulation in self.envs.simulations:
            self.curriculum.apply(simulation, self._longest)
        for schedule in schedules(self.model):
            schedule.share = self.share
        started, before = time.perf_counter(), int(self.model.num_timesteps)
        self.model.learn(
            round_steps(self.config),
            self.episode_stats,
            # Rounds for the algorithms that have them, for the others episodes.
            log_interval=1 if "n_epochs" in self.config.hyperparameters else 100,
            reset_num_timesteps=False,
        )
        made = int(self.model.num_timesteps) - before
        return made / (time.perf_counter() - started)

    def _after_round(self, rate: float = math.nan) -> None:
        """Do the work that is due after a round or was due at an interruption."""
        steps, share = int(self.model.num_timesteps), self.share
        if self.curriculum.advance(share, self.model.ep_success_buffer or ()):
            self.model.ep_success_buffer.clear()
        judged = None
        if steps >= self._next["evaluation"]:
            judged = self._evaluate()
        if steps >= self._next["log"] or judged is not None:
            self._row(rate, judged)
        if steps >= self._next["checkpoint"]:
            self._schedule_next("checkpoint")
            self._checkpoint()
        self._callback(TrainingStatus(share, steps, rate, self._last, judged))

    def _schedule_next(self, event: str) -> None:
        """Schedule the next time of the periodic work."""
        period = self._periods()[event]
        self._next[event] = (int(self.model.num_timesteps) // period + 1) * period

    def _row(self, rate: float, judged: Figures | None) -> None:
        """Add a row to the table of progress."""
        self._schedule_next("log")
        steps, longest = int(self.model.num_timesteps), self.envs.simulation.parameters.longest
        self._last = self.episode_stats.take()
        row: dict[str, float | None] = {
            "steps": steps, "seconds": round(self.seconds, 2), "steps_per_second": rate,
            "longest": longest,
        }  # fmt: skip
        for kind, figures in (("train", self._last), ("eval", judged)):
            for name, value in (figures or {}).items():
                row[f"{kind}_{name}"] = value
                if math.isfinite(value):
                    self.model.logger.record(f"{kind}/{name}", value)
        self.progress.add(row)
        # TensorBoard's writer is a thread: Ctrl-C within a call that wakes it can leave it asleep,
        # and who closes it waits for its next flush, up to two minutes.
        with holding_interrupts():
            self.model.logger.dump(steps)

    def _evaluate(self) -> Figures:
        """Evaluate the policy on fixed episodes; save it if it is the best."""
        chosen = self.config.evaluation
        episodes = self._judged.evaluate(self._policy, chosen.episodes, chosen.seed)
        figures = figures_of_evaluation(episodes)
        if self.best is None or figures["reward"] > (self.best["reward"] or 0.0):
            self.best = {"steps": float(self.model.num_timesteps), **finite(figures)}
            self._save(files.BEST, figures)
        self._schedule_next("evaluation")
        return figures

    @property
    def _policy(self) -> Policy:
        """The policy as it is evaluated."""
        model, base = ModelPolicy(self.model, self._normalization), self.config.base
        return model if base is None else CorrectedPolicy(model, base)

    @property
    def _normalization(self) -> Normalization | None:
        around = self.envs.normalize
        return None if around is None else Normalization.of(around)

    def _save(self, name: str, figures: Figures | None) -> None:
        """Write a policy file; its content does not depend on the time."""
        save_policy(
            self.model,
            self.folder / name,
            # The suite is given too, for readers who do not resolve the id. A module of the id
            # stays out: nothing that is named in a policy file is imported.
            environment=self.config.environment
            | self.config.arguments
            | {"id": self.config.environment["id"].rpartition(":")[2]},
            normalization=self._normalization,
            base=self.config.base,
            notes={
                "training": self.config.model_dump(mode="json"),
                "trained_in": self.record["buildings"],
                "judged_in": self.record["judged_in"],
                "evaluation": None if figures is None else finite(figures),
            },
        )

    def _checkpoint(self) -> None:
        """Write a checkpoint, unless one of this step exists."""
        steps = int(self.model.num_timesteps)
        if steps == self._saved:
            return
        counters = {
            "steps": steps,
            "seconds": self.seconds,
            "next": self._next,
            "fresh": self.episode_stats.fresh,
            "stage_number": self.curriculum.number,
        }
        folder = self.folder / files.CHECKPOINTS
        save_checkpoint(folder / f"{steps:0{DIGITS}d}", self.model, self.envs, counters)
        keep_latest(folder, self.config.checkpoints.keep)
        self._saved = steps

    def _end(self) -> dict[str, Any]:
        """Write the final files."""
        steps = int(self.model.num_timesteps)
        judged = self.progress.evaluations()
        if not judged or judged[-1]["steps"] != steps or self.best is None:
            figures = self._evaluate()
            self._row(math.nan, figures)
            self._callback(TrainingStatus(1.0, steps, math.nan, self._last, figures))
            judged = self.progress.evaluations()
        last = {
            name.removeprefix("eval_"): value
            for name, value in judged[-1].items()
            if name.startswith("eval_") and value is not None and math.isfinite(value)
        }
        self._save(files.FINAL, last)
        self._checkpoint()
        summary = {
            "folder": str(self.folder),
            "steps": steps,
            "seconds": round(self.seconds, 1),
            "final": last,
            "best": self.best,
            "stage": self.curriculum.number,
        }
        plot_curve(self.progress.rows, self.folder / files.CURVE)
        text = report_text(self.config, self.record, summary)
        (self.folder / files.REPORT).write_text(text, encoding="utf-8")
        return summary


def best_of(path: Path) -> dict[str, float | None]:
    """Return figures and steps of the evaluation whose policy file was kept.

    Raises:
        InputError: the file is damaged.
    """
    card = read_card(path)
    return {"steps": float(card.steps), **card.notes["evaluation"]}


def finite(figures: Figures) -> dict[str, float | None]:
    """Convert figures for JSON: null for nan."""
    return {name: value if math.isfinite(value) else None for name, value in figures.items()}
