"""The state of a robot: thresholds, hysteresis, and the online measure at known places."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from ambinav_ros.monitor import Localizability, Monitor, State, Thresholds, measure

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

USUAL = Thresholds(warn=0.1, error=0.2, explained=0.5, hysteresis=0.2)


def seen(along: float = 0.01, explained: float = 1.0) -> Localizability:
    return Localizability(along, 0.01, 0.0, explained, 60)


def states(values, **changes) -> list[str]:
    monitor = Monitor(USUAL)
    return [monitor.update(seen(**{**changes, "along": value})).name for value in values]


def test_states_are_entered_at_their_thresholds():
    assert states([0.05, 0.1, 0.19, 0.2, 0.5]) == ["OK", "WARN", "WARN", "ERROR", "ERROR"]
    assert states([0.5]) == ["ERROR"]


def test_states_are_left_only_when_clearly_better():
    assert states([0.1, 0.09, 0.0801, 0.0799, 0.09]) == ["WARN", "WARN", "WARN", "OK", "OK"]
    assert states([0.2, 0.17, 0.159, 0.17]) == ["ERROR", "ERROR", "WARN", "WARN"]
    assert states([0.2, 0.01]) == ["ERROR", "OK"]


def test_a_value_that_trembles_does_not_make_the_state_tremble():
    rng = np.random.default_rng(1)
    walk = 0.1 + 0.015 * rng.standard_normal(400)
    found = states(walk)
    plain = ["WARN" if value >= 0.1 else "OK" for value in walk]
    changes = [sum(a != b for a, b in itertools.pairwise(s)) for s in (found, plain)]
    assert changes[1] > 100 and changes[0] < changes[1] / 3


def test_echoes_that_the_map_does_not_explain_are_a_warning():
    monitor = Monitor(USUAL)
    shares = [1.0, 0.49, 0.55, 0.59, 0.61, 0.55, math.nan]
    found = [monitor.update(seen(explained=share)).name for share in shares]
    assert found == ["OK", "WARN", "WARN", "WARN", "OK", "OK", "OK"]
    assert monitor.update(seen(along=0.3, explained=0.1)) is State.ERROR
    assert "0.30 m along 0 degrees" in monitor.text and "explains 10%" in monitor.text


def test_stale_begins_anew():
    monitor = Monitor(USUAL)
    assert (monitor.state, monitor.text) == (State.STALE, "no scan yet")
    monitor.update(seen(along=0.1))
    assert monitor.stale("no pose") is State.STALE and monitor.text == "no pose"
    assert monitor.update(seen(along=0.09)) is State.OK


@pytest.mark.parametrize(
    "bad",
    [
        {"warn": 0.0}, {"warn": 0.3}, {"error": math.inf}, {"error": math.nan},
        {"explained": 1.0}, {"hysteresis": -0.1}, {"hysteresis": 1.0},
    ],
)  # fmt: skip
def test_thresholds_that_cannot_be_used_are_refused(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        Thresholds(**bad)


def test_a_corridor_is_weak_along_itself_and_a_room_is_not():
    floor = [(0, 0), (5, 0), (5, 1.5), (45, 1.5), (45, 3.5), (5, 3.5), (5, 5), (0, 5)]
    environment = environment_from_shapes([shapely.Polygon(floor)])
    sensor = RangeSensor(max_range=8.0, std=0.02, resolution=0.001)
    scanner = RangeScanner.planar(sensor, 90, math.tau)
    rng = np.random.default_rng(2)
    monitor = Monitor(Thresholds())
    found = {}
    for name, pose in {"room": (2.5, 2.5, 0.3), "corridor": (25.0, 2.5, 1.0)}.items():
        ranges = scanner.read(environment, *np.array([pose]).T, rng)[0]
        now = measure(environment, scanner, pose, ranges, (0.5, 0.5, 0.26), (0.05, 0.05, 0.02))
        found[name] = monitor.update(now)
        assert now.beams == 90
    assert found == {"room": State.OK, "corridor": State.ERROR}
    assert now.along == pytest.approx(0.5, abs=0.01)  # the prior, as it was
    assert now.across < 0.05
    assert min(now.direction, math.pi - now.direction) < 0.05
    assert now.explained > 0.8
