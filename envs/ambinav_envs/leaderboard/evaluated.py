"""Evaluation of one policy over a number of episodes: the output of `ambinav evaluate`."""

from __future__ import annotations

import csv
import io
import json
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.runtime.progress import Progress, silent, within
from ambinav_envs.arena import Arena
from ambinav_envs.difficulty import LEVELS
from ambinav_envs.evaluation import UNSEEN, EpisodeDriver, Episodes
from ambinav_envs.leaderboard.figures import Row, make_rows
from ambinav_envs.leaderboard.twin_runs import RUNS, TwinRuns, drive_twins
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.card import DRAWN, plain_value
from ambinav_envs.policies.fit import check_fit
from ambinav_envs.policies.load import checksum_of
from ambinav_envs.policies.policy import RULES, Policy
from ambinav_envs.registered import arguments_of_id, is_wrapped
from ambinav_envs.registration import without_own_module
from ambinav_envs.simulation.layout import OUTCOMES

COUNT: Final = 100
"""Default number of a suite's buildings from which the episodes are drawn."""
JUDGED: Final[dict[str, Any]] = {"buildings": COUNT, "first_building": UNSEEN}

EPISODE_COLUMNS: Final = (
    "seed", "building", "outcome", "was_lost", "error_mean", "error_max", "exposure", "travelled",
    "shortest", "seconds", "reward", "cost", "lost_at_end", "lost_seconds", "spl",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Result of evaluating a policy.

    Attributes:
        row: Its figures with intervals.
        episodes: Each episode.
        environment: Arguments of the environment.
        seed: Seed of the episodes.
        differs: How scanner and robot differ from those of the training, see
            `policies.fit.differences`.
        twins: Reference runs; None if not requested.
        code: Whether the policy is code that was trusted; False: it is data.
        checksum: SHA-256 of the policy's file, see `checksum_of`; None: it is code.
    """

    row: Row
    episodes: Episodes
    environment: dict[str, Any]
    seed: int
    differs: dict[str, tuple[str, ...]] = field(default_factory=dict)
    twins: TwinRuns | None = None
    code: bool = False
    checksum: str | None = None

    def to_json(self) -> str:
        """Return figures with intervals, and how they were computed, as JSON."""
        record = {
            "policy": self.row.method,
            "sha256": self.checksum,
            "environment": {name: plain_value(v) for name, v in self.environment.items()},
            "differs": self.differs,
            "code": self.code,
            "episodes": self.row.episodes,
            "seed": self.seed,
            "figures": self.row.to_plain()["figures"],
            "summary": {
                key: None if np.isnan(value) else value
                for key, value in self.episodes.summary().items()
            },
            "twins": None if self.twins is None else self.twins.to_plain(),
        }
        return json.dumps(record, indent=2, default=str)

    def to_csv(self) -> str:
        """Return one line an episode; `NavigationEnv(...).reset(seed=seed)` repeats it."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(("episode", *EPISODE_COLUMNS))
        for k in range(len(self.episodes)):
            values = [getattr(self.episodes, name)[k] for name in EPISODE_COLUMNS]
            values[EPISODE_COLUMNS.index("outcome")] = OUTCOMES[self.episodes.outcome[k]]
            writer.writerow((k, *(f"{v:.6g}" if isinstance(v, np.floating) else v for v in values)))
        return out.getvalue()


def evaluate(
    controller: EpisodeDriver | Policy,
    task: str | None = None,
    episodes: int = 200,
    seed: int = 0,
    *,
    progress: Progress = silent,
    **arguments: Any,
) -> Episodes:
    """Run episodes of a registered environment with a policy or a controller.

    Episode k is the same for all that drive it: building, start, goal, noise of odometry and
    readings, people and obstacles have seeds of their own.

    Args:
        controller: A policy or a controller.
        task: Gymnasium id of the environment; None: that of the policy's training.
        episodes: Number of episodes.
        seed: Seed of the episodes, 0 or more.
        progress: Called with the share done.
        arguments: Arguments of the environment in the place of its own, such as `people=3`. Unless
            they say which buildings, these are `COUNT` of the suite from `UNSEEN` on.

    Raises:
        InputError: nobody has registered the id, the policy does not fit, an argument is of no use,
            or a controller gets no id.
    """
    if isinstance(controller, Policy):
        arguments = environment_for(controller, arguments, task)
        task = arguments.pop("id", None)
    elif not isinstance(controller, EpisodeDriver):
        raise InputError(
            f"controller is {reprlib.repr(controller)}; give a policy, as load_policy reads it "
            "from its name or file, or a controller."
        )
    elif task is None:
        raise InputError("task is None, and a controller was trained nowhere; give an id.")
    elif arguments_of_id(task, arguments).get("map") is None:
        arguments = JUDGED | arguments
    arena = Arena.of(task, arguments)
    return arena.evaluate(controller, episodes, seed, progress)


def environment_for(
    policy: Policy, changed: Mapping[str, Any], task: str | None = None
) -> dict[str, Any]:
    """Return the arguments of the environment in which a policy drives, and its id if that counts.

    Args:
        policy: It says what it was trained in.
        changed: Arguments that replace those. Where neither says which buildings, they are `COUNT`
            from `UNSEEN` on.
        task: Id of the environment, instead of that of the training.

    Raises:
        InputError: the policy's environment is unknown.
    """
    arguments = dict(policy.environment)
    name = arguments.pop("id", None)
    if isinstance(name, str):
        name = without_own_module(name)
    if task is not None:
        arguments, name = dict(policy.seeing), task
    elif {"suite", "map"} & changed.keys():
        name = name if name in gymnasium.registry else None
    elif name is not None and name not in gymnasium.registry:
        raise InputError(
            f"policy {policy.name!r} was trained in {name!r}, which is not known here; give "
            "--task MODULE:ID, --suite or --map."
        )
    if name is not None and is_wrapped(name):
        of_id = arguments_of_id(name, changed)
        seeing = policy.seeing if task is not None else _training_left(policy, of_id, changed)
        return {"id": name, **_needed(of_id, seeing, changed)}
    of_id = {} if name is None else arguments_of_id(name)
    arguments = {key: value for key, value in of_id.items() if key not in DRAWN} | arguments
    if "suite" in changed or "map" in changed:
        arguments.pop("suite", None)
        arguments.pop("map", None)
    arguments |= changed
    if arguments.get("map") is None:
        arguments = JUDGED | arguments
    return arguments if task is None else {"id": name, **arguments}


def _needed(
    of_id: Mapping[str, Any], seeing: Mapping[str, Any], changed: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments for an environment that somebody wrapped: no more than it needs.

    Args:
        of_id: Those that its id stands for, with `changed`.
        seeing: Those that a policy brings along.
        changed: Those that replace them.
    """
    seeing = {key: value for key, value in seeing.items() if key not in changed}
    values, trained = _comparable(of_id), _comparable({**of_id, **seeing})
    arguments = {key: value for key, value in seeing.items() if values.get(key) != trained[key]}
    place = arguments if {"suite", "map"} & arguments.keys() else of_id
    if place.get("map") is None:
        arguments |= JUDGED
    return {**arguments, **changed}


def _training_left(
    policy: Policy, of_id: Mapping[str, Any], changed: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a policy's training that others do not replace.

    Another suite or map replaces both, another difficulty also what that of the training sets.

    Args:
        policy: It was trained in an environment that somebody wrapped.
        of_id: Arguments that the id of that stands for, with `changed`.
        changed: Arguments that replace those of the training.
    """
    trained, replaced = policy.environment, {"id", *DRAWN}
    values = _comparable({**of_id, **trained})
    if {"suite", "map"} & changed.keys():
        replaced |= {"suite", "map"}
    if "difficulty" in changed:
        levels = _comparable({"difficulty": trained.get("difficulty", 0)})
        replaced |= {key for key in LEVELS[-1] if values[key] == levels[key]}
    defaults = _comparable({})
    if not defaults.keys() <= trained.keys():
        # A card that was saved by hand has defaults for what the id may say otherwise.
        unsaid = (*RULES, "layer", "robot", "scanner")
        replaced |= {key for key in unsaid if values[key] == defaults[key]}
    return {key: value for key, value in trained.items() if key not in replaced}


def _comparable(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments of an environment and the defaults of all others, as plain values."""
    names = [item.name for item in fields(NavigationParameters)]
    parameters = NavigationParameters.of({k: v for k, v in arguments.items() if k in names})
    typed = {name: getattr(parameters, name) for name in names} | {"layer": parameters.cost_layer}
    return {key: plain_value(value) for key, value in {**arguments, **typed}.items()}


def evaluate_policy(
    policy_source: str,
    changed: Mapping[str, Any],
    episodes: int,
    seed: int,
    progress: Progress = silent,
    *,
    force: bool = False,
    twins: bool = True,
    trust: bool = False,
    trained_in: str | None = None,
    task: str | None = None,
) -> Evaluation:
    """Run the episodes of a policy and evaluate them.

    Args:
        policy_source: A value that `load_policy` takes.
        changed: See `environment_for`.
        episodes: Number of episodes.
        seed: Seed of the episodes.
        progress: Called with the share done.
        force: Let it drive another scanner or robot than it was trained with.
        twins: Let it drive with the true pose too, and routes be followed blindly: `TwinRuns`.
        trust: Run code that the policy is, see `load_policy`.
        trained_in: For a file of `model.save`: id of the environment, with `changed`, that it was
            trained in.
        task: See `environment_for`.

    Raises:
        InputError: the policy cannot be loaded or does not fit, or an argument is of no use.
    """
    environment = None if trained_in is None else {"id": trained_in, **changed}
    policy = load_policy(policy_source, trust=trust, environment=environment)
    arguments = environment_for(policy, changed, task)
    options = dict(arguments)
    arena = Arena.of(options.pop("id", None), options)
    differs = check_fit(policy, arena.parameters, force)
    own_share = 1.0 / (1 + RUNS) if twins else 1.0

    episodes_driven = arena.evaluate(
        policy, episodes, seed, progress=within(progress, 0.0, own_share)
    )
    (row,) = make_rows(arena.source.name, {policy.name: episodes_driven}, None, seed)
    beside = None
    if twins:
        beside = drive_twins(
            policy, episodes_driven, arena, seed,
            within(progress, own_share, 1.0),
        )  # fmt: skip
    return Evaluation(
        row, episodes_driven, arguments, seed, differs, beside, policy.is_code,
        None if policy.is_code else checksum_of(policy_source, policy),
    )  # fmt: skip


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write evaluation.json and episodes.csv into a folder.

    Raises:
        InputError: nothing can be written there.
    """
    for name, text in (
        ("evaluation.json", evaluation.to_json() + "\n"),
        ("episodes.csv", evaluation.to_csv()),
    ):
        write_text(folder / name, text)
