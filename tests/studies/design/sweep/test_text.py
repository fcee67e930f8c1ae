"""What is printed of a sweep agrees with itself, digit by digit."""

from __future__ import annotations

import itertools
import math
import re

import pytest

import ambinav as an
from ambinav.drive.bootstrap import Interval
from ambinav.studies.design.sweep.figures import Criterion
from ambinav.studies.design.sweep.sweep import SweepResult, sweep_scanner
from ambinav.studies.design.sweep.text import Numbers, Words, setting_text, share_text, values_text
from tests.geometry import scenes

LASER = an.RangeSensor(name="laser", max_range=5.0, std=0.03, resolution=0.001)
FAN = an.RangeScanner.planar(LASER, 19, math.radians(90), name="fan")
CLOSED = Interval(math.nan, math.nan, math.nan, 1)


def test_a_margin_is_the_difference_of_what_is_printed() -> None:
    # 0.0022 apart, which alone would be 0.002.
    numbers = Numbers(3)
    assert [numbers.value(one) for one in (0.1234, 0.1256)] == ["0.123", "0.126"]
    assert numbers.difference(0.1256, 0.1234, CLOSED) == "0.003"
    shares = Numbers(3, percent=True)
    assert [shares.value(one) for one in (0.12344, 0.12356)] == ["12.3 %", "12.4 %"]
    assert shares.difference(0.12356, 0.12344, CLOSED) == "0.1 points"


def test_an_end_of_an_interval_is_0_only_if_it_is() -> None:
    low = Interval(0.0042, 0.0002, 0.0082, 9)
    assert Numbers(3).difference(0.2042, 0.2, low) == "0.004 [0.0002, 0.008]"
    none = Interval(0.0042, 0.0, 0.0082, 9)
    assert Numbers(3).difference(0.2042, 0.2, none) == "0.004 [0.000, 0.008]"
    below = Interval(0.0042, -0.00031, 0.0082, 9)
    assert Numbers(3).difference(0.2042, 0.2, below) == "0.004 [-0.0003, 0.008]"


def test_a_share_is_all_or_nothing_only_if_it_is() -> None:
    texts = [share_text(one) for one in (0.0, 0.5, 0.9996, 0.99999, 1.0)]
    assert texts == ["0.0 %", "50.0 %", "99.96 %", "99.999 %", "100.0 %"]


def printed(words: Words, found: SweepResult) -> list[float]:
    return [
        float(words.numbers.value(found.outcomes[i].figures.of(found.criterion)).split()[0])
        for i in found.order
    ]


@pytest.mark.parametrize("criterion", ["mean", "p95", "worst", "bad"])
def test_sentences_hold_as_printed(criterion: Criterion) -> None:
    env = scenes.scene(4, size=4.0, blocks=3, thin=1)
    vary = ["aperture=60:360:150", "std=0.03,0.0301,0.0302"]
    for places in (0, 40):
        found = sweep_scanner(
            env, FAN, vary, places=places, criterion=criterion, spacing=0.25, headings=2
        )
        words = Words(found)
        best, *others = printed(words, found)
        for number, value in zip(found.order[1:], others, strict=True):
            margin = float(re.split(r"[ \[]", words.margin(number))[0])
            assert margin == pytest.approx(value - best, abs=1e-9)
            assert (margin == 0.0) == (found.margin(number).value == 0.0)
        assert found.order[0] in found.as_good
        assert ("do not distinguish" in words.summary) <= found.levels.places.is_sample
        assert words.summary.startswith("Of 9 settings of fan in scene")


@pytest.mark.slow
def test_fewer_beams_are_best_for_a_reason_that_is_given() -> None:
    reasons = set[str]()
    criteria: tuple[Criterion, ...] = "mean", "p95", "bad"
    around = an.RangeScanner.planar(LASER, 60, math.tau, name="around")
    vary = ["max_range=1,2", "beams=20,24,30,40,60"]
    for seed, places, criterion in itertools.product(range(4), (0, 12), criteria):
        env = scenes.scene(seed, size=4.0, blocks=3, thin=1)
        found = sweep_scanner(env, around, vary, places=places, criterion=criterion, spacing=0.25)
        reach, beams = found.best.setting.values
        others = [
            found.outcomes[i].setting.values
            for i in found.order[1:]
            if not math.isnan(found.margin(i).value)
        ]
        text = Words(found).summary
        fewer = any(other[0] == reach and other[1] > beams for other in others)
        assert ("ore beams (" in text) == fewer
        reasons |= {part for part in ("is not shown: prefer", "has more weight") if part in text}
    assert len(reasons) == 2


def test_the_same_beams_are_named_once() -> None:
    env = scenes.room(4.0, 3.0)
    around = an.RangeScanner.planar(LASER, 120, 2 * math.pi, name="around")
    found = sweep_scanner(env, around, ["yaw=0:315:45", "beams=30,60,120,240"], places=20)
    assert len(found.order) == 2
    assert setting_text(found, 0) == "any yaw, beams 30"
    assert setting_text(found, 1) == "any yaw, beams 60 to 240"
    assert values_text(found, 1) == ("any", "60 to 240")
    text = Words(found).summary
    assert text.startswith("Of 32 settings of around in scene, 2 of them with different beams, the")
    ring = sweep_scanner(env, an.RangeScanner.ring(LASER, 8, 0.1), ["yaw=0:60:15"], places=20)
    assert {setting_text(ring, i) for i in ring.order} == {
        "yaw 0, 45°", "yaw 15, 60°", "yaw 30°"
    }  # fmt: skip
    same = sweep_scanner(env, around, ["yaw=0,10"], places=20)
    assert Words(same).summary.startswith("Both settings of around in scene have the same beams")
    one = sweep_scanner(env, around, ["yaw=10"], places=20)
    assert Words(one).summary.startswith("around in scene with yaw 10°: mean level ")
    assert Words(one).summary.endswith(
        "The present scanner is equally good: it has the same beams."
    )
