"""Twins of an environment: the same task with one thing changed, to measure its effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from ambinav_envs.rewards import OF_TIME, PRESETS

TRUE_POSE: Final[dict[str, Any]] = {"localizer": "perfect"}
"""No localization error: policy, follower and rewards read the true pose."""
NO_MAP: Final[dict[str, Any]] = {"ambiguity_seen": False}
"""Nothing in the observation is read from the ambiguity map, see `NavigationParameters`."""

TWINS: Final[Mapping[str, Mapping[str, Any]]] = {"TruePose": TRUE_POSE, "NoMap": NO_MAP}
"""Text before the version in a twin's id, and the arguments that it has beside its own.

Spaces, reward, buildings and the episodes of a seed stay as they are, so that what a policy scores
in both is compared episode by episode. POPGym Arcade and POBAX pair tasks with and without the
hidden state for the same reason.
"""

BELIEF: Final[dict[str, Any]] = {"belief": True, "declare": ["arrived"]}
"""The robot gives its own belief, and says when it has arrived."""


def belief_ids_of(ids: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return ids such as "ambinav/Office-Belief-v1" for some ids, with their arguments.

    Their reward is the score of the belief beside the id's own weights, or those of the shortest
    route.

    Args:
        ids: See `twins_of`.
    """
    made = _named(ids, {"Belief": BELIEF})
    for arguments in made.values():
        reward = arguments.get("reward")
        base = reward if isinstance(reward, Mapping) else PRESETS["shortest"]
        arguments["reward"] = {**base, "belief": OF_TIME * base.get("time", 0.0)}
    return made


def twins_of(ids: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the twins of some ids, with their arguments.

    Args:
        ids: Names such as "ambinav/Office-v1", with their arguments.

    Returns:
        Names such as "ambinav/Office-TruePose-v1".
    """
    return _named(ids, TWINS)


def _named(
    ids: Mapping[str, Mapping[str, Any]], kinds: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return every id of every kind, with the kind before the version and its arguments added."""
    made: dict[str, dict[str, Any]] = {}
    for name, arguments in ids.items():
        stem, _, version = name.rpartition("-")
        for kind, changed in kinds.items():
            made[f"{stem}-{kind}-{version}"] = {**arguments, **changed}
    return made
