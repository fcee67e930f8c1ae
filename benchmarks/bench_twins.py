"""Value of pose and map: blind route following, and a policy, in every suite and its twins.

Every run has the same episodes. The room is what the true pose is worth to who follows the shortest
routes blindly, and so what there is to be learned against localization error; where none is shown,
there is none to report. The policy drives its own episodes, those of the twin without localization
error, and those of the twin whose observation has nothing of the ambiguity map, which a trained one
may read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from harness import arguments, report, table

from ambinav.reports.table import difference_text, interval_text
from ambinav_envs.arena import Arena
from ambinav_envs.evaluation import UNSEEN, evaluate_in
from ambinav_envs.leaderboard.board import CONDITIONS
from ambinav_envs.leaderboard.figures import make_rows
from ambinav_envs.leaderboard.twin_runs import OWN, drive_twins
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.policy import Policy
from ambinav_envs.scenario import scenario
from ambinav_envs.tasks import SUITES_WITH_IDS as SUITES
from ambinav_envs.twins import NO_MAP

LIBRARIES = ("ambinav", "stable_baselines3", "torch", "numpy", "numba")
HEADER = (
    "suite", "condition", "blind (%)", "true pose (%)", "room", "policy (%)", "normalized score",
    "SPL", "lost at the end (%)", "time lost (%)", "with the true pose", "without the map",
)  # fmt: skip


def rows_of(policy: Policy, episodes: int, buildings: int, seed: int) -> Iterator[tuple[str, ...]]:
    """Return a row for each suite under each condition."""
    for suite in SUITES:
        source = None
        for condition, changed in CONDITIONS.items():
            fresh, parameters = scenario(
                suite, None, buildings, UNSEEN, None, {**policy.seeing, **changed}
            )
            # Shared by all, because it holds the maps.
            source = source or fresh
            episodes_driven = evaluate_in(policy, source, parameters, episodes, seed)
            twins = drive_twins(
                policy, episodes_driven, Arena(source, parameters), seed, lambda share: None
            )
            bare = evaluate_in(policy, source, replace(parameters, **NO_MAP), episodes, seed)
            own, without = make_rows(source.name, {OWN: episodes_driven, "NoMap": bare}, OWN, seed)
            scores = twins.scores
            yield (
                suite, condition, interval_text(scores.blind, 1),
                interval_text(scores.true_pose, 1), interval_text(scores.room, 1, "+"),
                interval_text(own["arrived"].value, 1), interval_text(scores.scores[OWN], 2),
                interval_text(own["spl"].value, 3), interval_text(own["lost_at_end"].value, 1),
                interval_text(own["lost_time"].value, 1), difference_text(twins.twin["arrived"]),
                difference_text(without["arrived"]),
            )  # fmt: skip
            print(suite, condition, flush=True)


def main() -> None:
    """Drive, and report."""
    args = arguments(__doc__, policy="vfh", episodes=200, buildings=100, seed=0)
    rows = rows_of(load_policy(args.policy), args.episodes, args.buildings, args.seed)
    body = (
        f"{args.episodes} episodes each, the same ones for all, in {args.buildings} buildings of "
        f"each suite; the policy is {args.policy}. Shares that arrived, room and the last two "
        "columns (differences to the policy's own share, episode by episode) in points; "
        "docs/leaderboard.md says what the score is. In brackets: 95 % intervals "
        "over buildings and episodes in them.\n\n" + table(HEADER, rows, words=2)
    )
    report("What pose and map are worth", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
