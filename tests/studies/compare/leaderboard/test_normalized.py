"""Normalized scores, SPL and returns, on episodes that are made up."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.figures import make_rows
from ambinav_envs.leaderboard.normalized import NormalizedScores, normalized_scores
from ambinav_envs.leaderboard.returns import agreeing, reward_rule
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, MISSED, TIMEOUT
from tests.studies.compare.leaderboard.test_figures import episodes


def arriving(which: Any) -> Episodes:
    return episodes(np.where(which, ARRIVED, MISSED))


def scores(blind: Any, true_pose: Any, /, **methods: Any) -> NormalizedScores:
    found = {name: arriving(which) for name, which in methods.items()}
    return normalized_scores("here", found, arriving(blind), arriving(true_pose), 1)


NUMBER = np.arange(100)


def test_the_score_is_the_share_of_the_room() -> None:
    found = scores(
        NUMBER < 40, NUMBER < 90, blind=NUMBER < 40, oracle=NUMBER < 90, half=NUMBER < 65,
        worse=NUMBER < 20, better=NUMBER < 100,
    )  # fmt: skip
    assert (found.blind.value, found.true_pose.value, found.room.value) == (40.0, 90.0, 50.0)
    values = {name: one.value for name, one in found.scores.items()}
    wanted = {"blind": 0.0, "oracle": 1.0, "half": 0.5, "worse": -0.4, "better": 1.2}
    assert values == pytest.approx(wanted)
    for name, value in (("blind", 0.0), ("oracle", 1.0)):
        # Pair by pair: what is the same has no spread.
        assert (found.scores[name].low, found.scores[name].high) == (value, value)


@pytest.mark.slow
def test_the_interval_is_that_of_pairs_drawn_one_by_one() -> None:
    rng = np.random.default_rng(5)
    blind, true_pose, ours = (rng.random((3, 100)) < np.array([[0.3], [0.95], [0.7]])).astype(float)
    found = scores(blind > 0, true_pose > 0, ours=ours > 0).scores["ours"]
    drawn = []
    for _ in range(8000):
        rows = rng.integers(0, 100, 100)
        b, t, s = blind[rows].mean(), true_pose[rows].mean(), ours[rows].mean()
        drawn.append((s - b) / (t - b))
    assert (found.low, found.high) == pytest.approx(
        tuple(np.quantile(drawn, [0.025, 0.975])), abs=0.02
    )


@pytest.mark.parametrize("true_pose", [NUMBER < 40, NUMBER < 41, NUMBER < 20])
def test_without_room_there_is_no_score(true_pose: Any) -> None:
    found = scores(NUMBER < 40, true_pose, ours=NUMBER < 100)
    assert found.room.low <= 0.0
    assert math.isnan(found.scores["ours"].value) and found.scores["ours"].count == 0
    assert found.to_plain()["room"]["value"] == pytest.approx(true_pose.sum() - 40.0)


def test_draws_without_room_widen_the_interval_and_are_not_dropped() -> None:
    """Six episodes make the room; hardly any draw holds none of them, and those count as worst."""
    found = scores(NUMBER < 40, NUMBER < 46, ours=(NUMBER < 43) | (NUMBER > 96))
    assert found.room.low > 0.0
    score = found.scores["ours"]
    assert score.value == pytest.approx(1.0)
    assert -math.inf < score.low < 1.0 < score.high < math.inf


def test_spl() -> None:
    """Equation 1 of Anderson et al. (2018), by hand; the shortest path is 10 m long."""
    found = episodes(
        [ARRIVED, ARRIVED, ARRIVED, COLLIDED, TIMEOUT], metres=[10.0, 20.0, 9.5, 3.0, 30.0]
    )
    assert found.spl.tolist() == [1.0, 0.5, 1.0, 0.0, 0.0]
    (row,) = make_rows("here", {"one": found}, None, 1)
    assert row["spl"].value.value == pytest.approx(0.5) and row["spl"].value.count == 5
    at_once = replace(found, shortest=np.zeros(5), travelled=np.zeros(5))
    assert at_once.spl.tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]


def test_time_lost_and_lost_at_the_end() -> None:
    found = replace(
        episodes([ARRIVED] * 4, lost=[True, True, False, False]),
        seconds=np.array([10.0, 30.0, 40.0, 20.0]),
        lost_at_end=np.array([True, False, False, False]),
        lost_seconds=np.array([5.0, 20.0, 0.0, 0.0]),
    )
    (row,) = make_rows("here", {"one": found}, None, 1)
    assert row["lost_at_end"].value.value == 25.0 and row["lost"].value.value == 50.0
    assert row["lost_time"].value.value == pytest.approx(25.0)


def test_returns_are_told_where_rewards_agree() -> None:
    same: list[dict[str, Any]] = [
        {}, {"reward": "ambiguity"}, {"window": False, "odometry_scale": 2.0, "layer": "level"},
        {"reward": {"progress": 0.3, "arrival": 1, "collision": 1, "missed": 1, "time": 0.03,
                    "ambiguity": 0.3, "lost": 0}},
    ]  # fmt: skip
    other: list[dict[str, Any]] = [
        {"reward": "shortest"},
        {"ambiguity_weight": 5},
        {"gamma": 0.99},
        {"layer": "fisher"},
    ]
    parameters = {str(k): NavigationParameters.of(one) for k, one in enumerate([*same, *other])}
    found = dict.fromkeys(parameters, episodes([ARRIVED] * 3))
    told = agreeing(found, parameters, parameters["0"])
    for name, one in told.items():
        assert np.isnan(one.reward).all() == (int(name) >= len(same)), parameters[name].reward
    # Where no term goes by the route, its weight does not matter.
    flat = [{"reward": {"arrival": 1.0}, "ambiguity_weight": weight} for weight in (0, 5)]
    assert reward_rule(NavigationParameters.of(flat[0])) == reward_rule(
        NavigationParameters.of(flat[1])
    )
