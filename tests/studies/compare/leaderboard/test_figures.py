"""The table of a leaderboard, on episodes that are made up."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ambinav.drive.bootstrap import grouped_weights
from ambinav.reports.table import difference_text, value_text
from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.figures import ALL_FIGURES, make_rows, to_csv
from ambinav_envs.leaderboard.report import criterion_text
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, MISSED, TIMEOUT


def episodes(outcome: Any, lost: Any = False, metres: Any = 10.0) -> Episodes:
    """Episodes with a shortest path of 10 m."""
    codes = np.asarray(outcome)
    count = len(codes)

    def full(value: Any) -> Any:
        return np.broadcast_to(np.asarray(value), count).copy()

    return Episodes(
        outcome=codes, was_lost=full(lost), lost_at_end=full(lost),
        lost_seconds=np.where(full(lost), 3.0, 0.0), error_max=full(0.5), error_mean=full(0.1),
        exposure=0.2 * full(metres), travelled=full(metres), shortest=full(10.0),
        seconds=full(30.0), reward=full(1.0), cost=full(0.0), building=full("a"),
        seed=np.arange(count),
    )  # fmt: skip


def test_shares_and_means() -> None:
    found = episodes(
        [ARRIVED, ARRIVED, MISSED, COLLIDED, TIMEOUT], metres=[11.0, 13.0, 5.0, 0.1, 2.0]
    )
    (row,) = make_rows("here", {"one": found}, None, 1)
    wanted = {"arrived": 40.0, "missed": 20.0, "collided": 20.0, "timeout": 20.0, "length": 1.2}
    for key, value in wanted.items():
        assert row[key].value.value == pytest.approx(value), key
    assert row["exposure"].value.count == 5
    assert row["exposure"].value.value == pytest.approx(0.2)
    assert row["length"].value.count == row["seconds"].value.count == 2
    assert row["arrived"].value.low <= 40.0 <= row["arrived"].value.high


def test_exposure_per_metre_is_of_all_metres_as_in_the_summary() -> None:
    found = replace(
        episodes([TIMEOUT] * 3, metres=[9.0, 1.0, 0.0]), exposure=np.array([0.9, 0.5, 0.0])
    )
    (row,) = make_rows("here", {"one": found}, None, 1)
    wanted = found.summary()["exposure_per_metre"]
    assert row["exposure"].value.value == pytest.approx(wanted) == pytest.approx(1.4 / 10.0)
    still = make_rows("here", {"one": replace(found, travelled=np.zeros(3))}, None, 1)[0]
    assert still["exposure"].value.count == 0 and value_text(still["exposure"]) == "-"


@pytest.mark.slow
def test_episodes_of_one_building_say_less() -> None:
    """Of 10 buildings 5 are bad ones: 200 episodes say hardly more than 10 would."""
    lost = np.arange(200) % 10 < 5
    one = episodes([ARRIVED] * 200, lost=lost)
    apart = replace(one, building=np.arange(200).astype(str))
    alike = replace(one, building=(np.arange(200) % 10).astype(str))
    width = {}
    for name, found in {"apart": apart, "alike": alike, "one": one}.items():
        value = make_rows("here", {"one": found}, None, 1)[0]["lost"].value
        assert value.value == 50.0
        width[name] = value.high - value.low
    assert width["apart"] == pytest.approx(2 * 1.96 * 50.0 / math.sqrt(200), rel=0.1)
    assert width["one"] == pytest.approx(width["apart"], rel=0.1)
    assert width["alike"] == pytest.approx(2 * 1.96 * 50.0 / math.sqrt(10), rel=0.15)


def test_draws_hold_as_many_buildings_and_episodes_of_each() -> None:
    buildings = np.array(["a", "b", "a", "c", "c", "c"])
    (weights,) = grouped_weights(buildings, np.random.default_rng(0), 50)
    assert weights.shape == (50, 6)
    copies = [
        weights[:, buildings == key].sum(axis=1) / n for key, n in (("a", 2), ("b", 1), ("c", 3))
    ]
    assert (sum(copies) == 3.0).all() and (copies[0] % 1.0 == 0.0).all()
    assert len(np.unique(weights[:, 0])) > 2


def test_differences_are_paired() -> None:
    metres = np.linspace(10.0, 20.0, 40)
    both = {
        "base": episodes([ARRIVED] * 40, metres=metres),
        "other": episodes([ARRIVED] * 40, metres=metres + 1),
    }
    base, other = make_rows("here", both, "base", 1)
    assert base["length"].difference is None
    apart = other["length"].difference
    assert apart is not None and apart.low == pytest.approx(0.1) == pytest.approx(apart.high)
    assert difference_text(other["length"], bold=True) == "**+0.100 [+0.100, +0.100]**"
    assert difference_text(other["error"], bold=True) == "+0.000 [+0.000, +0.000]"
    assert value_text(other["arrived"], brief=True) == "100 [91, 100]"


def test_a_row_does_not_hang_on_the_others() -> None:
    one = episodes([ARRIVED] * 10 + [MISSED] * 10)
    alone = make_rows("here", {"one": one}, None, 1)[0]
    among = make_rows("here", {"two": episodes([MISSED] * 20), "one": one}, None, 1)[1]
    assert [c.value for c in alone.cells] == [c.value for c in among.cells]


def test_csv() -> None:
    both = {"base": episodes([ARRIVED] * 4), "other": episodes([COLLIDED] * 4)}
    lines = to_csv(make_rows("here", both, "base", 1)).splitlines()
    assert len(lines) == 1 + 2 * len(ALL_FIGURES)
    assert lines[0].startswith("setting,method,figure,unit,episodes,counted,value,low,high")
    assert "here,base,arrived,%,4,4,100,51.0109,100,,," in lines
    assert "here,other,length,,4,0,,,,,," in lines


@pytest.mark.parametrize(
    ("base", "other", "metres", "text"),
    [
        (0, 0, 10.0, "nobody lost to begin with"),
        (0, 20, 10.0, "lost more often"),
        (0, 1, 10.0, "no difference shown"),
        (30, 5, 10.5, "met"),
        (30, 5, 12.0, "halved, but too long"),
        (30, 18, 10.0, "lost less often, not halved"),
        (5, 30, 10.0, "lost more often"),
        (5, 4, 10.0, "no difference shown"),
    ],
)
def test_the_goal(base: int, other: int, metres: float, text: str) -> None:
    number = np.arange(40)
    both = {
        "base": episodes([ARRIVED] * 40, lost=number < base),
        "other": episodes([ARRIVED] * 40, lost=number < other, metres=metres),
    }
    first, second = make_rows("here", both, "base", 1)
    assert criterion_text(first, first) == ""
    assert criterion_text(second, first) == text
