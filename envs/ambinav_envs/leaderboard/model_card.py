"""Model cards for model hubs: a README.md with YAML front matter, as SB3's tools write it.

Keys of the front matter are those of the Hugging Face Hub (`library_name`, `tags`, `model-index`)
in the form that `huggingface_sb3` and `rl_zoo3.push_to_hub` give them: one `mean_reward` whose
value is "mean +/- deviation", and results.json beside. Nothing here reaches for a network.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing, sha256
from ambinav_envs.leaderboard.figures import FIGURES
from ambinav_envs.policies import Card, read_card
from ambinav_envs.registration import IDS, without_own_module
from ambinav_envs.tasks import NAMESPACE

README: Final = "README.md"
RESULTS: Final = "results.json"
LIBRARY: Final = "stable-baselines3"
TASK: Final = "reinforcement-learning"
NAVIGATION: Final = "ambinav/Navigation-v1"
"""Environment for cards without an id: the one that takes a map."""
ENDS: Final = ("value", "low", "high")
"""Keys of an interval."""
BESIDE: Final = ("arrived", "collided", "lost")
"""Figures that stand in the front matter beside the mean reward."""


@dataclass(frozen=True)
class Judged:
    """Output of `ambinav evaluate POLICY -o DIR`.

    Attributes:
        record: evaluation.json.
        rewards: Sum of rewards of each episode.
    """

    record: Mapping[str, Any]
    rewards: Sequence[float]

    @property
    def mean(self) -> float:
        """Mean sum of rewards."""
        return float(np.mean(self.rewards))

    @property
    def deviation(self) -> float:
        """Standard deviation over the episodes, as by `evaluate_policy` of SB3."""
        return float(np.std(self.rewards))


def read_judged(folder: Path, policy_file: Path) -> Judged:
    """Read an evaluation.

    Args:
        folder: Folder that `ambinav evaluate` wrote.
        policy_file: The policy that it must belong to.

    Raises:
        InputError: a file is missing or damaged, or belongs to another policy.
    """
    path, table = folder / "evaluation.json", folder / "episodes.csv"
    for needed in (path, table):
        if not needed.is_file():
            raise InputError(
                f"{needed}: there is no such file; run: ambinav evaluate {policy_file} -o DIR, "
                "and give that folder."
            )
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        with table.open(newline="", encoding="utf-8") as file:
            rewards = [float(row["reward"]) for row in csv.DictReader(file)]
        same = len(rewards) == record["episodes"] and len(rewards) > 0
        figures = {key: record["figures"][key] for key in (figure.key for figure in FIGURES)}
        ends = [
            interval[end] for interval in figures.values() if interval is not None for end in ENDS
        ]
        is_complete = all(math.isfinite(end) for end in ends)
        policy, _ = record["policy"], record["environment"].items()
        judged = record.get("sha256")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{folder}: the evaluation is damaged ({type(error).__name__}: {error}); evaluate the "
            "policy again."
        ) from error
    if not (same and is_complete and np.isfinite(rewards).all()):
        raise InputError(
            f"{folder}: evaluation.json and episodes.csv are not of one evaluation; evaluate the "
            "policy again."
        )
    if policy != policy_file.stem:
        raise InputError(f"{folder}: this is an evaluation of {policy}, not of {policy_file.stem}.")
    if judged is not None and judged != sha256(policy_file):
        raise InputError(
            f"{folder}: this is an evaluation of another file that is called {policy} too; run: "
            f"ambinav evaluate {policy_file} -o DIR, and give that folder."
        )
    return Judged(record, rewards)


def front_matter(card: Card, judged: Judged) -> dict[str, Any]:
    """Return the YAML front matter of a model card, as a hub reads it.

    Args:
        card: Card of the policy's file.
        judged: Its evaluation.
    """
    trained, (judged_name, judged_id) = _id_of(card.environment), judged_in(card, judged)
    metrics: list[dict[str, Any]] = [
        {
            "type": "mean_reward",
            "value": f"{judged.mean:.2f} +/- {judged.deviation:.2f}",
            "name": "mean_reward",
            "verified": False,
        }
    ]
    for figure in (candidate for candidate in FIGURES if candidate.key in BESIDE):
        interval = judged.record["figures"][figure.key]
        if interval is not None:
            metrics.append(
                {
                    "type": f"{figure.key}_percent",
                    "value": round(float(interval["value"]), figure.digits),
                    "name": f"{figure.title}, % of episodes",
                    "verified": False,
                }
            )
    result = {
        "task": {"type": TASK, "name": TASK},
        "dataset": {"name": judged_name, "type": judged_id},
        "metrics": metrics,
    }
    return {
        "library_name": LIBRARY,
        "pipeline_tag": TASK,
        "tags": [trained, "deep-reinforcement-learning", TASK, LIBRARY, "ambinav", "robotics"],
        "model-index": [{"name": card.algorithm, "results": [result]}],
    }


def judged_in(card: Card, judged: Judged) -> tuple[str, str]:
    """Return where a policy was evaluated: a text for readers, and the environment's id."""
    arguments = judged.record["environment"]
    if arguments.get("map") is not None:
        return f"{NAVIGATION}, map {Path(str(arguments['map'])).name}", NAVIGATION
    if arguments.get("id") is not None:
        return str(arguments["id"]), str(arguments["id"])
    trained, suite = _id_of(card.environment), arguments.get("suite")
    same = suite in (None, card.environment.get("suite"), IDS.get(trained, {}).get("suite"))
    suite_id = f"{NAMESPACE}/{str(suite).capitalize()}-v1"
    env_id = trained if same else suite_id if suite_id in IDS else NAVIGATION
    return env_id, env_id


