"""The normalized score: 0 for blind route following, 1 for the same follower by the true pose.

    (score - blind) / (true pose - blind)

The score is the share of episodes that arrived: it needs no reward. *Blind* is `BLIND`, which
follows the shortest route by its estimate and looks neither at its readings nor at the ambiguity
map. *True pose* is the same one in the twin without localization error (`ambinav_envs.twins`), so
that their difference, the room, is the cost of that error alone. A method that drives better than
both, for example around boxes, scores more than 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ambinav.drive.bootstrap import Interval, paired_share, percentiles, share
from ambinav.runtime.array_types import Floats
from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.figures import PERCENT, draws, plain
from ambinav_envs.leaderboard.methods import SHORTEST, TRUE_POSE
from ambinav_envs.simulation.layout import ARRIVED

BLIND: Final = SHORTEST
"""Method whose score is 0; that of `TRUE_POSE` is 1."""


@dataclass(frozen=True)
class NormalizedScores:
    """Scores of a setting; shares in percent.

    Attributes:
        blind: Share of `BLIND` that arrived.
        true_pose: The same of `TRUE_POSE`.
        room: Their difference, episode by episode, percentage points.
        scores: By method; nan where no room is shown, that is its interval reaches down to 0.
    """

    blind: Interval
    true_pose: Interval
    room: Interval
    scores: Mapping[str, Interval]

    def to_plain(self) -> dict[str, Any]:
        """Return everything but the scores for JSON."""
        return {
            "score": "arrived",
            "blind": {"method": BLIND, "arrived": plain(self.blind)},
            "true_pose": {"method": TRUE_POSE, "arrived": plain(self.true_pose)},
            "room": plain(self.room),
        }


def normalized_scores(
    setting: str, episodes: Mapping[str, Episodes], blind: Episodes, true_pose: Episodes, seed: int
) -> NormalizedScores:
    """Compute the normalized scores of methods that drove the same episodes.

    Args:
        setting: Its name.
        episodes: The episodes of each method.
        blind: Those of `BLIND`, the same ones in the same order.
        true_pose: Those of `TRUE_POSE`, likewise.
        seed: Seed of the bootstrap of the scores, which has the draws of `figures.make_rows`.
    """
    runs = [blind, true_pose, *episodes.values()]
    count = len(blind)
    arrived = [run.ended(ARRIVED) for run in runs]
    building = blind.building
    columns = np.array([*arrived, np.ones(count)], dtype=float).T
    sums = np.vstack([w @ columns for w in draws(setting, building, seed)])
    shares, drawn = (
        PERCENT * sums_of_parts[..., :-1] / sums_of_parts[..., -1:]
        for sums_of_parts in (columns.sum(axis=0), sums)
    )
    room = paired_share(arrived[1], arrived[0], group=building).scaled(PERCENT)
    scores = {}
    for k, name in enumerate(episodes, start=2):
        scores[name] = Interval(math.nan, math.nan, math.nan, 0)
        if room.low > 0.0:
            scores[name] = _score(shares[[k, 0, 1]], drawn[:, [k, 0, 1]], count)
    return NormalizedScores(
        share(arrived[0], group=building).scaled(PERCENT),
        share(arrived[1], group=building).scaled(PERCENT),
        room,
        scores,
    )


def _score(shares: Floats, drawn: Floats, count: int) -> Interval:
    """Compute the score from shares (method, blind, true pose), shape (3,), and for each draw.

    The few draws without room say nothing, so each counts as the worst for either end.
    """
    gain, room = drawn[:, 0] - drawn[:, 1], drawn[:, 2] - drawn[:, 1]
    has_room = room > 0.0
    score = np.full(len(drawn), math.inf)
    np.divide(gain, room, out=score, where=has_room)
    value = float((shares[0] - shares[1]) / (shares[2] - shares[1]))
    high = percentiles(value, score, count).high
    low = percentiles(value, np.where(has_room, score, -math.inf), count).low
    return Interval(value, low, high, count)
