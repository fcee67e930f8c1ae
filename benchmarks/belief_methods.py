"""The methods without learning of `study_twin_rooms.py`, by name."""

from __future__ import annotations

from belief_planners import Declares, FollowsWall, Planner, QMdp
from belief_pomcp import TreeSearch
from task_baselines import BASELINES, Baseline

BELIEF_METHODS: dict[str, Baseline] = {
    "bold": Baseline("route of the heaviest hypothesis", Declares),
    "wander": Baseline(
        "straight on where there is room, until 90 % sure", lambda p: Declares(p, 0.9)
    ),
    "wall-75": Baseline(
        "along the wall on its left, until 75 % sure", lambda p: FollowsWall(p, 0.75)
    ),
    "wall-90": Baseline("the same until 90 % sure", lambda p: FollowsWall(p, 0.9)),
    "point": Baseline("best hypothesis now", lambda p: Planner(p, 0), kind="planner"),
    "qmdp": Baseline("QMDP", QMdp, kind="planner"),
    "look-1": Baseline("plans one look", lambda p: Planner(p, 1), kind="planner"),
    "look-3": Baseline("plans up to three looks", Planner, kind="planner"),
    "soft-look": Baseline(
        "plans one look, by a scan that may mislead", lambda p: TreeSearch(p, 0), kind="planner"
    ),
    "pomcp": Baseline("POMCP over looks and ends", TreeSearch, kind="planner"),
    "oracle": BASELINES["oracle"],
}
"""Methods of `study_twin_rooms.py`, by name."""
