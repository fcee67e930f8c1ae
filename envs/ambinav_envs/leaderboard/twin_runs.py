"""Reference runs of a policy: itself with the true pose, and blind route following."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ambinav.runtime.progress import Progress, step_of
from ambinav_envs.arena import Arena
from ambinav_envs.evaluation import EpisodeDriver, Episodes
from ambinav_envs.leaderboard.figures import Row, make_rows, plain
from ambinav_envs.leaderboard.methods import PLANNERS, STEERS, TRUE_POSE, planner_method
from ambinav_envs.leaderboard.normalized import BLIND, NormalizedScores, normalized_scores
from ambinav_envs.policies.policy import Policy
from ambinav_envs.twins import TRUE_POSE as BY_TRUTH

OWN, TWIN = "policy", "policy, true pose"
RUNS = 3
"""Number of additional runs of the episodes."""


@dataclass(frozen=True, eq=False)
class TwinRuns:
    """Results of the reference runs.

    Attributes:
        twin: The policy in the twin without localization error; differences are to itself by its
            estimate, episode by episode.
        blind: `normalized.BLIND` in the same episodes, with the policy's reward; differences
            likewise.
        scores: The policy's, under `OWN`.
    """

    twin: Row
    blind: Row
    scores: NormalizedScores

    def to_plain(self) -> dict[str, Any]:
        """Return the results for JSON."""
        return {
            "normalized_score": plain(self.scores.scores[OWN]),
            "normalized_by": self.scores.to_plain(),
            "policy_true_pose": self.twin.to_plain(),
            "blind": self.blind.to_plain(),
        }


def drive_twins(
    policy: Policy, episodes: Episodes, arena: Arena, seed: int, progress: Progress
) -> TwinRuns:
    """Run a policy's episodes again with the true pose, and with blind route following.

    Args:
        policy: The policy.
        episodes: Results of its episodes.
        arena: Where they were driven.
        seed: Seed of the episodes.
        progress: Called with the share done.
    """
    # The reward stays the policy's, so that returns agree; what nobody looks at is left out.
    unseen = {} if arena.wrapped is not None else {"window": False, "waypoint": False}
    steered = arena.changed(**{**STEERS, **unseen})
    blind = planner_method(BLIND, PLANNERS[BLIND]).make(steered.parameters)
    drivers: dict[str, tuple[EpisodeDriver | Policy, Arena]] = {
        TWIN: (policy, arena.changed(**BY_TRUTH)),
        BLIND: (blind, steered),
        # The same follower, which has the routes already.
        TRUE_POSE: (blind, steered.changed(**BY_TRUTH)),
    }
    runs = {OWN: episodes}
    for k, (name, (driver, driver_arena)) in enumerate(drivers.items()):
        part = step_of(progress, k, RUNS)
        runs[name] = driver_arena.evaluate(driver, len(episodes), seed, progress=part)
    scores = normalized_scores(
        arena.source.name, {OWN: episodes}, runs[BLIND], runs[TRUE_POSE], seed
    )
    rows = make_rows(arena.source.name, runs, OWN, seed)
    by_name = {row.method: row for row in rows}
    return TwinRuns(replace(by_name[TWIN], method=policy.name), by_name[BLIND], scores)