def _id_of(environment: Mapping[str, Any]) -> str:
    return without_own_module(str(environment.get("id") or NAVIGATION))


def model_card(name: str, card: Card, judged: Judged) -> str:
    """Return a README.md: front matter, a description of the policy, and its results."""
    front = front_matter(card, judged)
    head = yaml.safe_dump(front, sort_keys=False, allow_unicode=True, width=1000)
    seed = "" if card.seed is None else f", seed {card.seed}"
    versions = ", ".join(f"{package} {version}" for package, version in card.versions.items())
    seen = ", ".join(
        f"`{part}` ({box['size']})" for part, box in card.observation.get("parts", {}).items()
    )
    space = card.action
    action = f"one of {space['count']}" if "count" in space else f"{space['size']} in [-1, 1]"
    if card.base is not None:
        action += f", by which it corrects {card.base}"
    return f"""---
{head}---

# {name}

A **{card.algorithm}** agent trained in **{front["tags"][0]}** of ambinav: a mobile robot with a
range scanner that drives to a goal by its estimated pose, with a localizer in the loop.
{card.steps:,} steps{seed}, with {versions}.

Sees {seen or "one row"}; gives {action}.

## Use

```python
from ambinav_envs.policies import load_policy

policy = load_policy("{name}.zip")
```

`ambinav evaluate {name}.zip` lets it drive in buildings that it has not seen.

## Evaluation

{judged.record["episodes"]} episodes in {judged_in(card, judged)[0]} from seed
{judged.record["seed"]}, without exploration, by `ambinav evaluate`; in brackets 95 % intervals
over buildings and episodes.

| figure | value |
| --- | ---: |
| sum of rewards, mean +/- deviation | {judged.mean:.2f} +/- {judged.deviation:.2f} |
{_figures(judged)}

In the environment with these arguments:

```yaml
{as_yaml(judged.record["environment"])}```

## Training

In the environment with these arguments:

```yaml
{as_yaml(card.environment)}```

## What this does not show

- A score in simulation, in the buildings, with the scanner and the robot named above. Another
  scanner or robot is another task.
- It drives by the pose that a localizer estimates, and does no safety function's work.
"""


def write_model_card(path: Path, evaluation: Path, folder: Path) -> Path:
    """Write a folder ready for a hub: README.md, results.json and the policy.

    Args:
        path: A policy file.
        evaluation: Folder that `ambinav evaluate` wrote with -o.
        folder: Is made if it is not there.

    Returns:
        The README.

    Raises:
        InputError: the policy or the evaluation cannot be read, or nothing can be written.
    """
    card, name = read_card(path), path.stem
    judged = read_judged(evaluation, path)
    results = {
        "mean_reward": judged.mean,
        "std_reward": judged.deviation,
        "is_deterministic": True,
        "n_eval_episodes": len(judged.rewards),
    }
    contents = {
        path.name: path.read_bytes(),
        RESULTS: (json.dumps(results, indent=2) + "\n").encode(),
        README: model_card(name, card, judged).encode(),
    }
    for file_name, content in contents.items():
        if (folder / file_name).resolve() != path.resolve():
            with replacing(folder / file_name) as scratch:
                scratch.write_bytes(content)
    return folder / README


def _figures(judged: Judged) -> str:
    rows = []
    for figure in FIGURES:
        interval = judged.record["figures"][figure.key]
        if interval is not None:
            unit = f" ({figure.unit})" if figure.unit else ""
            value, low, high = (f"{interval[end]:.{figure.digits}f}" for end in ENDS)
            rows.append(f"| {figure.title}{unit} | {value} [{low}, {high}] |")
    return "\n".join(rows)


def as_yaml(arguments: Mapping[str, Any]) -> str:
    """Format the arguments of an environment as YAML, with the scanner as in its file."""
    plain = dict(arguments)
    scanner = plain.get("scanner")
    if isinstance(scanner, Mapping) and isinstance(scanner.get("yaml"), str):
        plain["scanner"] = yaml.safe_load(scanner["yaml"])
    return yaml.safe_dump(plain, sort_keys=False, allow_unicode=True)
