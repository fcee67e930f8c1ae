"""The criterion on runs that are made up, and what is said of them."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from ambinav.drive.metrics import Metrics
from ambinav.reports.criterion import AcceptanceCriterion
from ambinav.routes.bad_floor import BadFloor
from ambinav.runtime.errors import InputError
from ambinav.studies.compare.criterion import CRITERION, Verdict, judge_route
from ambinav.studies.compare.verdict_text import (
    baseline_sentence,
    criterion_text,
    floor_sentence,
    headline,
    sentence,
)

RUNS = 30
SPREAD = 0.001 * (np.arange(RUNS) - (RUNS - 1) / 2)


def measured(lost: int, error: ArrayLike, collided: int = 0) -> Metrics:
    """Runs of which the first ones are lost and the last ones collide."""
    plain = {field.name: np.zeros(RUNS) for field in fields(Metrics)}
    plain["lost"] = np.arange(RUNS) < lost
    plain["collided"] = np.arange(RUNS)[::-1] < collided
    plain["position_p95"] = np.asarray(error) + SPREAD
    return Metrics(**plain)


def judged(
    ours: Metrics, theirs: Metrics, extra: float = 0.05, criterion: AcceptanceCriterion = CRITERION
) -> Verdict:
    lengths = (40.0 * (1.0 + extra), 40.0)
    return judge_route(ours, theirs, lengths, np.random.default_rng(1), criterion)


CASES = {
    "all met": ((5, 0.3), (15, 0.6), 0.10, "met", "better"),
    "lost too often": ((6, 0.3), (15, 0.6), 0.10, "not met", "better"),
    "error too large": ((5, 0.31), (15, 0.6), 0.10, "not met", "better"),
    "too long": ((5, 0.3), (15, 0.6), 0.101, "not met", "better"),
    "none lost on either": ((0, 0.1), (0, 0.2), 0.0, "met", "better"),
    "lost where none was": ((1, 0.1), (0, 0.2), 0.0, "not met", "better"),
    "easy": ((0, 0.05), (0, 0.149), 0.0, "easy", "better"),
    "easy and the same": ((0, 0.1), (0, 0.1), 0.0, "easy", "none"),
    "easy, and made worse": ((9, 0.4), (0, 0.1), 0.0, "easy", "worse"),
    "not easy: one was lost": ((0, 0.1), (1, 0.1), 0.0, "not met", "none"),
    "worse": ((15, 0.6), (5, 0.3), 0.0, "not met", "worse"),
    "mixed": ((15, 0.3), (5, 0.6), 0.0, "not met", "mixed"),
}


@pytest.mark.parametrize(
    ("ours", "theirs", "extra", "outcome", "effect"), CASES.values(), ids=CASES.keys()
)
def test_outcome_and_effect(
    ours: tuple[int, float], theirs: tuple[int, float], extra: float, outcome: str, effect: str
) -> None:
    found = judged(measured(*ours), measured(*theirs), extra)
    assert (found.outcome, found.effect) == (outcome, effect)
    assert found.lost.ratio.value == pytest.approx(
        ours[0] / theirs[0] if theirs[0] else (np.inf if ours[0] else 1.0)
    )
    assert found.error.ratio.value == pytest.approx(ours[1] / theirs[1], rel=0.02)


def test_more_collisions_do_not_meet_the_goal() -> None:
    found = judged(measured(0, 0.2, collided=12), measured(15, 0.6))
    assert found.lost_met and found.error_met and found.length_met
    assert not found.walls_met and found.outcome == "not met" and found.effect == "mixed"
    assert "collides more often" in sentence(found, "a", "b")
    # Equally often on both, but so often that what is left says little.
    found = judged(measured(0, 0.2, collided=20), measured(15, 0.6, collided=20))
    assert not found.walls_met and found.outcome == "not met"
    assert "% of its runs" in sentence(found, "a", "b")
    # Where robots meet walls it is not easy, however well they know where they are.
    assert judged(measured(0, 0.1), measured(0, 0.1, collided=3)).outcome == "not met"
    # Two more of thirty show nothing.
    assert judged(measured(0, 0.2, collided=2), measured(15, 0.6)).outcome == "met"


def test_the_goal_can_be_another() -> None:
    pair = measured(6, 0.3), measured(15, 0.6)
    assert judged(*pair).outcome == "not met"
    assert judged(*pair, criterion=AcceptanceCriterion(lost=0.4)).outcome == "met"
    assert judged(*pair, criterion=AcceptanceCriterion(easy=9.0)).outcome == "not met"


def test_row() -> None:
    row = judged(measured(5, 0.3), measured(15, 0.6)).row()
    assert (row["outcome"], row["effect"], row["runs"]) == ("met", "better", RUNS)
    assert row["lost_shortest"] == 0.5 and row["lost_route"] == pytest.approx(1 / 6)
    assert row["error_difference"] == pytest.approx(-0.3)
    assert row["length_ratio"] == pytest.approx(1.05)
    assert {type(value) for value in row.values()} == {int, float, bool, str}


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(st.integers(0, RUNS), st.integers(0, RUNS), st.floats(0.01, 2.0), st.floats(0.01, 2.0))
def test_sides_can_be_changed(lost: int, other: int, error: float, wrong: float) -> None:
    """Less on one side is more on the other; a route against itself never differs."""
    ours, theirs = measured(lost, error), measured(other, wrong)
    there, back = judged(ours, theirs), judged(theirs, ours)
    swapped = {"better": "worse", "worse": "better"}
    assert swapped.get(there.effect, there.effect) == back.effect
    itself = judged(ours, ours, 0.0)
    assert itself.effect == "none" and itself.outcome != "met"
    assert sentence(itself, "a", "b") == "a gives exactly the same runs as b: it is the same path."


def test_bad_input() -> None:
    runs = measured(0, 0.1)
    none = Metrics(**{field.name: np.zeros(0) for field in fields(Metrics)})
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match="ours has no runs"):
        judge_route(none, none, (1.0, 1.0), rng)
    with pytest.raises(InputError, match=r"lengths is \(0.0, 1.0\)"):
        judge_route(runs, runs, (0.0, 1.0), rng)


def test_sentences() -> None:
    better = sentence(judged(measured(5, 0.3), measured(15, 0.6)), "detour", "shortest")
    assert better.startswith("detour is better than shortest: lost 17 instead of 50 % (-33 [")
    assert "95th percentile of the error 0.30 instead of 0.60 m (-0.30 [-0.30, -0.30])" in better
    assert better.endswith("the route is 5.0 % longer. The criterion is met.")
    none = sentence(judged(measured(0, 0.1), measured(1, 0.1)), "detour", "shortest")
    assert none.startswith("detour makes no difference to shortest that 30 runs show: lost 0 inst")
    easy = sentence(judged(measured(0, 0.1), measured(0, 0.12)), "detour", "shortest")
    assert easy.endswith("There was nothing to gain: shortest is easy.")
    long = sentence(judged(measured(5, 0.3), measured(15, 0.6), 0.2), "detour", "shortest")
    assert long.endswith("The criterion is not met (more than 10 % longer).")
    floors = BadFloor(3.0, 1.26, 0.0, 0.0), BadFloor(19.1, 14.5, 4.0, 4.0)
    assert floor_sentence(*floors) == (
        "Planned with 3.0 m in corridor (longest stretch 1.3 m) instead of 19.1 m (14.5 m) "
        "and 0.0 m in open zones (longest stretch 0.0 m) instead of 4.0 m (4.0 m)."
    )
    assert floor_sentence(floors[1]) == (
        "Planned with 19.1 m in corridor (longest stretch 14.5 m) and "
        "4.0 m in open zones (longest stretch 4.0 m)."
    )
    assert baseline_sentence(30, 0.5, 0.6, 0.1, "shortest") == (
        "shortest: 50 % of 30 runs lost, 10 % collided, 95th percentile of the error 0.60 m."
    )
    assert "at most 33 % as often" in criterion_text() and "at most 10 % longer" in criterion_text()


def test_headlines() -> None:
    hard, easy = measured(15, 0.6), measured(0, 0.1)
    met, better = judged(measured(5, 0.3), hard), judged(measured(9, 0.5), hard)
    none, worse = judged(measured(15, 0.601), hard, 0.1), judged(measured(25, 0.9), hard)
    assert headline({"a": met, "b": better, "c": met}, "shortest") == (
        "a and c meet the criterion; b is better than shortest but misses the criterion."
    )
    assert headline({"a": judged(hard, hard, 0.1)}, "shortest") == "a makes no difference."
    assert headline({"a": judged(hard, hard, 0.0)}, "shortest") == "a is the same path as shortest."
    assert headline({"a": worse, "b": worse}, "shortest") == "a and b are worse than shortest."
    assert headline({"a": judged(easy, easy, 0.1)}, "shortest") == (
        "Nothing to gain, since on shortest no robot was lost and the 95th percentile of the error "
        "is 0.100 m; a makes no difference."
    )
    walls = measured(1, 0.6, collided=25), measured(1, 0.6, collided=24)
    assert headline({"a": judged(*walls, 0.1)}, "shortest").endswith(
        "no difference; but walls end runs early (80 % on shortest and 83 % on a)."
    )
    assert headline({}, "shortest") == "shortest is the only route; there is nothing to compare."
    assert none.effect == "worse"  # by a millimetre in every run: shown, however small
