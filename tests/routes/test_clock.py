"""Speed profiles: closed forms, limits held by finite differences, what must not matter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambinav.geometry.motion.steering import Steering
from ambinav.routes.clock import SpeedLimits, SpeedProfile, speed_profile
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError

STEERINGS = (
    Steering("r2"), Steering("se2"), Steering("dubins", 0.4), Steering("reeds-shepp", 0.4)
)  # fmt: skip
ROUNDING = 1e-9
number = st.floats(-4.0, 4.0)
poses = st.lists(st.tuples(number, number, st.floats(-6.0, 6.0)), min_size=2, max_size=6)
limits = st.builds(
    SpeedLimits,
    max_speed=st.floats(0.1, 2.0),
    acceleration=st.floats(0.1, 3.0),
    max_turn_rate=st.floats(0.2, 3.0),
    turn_acceleration=st.none() | st.floats(0.2, 5.0),
    lateral_acceleration=st.none() | st.floats(0.05, 2.0),
)


def check(profile: SpeedProfile, held: SpeedLimits, arcs: bool) -> None:
    """Hold stamped points against limits: nothing of the package but the points is used."""
    x, y, heading = profile.poses.T
    stamps = profile.stamps
    seconds = np.diff(stamps)
    assert (seconds > 0.0).all()
    steps = np.hypot(np.diff(x), np.diff(y))
    turned = np.abs(np.diff(heading))
    if arcs:  # not the chords
        steps = steps / np.sinc(0.5 * turned / math.pi)
    speed = steps / seconds
    assert speed.max() <= held.max_speed + 1e-6
    assert (turned / seconds).max() <= held.max_turn_rate * (1.0 + ROUNDING)
    # Means over pieces: their difference is at most that of a ramp between the pieces' middles.
    middles = 0.5 * (stamps[1:] + stamps[:-1])
    rates = np.abs(np.diff(speed)) / np.diff(middles)
    assert rates.max(initial=0.0) <= held.acceleration + 1e-4
    # It begins and ends at rest: no more than a ramp is driven in the first and the last piece.
    for k in (0, -1):
        assert steps[k] <= 0.5 * held.acceleration * seconds[k] ** 2 * (1.0 + 1e-6) + ROUNDING
    if held.lateral_acceleration is not None and arcs:
        # All along each piece, also where it meets one that turns to the other side.
        fastest = np.maximum(profile.speeds[:-1], profile.speeds[1:])
        across = fastest**2 * (turned / steps)
        assert across.max(initial=0.0) <= held.lateral_acceleration * (1.0 + 1e-6) + ROUNDING
    elif held.lateral_acceleration is not None:
        along = np.arctan2(np.diff(y), np.diff(x))
        bend = np.abs((np.diff(along) + math.pi) % (2.0 * math.pi) - math.pi)
        # Where it stands between two pieces (cusps, turns on the spot) it is free to leave aside.
        driven = (profile.speeds[1:-1] > 0.0) & (steps[1:] > 0.0) & (steps[:-1] > 0.0)
        metres = 0.5 * (steps[1:] + steps[:-1])
        across = profile.speeds[1:-1][driven] ** 2 * (bend[driven] / metres[driven])
        assert across.max(initial=0.0) <= held.lateral_acceleration * 1.01 + ROUNDING


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(poses=poses, steering=st.sampled_from(STEERINGS), held=limits)
@example(
    poses=[(0.0, 0.0, 0.0), (0.0, 0.0, 2e-311), (0.0, 1.0, 0.0)],
    steering=Steering("se2"),
    held=SpeedLimits(max_speed=1.0, acceleration=1.0, max_turn_rate=1.0),
)
@example(
    poses=[(0.0, 0.0, 0.0), (0.5, 0.5, math.pi / 2), (1.0, 1.0, 0.0)],
    steering=Steering("dubins", 0.5),
    held=SpeedLimits(max_speed=1.0, acceleration=2.5, max_turn_rate=5.0, lateral_acceleration=0.25),
)
def test_stamped_points_keep_to_the_limits(poses, steering, held):
    profile = speed_profile(poses, steering, held)
    assert len(profile.vertices) == len(poses)
    if profile.duration > 0.0:
        kept = np.append(np.diff(profile.stamps) > 0.0, True)
        rows = (profile.poses, profile.distance, profile.stamps, profile.speeds)
        check(SpeedProfile(*(row[kept] for row in rows), profile.vertices), held, steering.turns)
    at = profile.poses[profile.vertices]
    assert np.abs(at[:, :2] - np.array(poses)[:, :2]).max() < 1e-6


@pytest.mark.parametrize("length", [1.0, 3.0, 10.0])
@pytest.mark.parametrize(("speed", "gain"), [(1.0, 0.5), (0.5, 0.25), (2.0, 1.0)])
def test_a_straight_line_is_a_trapezoid_or_a_triangle(length, speed, gain):
    held = SpeedLimits(max_speed=speed, acceleration=gain)
    profile = speed_profile([[0, 0, 0], [length, 0, 0]], Steering(), held)
    reached = speed**2 / gain <= length
    due = length / speed + speed / gain if reached else 2.0 * math.sqrt(length / gain)
    assert profile.duration == pytest.approx(due, rel=1e-12)
    assert profile.speeds.max() == pytest.approx(min(speed, math.sqrt(gain * length)), rel=1e-12)


def test_a_ramp_that_ends_between_points_costs_little():
    held = SpeedLimits(max_speed=0.37, acceleration=1.3)
    profile = speed_profile([[0, 0, 0], [5.01, 0, 0]], Steering(), held)
    exact = 5.01 / 0.37 + 0.37 / 1.3
    assert exact < profile.duration < exact + 2 * 0.05 / 0.37


@pytest.mark.parametrize(
    ("gain", "due"),
    [
        (None, (math.pi / 2) / 0.5),
        (0.5, (math.pi / 2) / 0.5 + 0.5 / 0.5),
        (0.1, 2.0 * math.sqrt((math.pi / 2) / 0.1)),
    ],
)
def test_a_turn_on_the_spot_is_a_trapezoid_too(gain, due):
    held = SpeedLimits(max_turn_rate=0.5, turn_acceleration=gain)
    turn = [[0.0, 0.0, 0.0], [0.0, 0.0, math.pi / 2]]
    assert speed_profile(turn, Steering("se2"), held).duration == pytest.approx(due)
    corner = [[0, 0, 0], [2, 0, 0], [2, 2, 0]]
    straight = speed_profile([[0, 0, 0], [2, 0, 0]], Steering(), held).duration
    profile = speed_profile(corner, Steering(), held)
    assert profile.duration == pytest.approx(2.0 * straight + due)
    # A pose of the route is reached when the robot looks along what follows.
    assert profile.stamps[profile.vertices].tolist() == pytest.approx(
        [0.0, straight + due, 2.0 * straight + due]
    )


def test_lateral_acceleration_bounds_the_speed_on_an_arc():
    arc = [[0.0, 0.0, 0.0], [2.0, 2.0, math.pi / 2]]
    held = SpeedLimits(max_speed=5.0, acceleration=5.0, lateral_acceleration=0.18)
    profile = speed_profile(arc, Steering("dubins", 2.0), held)
    assert profile.speeds.max() == pytest.approx(math.sqrt(0.18 * 2.0), rel=1e-3)


def test_a_stop_on_the_way_costs_a_ramp_down_and_up():
    line = [[0, 0, 0], [3, 0, 0], [6, 0, 0]]
    freely = speed_profile(line, Steering())
    stopped = speed_profile(line, Steering(), stops=[1])
    assert stopped.speeds[stopped.vertices[1]] == 0.0
    assert stopped.duration - freely.duration == pytest.approx(0.5 / 2.5)
    legs = [Route.through(line[k : k + 2]).timed() for k in (0, 1)]
    assert stopped.duration == pytest.approx(sum(leg.duration for leg in legs))
    for stop in (-1, 3):
        with pytest.raises(InputError, match="the route has the poses 0 to 2"):
            speed_profile(line, Steering(), stops=[stop])


def test_a_bound_holds_where_it_is_given():
    line = [[0, 0, 0], [6, 0, 0]]
    bound = [[0.0, 0.5], [2.0, 0.5], [2.0, 0.1], [3.0, 0.1], [3.0, 0.5]]
    profile = speed_profile(line, Steering(), bound=bound)
    inside = (profile.distance > 2.0) & (profile.distance < 3.0)
    assert profile.speeds[inside].max() <= 0.1 + ROUNDING
    assert profile.duration == pytest.approx(5.0 / 0.5 + 1.0 / 0.1, abs=0.2)
    assert speed_profile(line, Steering(), bound=[[9.0, 0.25]]).speeds.max() == 0.25


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 9999), turn=st.floats(-3.0, 3.0), dx=number, dy=number, held=limits)
def test_neither_frame_nor_direction_matters(seed, turn, dx, dy, held):
    # Drawn evenly, so that no corner is sharp by a rounding error alone.
    points = np.random.default_rng(seed).uniform(-4.0, 4.0, (5, 3))
    moved = points + np.array([dx, dy, turn])
    moved[:, 0] = math.cos(turn) * points[:, 0] - math.sin(turn) * points[:, 1] + dx
    moved[:, 1] = math.sin(turn) * points[:, 0] + math.cos(turn) * points[:, 1] + dy
    due = speed_profile(points, Steering(), held).duration
    assert speed_profile(points[::-1], Steering(), held).duration == pytest.approx(due, rel=1e-6)
    assert speed_profile(moved, Steering(), held).duration == pytest.approx(due, rel=1e-6)
    car = Steering("reeds-shepp", 0.4)
    due = speed_profile(points, car, held).duration
    assert speed_profile(moved, car, held).duration == pytest.approx(due, rel=1e-6)


def test_energy_is_an_integral_over_the_profile():
    held = SpeedLimits(max_speed=1.0, acceleration=0.5)
    profile = speed_profile([[0, 0, 0], [10, 0, 0]], Steering(), held)
    # A mass of 2 kg on a level floor gains and gives back m v^2 / 2.
    assert profile.integral(lambda v, a: 2.0 * v * a) == pytest.approx(0.0, abs=1e-12)
    assert profile.integral(lambda v, a: 2.0 * v * np.maximum(a, 0.0)) == pytest.approx(1.0)
    # Rolling resistance times the distance, drag v^3 by hand, standby power.
    assert profile.integral(lambda v, a: 3.0 * v) == pytest.approx(30.0)
    assert profile.integral(lambda v, a: v**3) == pytest.approx(8.0 + 2.0 * 2.0**4 * 0.5**3 / 4.0)
    assert profile.integral(lambda v, a: 5.0) == pytest.approx(5.0 * profile.duration)
    with pytest.raises(InputError, match="power returned"):
        profile.integral(lambda v, a: np.full_like(v, np.nan))
    with pytest.raises(InputError, match=r"shape \(2,\)"):
        profile.integral(lambda v, a: np.ones(2))


@pytest.mark.parametrize("name", ["max_speed", "acceleration", "max_turn_rate"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_are_numbers_above_zero(name, value):
    with pytest.raises(InputError, match=f"{name} is {value:g}.*above 0"):
        replace(SpeedLimits(), **{name: value})


@pytest.mark.parametrize("limits", [{"max_speed": 1e-300}, {"max_turn_rate": 1e-310}])
def test_a_drive_without_an_end_is_refused(limits):
    with pytest.raises(InputError, match="give higher limits"):
        speed_profile([(0, 0, 0), (1, 0, 0), (1, 1, 0)], Steering(), SpeedLimits(**limits))


@pytest.mark.parametrize("bound", [[], [1.0, 2.0], [[0.0, 0.0]], [[1.0, 1.0], [0.0, 1.0]]])
def test_a_bound_of_no_use_is_refused(bound):
    with pytest.raises(InputError, match="bound has"):
        speed_profile([[0, 0, 0], [1, 0, 0]], Steering(), bound=bound)
    with pytest.raises(InputError, match="needs a start and a goal"):
        speed_profile([[0, 0, 0]], Steering())


@pytest.mark.parametrize("apart", [1e-16, 1e-12, 1e-8, 1e-4])
def test_cusps_and_stops_may_be_as_near_as_rounding_makes_them(apart):
    there_and_back = [[0, 0, 0], [1, 0, 0], [1 + apart, 0, 0], [0, 0, 0]]
    profile = speed_profile(there_and_back, Steering("se2"), stops=[1, 2])
    assert profile.duration == pytest.approx(2.0 * (1.0 / 0.5 + 0.5 / 2.5), abs=0.02)
