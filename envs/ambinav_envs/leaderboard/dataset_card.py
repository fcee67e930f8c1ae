"""Cards of data sets: a README.md with the YAML front matter of the Hugging Face Hub."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import gymnasium as gym
import numpy as np
import yaml
from gymnasium.envs.registration import EnvSpec

from ambinav_envs.file_arguments import files_of
from ambinav_envs.leaderboard.model_card import TASK, as_yaml

if TYPE_CHECKING:
    from minari.data_collector import EpisodeBuffer

INFOS: Final = {
    "cost": "1 where the robot collides, plus 1 where it is lost",
    "lost": "whether its error was above 0.5 m or 30 degrees for over a second",
    "true_pose": "x, y (m), heading (rad) in the frame of the map",
    "estimate": "the localizer's x, y (m), heading (rad)",
}
"""Recorded parts of the info, one row more than actions: what safe and privileged learning need."""
ENDED: Final = {
    "outcome": "how the episode ended",
    "is_success": "whether it arrived",
    "was_lost": "whether it was ever lost",
    "shortest": "length of the shortest path from start to goal (m)",
    "travelled": "length of the true path (m)",
}
"""Recorded parts of the last info, kept as metadata of each episode."""
_SIZES: Final = ("n<1K", "1K<n<10K", "10K<n<100K", "100K<n<1M", "1M<n<10M", "10M<n<100M")
"""Size categories of the Hub, each ten times the one before."""


def dataset_card(
    name: str,
    metadata: Mapping[str, Any],
    env: gym.Env[Any, Any],
    evaluation: EnvSpec,
    episodes: Sequence[EpisodeBuffer],
    ends: Sequence[Mapping[str, Any]],
    drawn: bool,
) -> str:
    """Return the card of a data set.

    Args:
        name: Id of the data set.
        metadata: As given to Minari: description, algorithm_name, code_permalink, requirements and,
            if somebody is named, author.
        env: The environment that it was recorded in.
        evaluation: The environment in which policies are to be evaluated.
        episodes: The episodes.
        ends: `ENDED` of each episode.
        drawn: Whether ambinav's own suites drew the buildings: then the licence is its code's.
    """
    assert env.spec is not None
    returns = [float(np.sum(episode.rewards)) for episode in episodes]
    steps = [len(episode.rewards) for episode in episodes]
    total = sum(steps)
    front = {
        "license": "apache-2.0" if drawn else "other",
        "task_categories": [TASK, "robotics"],
        "tags": ["minari", "offline-rl", "ambinav", env.spec.id],
        "size_categories": [_SIZES[min(max(len(str(total)) - 3, 0), len(_SIZES) - 1)]],
        "pretty_name": name,
    }
    head = yaml.safe_dump(front, sort_keys=False, width=1000)
    outcomes = Counter(str(end["outcome"]) for end in ends)
    counts = ", ".join(f"{outcomes[key]} {key}" for key in sorted(outcomes))
    lost = sum(bool(end["was_lost"]) for end in ends)
    # On one line of a table, whatever somebody is called.
    maker = " ".join(str(metadata.get("author", "")).split()).replace("|", "\\|")
    author = f"| author | {maker} |\n" if maker else ""
    licence = (
        "Apache-2.0, as the code: ambinav drew the buildings."
        if drawn
        else "That of the map or the suite of the buildings; name it before you publish the data."
    )
    return f"""---
{head}---

# {name}

Episodes of a mobile robot with a range scanner that drives to a goal by its estimated pose, with a
localizer in the loop: {metadata["description"]}

| | |
| --- | --- |
| episodes | {len(ends)}: {counts}; {lost} were ever lost |
| steps | {total} (of an episode {np.mean(steps):.1f} on average, {min(steps)} to {max(steps)}) |
| sum of rewards | {np.mean(returns):.3f} +/- {np.std(returns):.3f} \
({min(returns):.3f} to {max(returns):.3f}), mean +/- deviation over the episodes |
| algorithm | {metadata["algorithm_name"]} |
{author}| code | {metadata["code_permalink"]} |
| needs | `{" ".join(metadata["requirements"])}`, minari {version("minari")} |

## Use

```python
import ambinav_envs
import minari

stored = minari.load_dataset("{name}")
env = stored.recover_environment()
unseen = stored.recover_environment(eval_env=True)
```

`reset` of `env` with the seed of an episode, and its actions, give its observations and rewards
again, bit for bit, with the same versions.
{_needed_files(env.spec.kwargs)}
## Content

| observation | shape | range |
| --- | --- | --- |
{_boxes(env.observation_space)}

Actions: `{str(env.action_space).replace("|", " ")}`.

| infos of a step | content |
| --- | --- |
{_rows(INFOS)}

| metadata of an episode | content |
| --- | --- |
{_rows(ENDED)}

## Environments

Recorded in `{env.spec.id}` with these arguments:

```yaml
{as_yaml(env.spec.kwargs)}```

Policies are to be evaluated in `{evaluation.id}` with these:

```yaml
{as_yaml(evaluation.kwargs)}```

## Licence

{licence}

## What this does not show

- Simulated drives of one method, in the buildings and with the scanner, robot and localizer named
  above; the method sees a false pose where it is lost, and other methods would drive elsewhere.
- Sums of rewards can be compared only where the reward is the same.
"""


def _needed_files(arguments: Mapping[str, Any]) -> str:
    """Return a paragraph on each file that the environments need."""
    return "".join(
        f"""
The {key} is the file `{file}`, which the data set does not hold: publish it too. Where it lies
elsewhere, say so: `stored.recover_environment({key}=...)`, and likewise with `eval_env=True`.
"""
        for key, file in files_of(arguments).items()
    )


def _rows(texts: Mapping[str, str]) -> str:
    return "\n".join(f"| `{name}` | {text} |" for name, text in texts.items())


def _boxes(space: gym.Space[Any]) -> str:
    """Format an observation space, one part a row."""
    parts = space.spaces if isinstance(space, gym.spaces.Dict) else {"observation": space}
    return "\n".join(
        f"| `{name}` | {part.shape} | "
        + (
            f"{part.low.min():g} to {part.high.max():g} |"
            if isinstance(part, gym.spaces.Box)
            else "|"
        )
        for name, part in parts.items()
    )
