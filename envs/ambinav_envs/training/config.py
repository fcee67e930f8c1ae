"""The configuration of a training, as a file gives it."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from ambinav.config import ConfigModel
from ambinav.runtime.errors import InputError
from ambinav_envs.registered import arguments_of_id
from ambinav_envs.registration import spec_of
from ambinav_envs.training.hyperparameters import hyperparameters_of

Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(gt=0.0, le=1.0)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]

MANAGED: Final = {
    "num_envs": "envs tells that",
    "render_mode": "training shows nothing",
    "render_view": "training shows nothing",
    "autoreset_mode": "Stable-Baselines3 needs SameStep",
    "vectorization_mode": "training has its own",
}
"""Arguments of environments that a configuration cannot give, and why."""
DRAWN_APART: Final[dict[str, Any]] = {"first_building": 500_000, "buildings": 100}
"""Buildings that policies are judged in while they train, unless the configuration says others."""


class EvaluationPart(ConfigModel):
    """Evaluation of the policy during the training.

    Attributes:
        environment: Arguments that differ from those of training. In any case buildings of a suite
            are others (`DRAWN_APART`) where it does not say which; a map is the same.
        episodes: How many, the same every time.
        every: Steps of training from one evaluation to the next; there is one at the end too.
        seed: Seed of the episodes.
    """

    environment: dict[str, Any] | None = None
    episodes: Count = 200
    every: Count = 250_000
    seed: Seed = 0


class NormalizePart(ConfigModel):
    """Normalisation to variance 1 by running statistics, as by `VecNormalize`."""

    observations: bool = False
    reward: bool = True


class PolicyPart(ConfigModel):
    """The network.

    Attributes:
        net_arch: Widths of the layers after the features, for the actor and for the critic.
        scan: Kind of layers for the scan, see `features.LAYERS`.
        window: The same for the window.
        scan_features: Numbers that are made of the scan.
        window_features: Numbers that are made of the window.
        log_std_init: Logarithm of the actions' first deviation (continuous actions, not sac).
        lstm_hidden_size: Width of the memory (recurrent-ppo).
    """

    net_arch: tuple[Count, ...] = (128, 128)
    scan: Literal["conv", "dense"] = "conv"
    window: Literal["conv", "dense"] = "conv"
    scan_features: Count = 64
    window_features: Count = 64
    log_std_init: float = -0.5
    lstm_hidden_size: Count = 128


class StagePart(ConfigModel):
    """A stage of the curriculum, which ends at a share of the training or at a rate of arrival.

    Attributes:
        longest: Greatest length of the shortest path from start to goal in this stage, metres.
        share: Share of the whole training at which it ends.
        arrival: Share of training episodes that arrive at which it ends.
    """

    longest: Annotated[float, Field(gt=0.0)]
    share: Share | None = None
    arrival: Share | None = None

    @model_validator(mode="after")
    def _ends(self) -> StagePart:
        if self.share is None and self.arrival is None:
            raise InputError("the stage has no end; give share or arrival")
        return self


class CheckpointsPart(ConfigModel):
    """Checkpoints to resume from: steps between them, and how many are kept."""

    every: Count = 500_000
    keep: Count = 2


class Training(ConfigModel):
    """The whole configuration; docs/training.md describes every key."""

    algorithm: Literal["ppo", "sac", "recurrent-ppo"] = "ppo"
    seed: Seed = 0
    steps: Count | None = None
    minutes: Annotated[float, Field(gt=0.0)] | None = None
    envs: Count = 64
    threads: Count | None = None
    log: Count = 20_000
    base: Literal["vfh"] | None = None
    environment: dict[str, Any]
    evaluation: EvaluationPart = EvaluationPart()
    normalize: NormalizePart = NormalizePart()
    policy: PolicyPart = PolicyPart()
    hyperparameters: dict[str, Any] = Field(default_factory=dict)
    curriculum: tuple[StagePart, ...] = ()
    checkpoints: CheckpointsPart = CheckpointsPart()

    @model_validator(mode="after")
    def _fits(self) -> Training:
        """Check conditions that involve several parts."""
        if self.steps is None and self.minutes is None:
            raise InputError("it has no end; give steps, minutes or both")
        if "id" not in self.environment:
            raise InputError("environment: the key id is missing; give e.g. id: ambinav/Office-v1")
        try:
            spec_of(self.environment["id"])
        except InputError as error:
            raise InputError(f"environment: {str(error).rstrip('.')}") from error
        for key in (self.evaluation.environment or {}).keys() & {"id"}:
            raise InputError(f"evaluation.environment: {key} is that of training; drop it")
        for where, arguments in self._arguments().items():
            for key in arguments.keys() & MANAGED.keys():
                raise InputError(f"{where}: {key} cannot be given, {MANAGED[key]}; drop it")
        if self.base is not None and self.algorithm == "recurrent-ppo":
            raise InputError("base: recurrent-ppo cannot correct a baseline; choose ppo or sac")
        ends = [stage.share for stage in self.curriculum if stage.share is not None]
        if ends != sorted(set(ends)):
            raise InputError(
                f"curriculum: its stages end at the shares {', '.join(f'{end:g}' for end in ends)} "
                "of the training; let each be above the one before"
            )
        chosen = hyperparameters_of(self.algorithm, self.hyperparameters, self.envs)
        if self.base is not None and self.environment.get("discrete"):
            raise InputError(
                f"base: {self.base} has continuous actions alone; drop discrete, or base"
            )
        if self.algorithm == "sac" and self.environment.get("discrete"):
            raise InputError("algorithm: sac has continuous actions alone; drop discrete, or ppo")
        if "n_epochs" in chosen:
            batch, rollout = chosen["batch_size"], chosen["n_steps"] * self.envs
            if rollout % batch:
                raise InputError(
                    f"hyperparameters.batch_size is {batch}, which does not divide n_steps times "
                    f"envs, {rollout}; give one that does"
                )
        return self

    def _arguments(self) -> dict[str, dict[str, Any]]:
        evaluation = self.evaluation.environment or {}
        return {"environment": self.environment, "evaluation.environment": evaluation}

    @property
    def given(self) -> dict[str, Any]:
        """Arguments of the training environment as they are given."""
        return {key: value for key, value in self.environment.items() if key != "id"}

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the training environment, including those of its id."""
        return arguments_of_id(self.environment["id"], self.given)

    @property
    def judged(self) -> dict[str, Any]:
        """Arguments of the evaluation environment, likewise."""
        return self.arguments | self.judged_apart

    @property
    def judged_apart(self) -> dict[str, Any]:
        """Arguments of the evaluation environment that differ from the training's."""
        evaluation = self.evaluation.environment or {}
        return ({} if "map" in self.arguments | evaluation else DRAWN_APART) | evaluation
