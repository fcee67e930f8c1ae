"""VFH+ and DWA against situations whose answer is known, and what must hold in any."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

pytest.importorskip("gymnasium")

from ambinav.drive.robot import Robot
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_envs.policies.reactive.arcs import free_lengths, stopping_speed
from ambinav_envs.policies.reactive.dwa import Dwa
from ambinav_envs.policies.reactive.echoes import ScanPoints, nearest_by_direction
from ambinav_envs.policies.reactive.memory import EchoFilter, EchoMemory
from ambinav_envs.policies.reactive.parameters import DwaParameters, VfhParameters
from ambinav_envs.policies.reactive.situation import Situation
from ambinav_envs.policies.reactive.vfh import Vfh, free_run

Floats = NDArray[np.float64]

ROBOT, DT = Robot(radius=0.2), 0.1
BOTH = pytest.mark.parametrize("kind", ["vfh", "dwa"])
DISC = np.array([0.2])
LASER = RangeSensor(max_range=4.0, std=0.0, resolution=0.01)


def steering(kind: str) -> Vfh | Dwa:
    return Vfh(VfhParameters(), ROBOT, DT) if kind == "vfh" else Dwa(DwaParameters(), ROBOT, DT)


def situation(
    points: Floats, bearing: float = 0.0, speed: float = 0.0, rate: float = 0.0, **changed: Any
) -> Situation:
    """One robot among points, shape (P, 2), with a waypoint 1.5 m away."""
    values: dict[str, Any] = {
        "x": points[None, :, 0],
        "y": points[None, :, 1],
        "distance": np.array([1.5]),
        "bearing": np.array([bearing]),
        "speed": np.array([speed]),
        "rate": np.array([rate]),
        "turned": np.array([rate * DT]),
        "starts": np.array([True]),
    }
    return Situation(**{**values, **changed})


def driven(kind: str, points: Floats, goal: tuple[float, float], steps: int) -> Floats:
    """Poses of a robot that starts at (0, 0, 0) among points in the map frame, shape (steps, 3)."""
    made, pose, speed, rate, poses = steering(kind), np.zeros(3), 0.0, 0.0, []
    for step in range(steps):
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        turn = np.array([[cos, sin], [-sin, cos]])
        ahead = turn @ (np.array(goal) - pose[:2])
        now = situation(
            (points - pose[:2]) @ turn.T, math.atan2(ahead[1], ahead[0]), speed, rate,
            distance=np.array([math.hypot(*ahead)]), starts=np.array([step == 0]),
        )  # fmt: skip
        want = made.command(now)[0]
        assert 0.0 <= want[0] <= ROBOT.max_speed and abs(want[1]) <= ROBOT.max_turn_rate
        change, turning = ROBOT.acceleration * DT, ROBOT.turn_acceleration * DT
        speed = float(np.clip(want[0], speed - change, speed + change))
        rate = float(np.clip(want[1], rate - turning, rate + turning))
        middle = pose[2] + 0.5 * rate * DT
        pose = pose + np.array([math.cos(middle), math.sin(middle), 0.0]) * speed * DT
        pose[2] += rate * DT
        poses.append(pose)
    return np.array(poses)


def wall(x: float, low: float, high: float) -> Floats:
    """Points along a wall that the robot faces."""
    y = np.arange(low, high, 0.05)
    return np.stack([np.full_like(y, x), y], axis=1)


def door(width: float) -> Floats:
    """A wall 1 m ahead with an opening straight ahead."""
    return np.concatenate([wall(1.0, 0.5 * width, 9.0), wall(1.0, 0.5 * width, 9.0) * [1.0, -1.0]])


def ring(radius: float) -> Floats:
    angle = np.linspace(-math.pi, math.pi, 72, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


NOTHING = np.array([[-50.0, 0.0]])


@BOTH
def test_free_floor_is_driven_straight_at_full_speed(kind: str) -> None:
    poses = driven(kind, NOTHING, (3.0, 0.0), 20)
    assert np.abs(poses[:, 1]).max() < 1e-9
    assert poses[-1, 0] - poses[-2, 0] == pytest.approx(ROBOT.max_speed * DT)


@BOTH
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wall_ahead_is_passed_on_its_open_side(kind: str, side: float) -> None:
    points = wall(0.9, -1.5, 0.3) * [1.0, side]
    poses = driven(kind, points, (2.0, 0.0), 120)
    assert poses[-1, 0] > 1.2
    passing = poses[np.abs(poses[:, 0] - 0.9).argmin()]
    assert side * passing[1] > 0.3
    apart = np.hypot(*(poses[:, None, :2] - points).transpose(2, 0, 1))
    assert apart.min() > ROBOT.radius


@BOTH
def test_what_is_mirrored_is_driven_mirrored(kind: str) -> None:
    points = np.array([[0.8, 0.1], [1.1, -0.5], [0.3, 0.9]])
    one = steering(kind).command(situation(points, 0.3, 0.3, 0.4))[0]
    other = steering(kind).command(situation(points * [1.0, -1.0], -0.3, 0.3, -0.4))[0]
    assert other == pytest.approx(one * [1.0, -1.0], abs=1e-9)


@pytest.mark.slow
@BOTH
def test_a_door_is_passed_if_the_robot_fits(kind: str) -> None:
    through = driven(kind, door(0.7), (2.0, 0.0), 120)
    assert through[-1, 0] > 1.2
    narrow = driven(kind, door(0.38), (2.0, 0.0), 120)
    assert narrow[:, 0].max() < 1.0


@BOTH
@pytest.mark.parametrize("radius", [0.3, 0.5])
def test_who_is_closed_in_does_not_drive_into_the_wall(kind: str, radius: float) -> None:
    poses = driven(kind, ring(radius), (1.5, 0.0), 60)
    assert np.hypot(poses[:, 0], poses[:, 1]).max() <= radius - ROBOT.radius
    assert np.ptp(poses[-20:, 0]) < 1e-3


def test_all_sectors_blocked_is_to_stop() -> None:
    moving = situation(ring(0.3), 0.4, 0.5, 1.0)
    assert (Vfh(VfhParameters(), ROBOT, DT).command(moving) == 0.0).all()


def test_thresholds_have_hysteresis() -> None:
    """An obstacle between the two magnitudes blocks only if it blocked before."""
    parameters = VfhParameters(low=0.5, high=0.75, window=2.0)
    # Magnitude 1 - (d / 2)^2: 0.9375 at 0.5 m, 0.609 at 1.25 m, 0.19 at 1.8 m.
    near, between, far = (np.array([[d, 0.0]]) for d in (0.5, 1.25, 1.8))
    fresh = Vfh(parameters, ROBOT, DT)
    assert fresh.command(situation(between))[0, 1] == 0.0
    on = {"starts": np.array([False])}
    used = Vfh(parameters, ROBOT, DT)
    assert used.command(situation(near))[0, 1] != 0.0
    assert used.command(situation(between, **on))[0, 1] != 0.0
    assert used.command(situation(far, **on))[0, 1] == 0.0
    assert used.command(situation(between, **on))[0, 1] == 0.0
    assert used.command(situation(near))[0, 1] != 0.0
    # A new episode begins with all sectors free.
    assert used.command(situation(between))[0, 1] == 0.0


def test_turning_circles_mask_what_a_fast_robot_cannot_reach() -> None:
    """At 0.5 m/s its circle is 0.25 m wide: a post 0.3 m to the left is in the way of it."""
    post = np.array([[0.15, 0.3]])
    parameters = VfhParameters(clearance=0.0)
    for speed, turned in ((0.0, True), (0.5, False)):
        want = Vfh(parameters, ROBOT, DT).command(situation(post, 2.5, speed))
        assert bool(want[0, 1] > 0.0) is turned


def test_lengths_of_arcs_are_known() -> None:
    one = np.array([[1.0]]), np.array([[0.0]])
    assert free_lengths(*one, np.array([[0.0]]), DISC, 5.0)[0, 0] == pytest.approx(0.8)
    beside = np.array([[1.0]]), np.array([[0.21]])
    assert free_lengths(*beside, np.array([[0.0]]), DISC, 5.0)[0, 0] == 5.0
    # On the circle about (0, 1): a quarter of it, less the angle of a chord as long as the radius.
    found = free_lengths(np.array([[1.0]]), np.array([[1.0]]), np.array([[1.0]]), DISC, 5.0)
    assert found[0, 0] == pytest.approx(0.5 * math.pi - 2.0 * math.asin(0.1))
    # A point on the disc stops motion towards it alone.
    for x, length in ((0.1, 0.0), (-0.1, 5.0)):
        near = np.array([[x]]), np.array([[0.0]])
        assert free_lengths(*near, np.array([[0.0]]), DISC, 5.0)[0, 0] == length


def test_lengths_of_arcs_are_those_of_small_steps() -> None:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-1.5, 1.5, (2, 40, 3))
    far = np.hypot(x, y) > 0.25
    x, y = np.where(far, x, np.inf), np.where(far, y, np.inf)
    curvature = np.concatenate([rng.uniform(-4.0, 4.0, (40, 6)), np.zeros((40, 1))], axis=1)
    found = free_lengths(x, y, curvature, np.full(40, 0.2), 1.2)
    along = np.arange(0.0, 1.2, 1e-3)
    for i in range(40):
        for c in range(7):
            half = 0.5 * curvature[i, c] * along
            chord = along * np.sinc(half / math.pi)
            apart = np.hypot(
                x[i][:, None] - chord * np.cos(half), y[i][:, None] - chord * np.sin(half)
            ).min(axis=0)
            hit = np.flatnonzero(apart < 0.2)
            slow = along[hit[0]] if len(hit) else 1.2
            assert found[i, c] == pytest.approx(slow, abs=2e-3 + (0.05 if not len(hit) else 0.0))


@given(st.floats(0.0, 5.0), st.floats(0.1, 5.0), st.floats(0.01, 0.5))
def test_a_robot_stops_within_the_length(length: float, braking: float, dt: float) -> None:
    speed = float(stopping_speed(np.array(length), braking, dt))
    assert speed >= 0.0
    assert speed * dt + speed**2 / (2.0 * braking) == pytest.approx(length, abs=1e-9)


@given(st.lists(st.booleans(), min_size=2, max_size=30))
def test_runs_of_free_sectors(row: list[bool]) -> None:
    found = free_run(np.array([row]))[0]
    for k, blocked in enumerate(row):
        if not blocked:
            count = 0
            while count < len(row) - 1 and not row[(k + count + 1) % len(row)]:
                count += 1
            assert found[k] == count


@pytest.mark.slow
@BOTH
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_commands_are_finite_and_within_the_limits(kind: str, data: st.DataObject) -> None:
    number = st.floats(-3.0, 3.0) | st.just(math.inf)
    rows = data.draw(st.lists(st.tuples(number, number), min_size=1, max_size=12))
    points = np.array([row if np.isfinite(row).all() else (np.inf, np.inf) for row in rows])
    speed = data.draw(st.floats(0.0, ROBOT.max_speed))
    rate = data.draw(st.floats(-ROBOT.max_turn_rate, ROBOT.max_turn_rate))
    bearing = data.draw(st.floats(-math.pi, math.pi))
    distance = np.array([data.draw(st.floats(0.0, 100.0))])
    made = steering(kind)
    for start in (True, False):
        now = situation(
            points, bearing, speed, rate, distance=distance, starts=np.array([start])
        )  # fmt: skip
        want = made.command(now)
        assert np.isfinite(want).all()
        assert 0.0 <= want[0, 0] <= ROBOT.max_speed + 1e-12
        assert abs(want[0, 1]) <= ROBOT.max_turn_rate + 1e-12


@BOTH
def test_a_robot_of_many_does_as_it_does_alone(kind: str) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-2.0, 2.0, (2, 6, 20))
    bearing, speed = rng.uniform(-3.0, 3.0, 6), rng.uniform(0.0, 0.5, 6)
    rate, starts = rng.uniform(-2.0, 2.0, 6), np.ones(6, dtype=np.bool_)
    far = np.full(6, 1.5)
    whole = steering(kind).command(Situation(x, y, far, bearing, speed, rate, rate * DT, starts))
    for i in range(6):
        k = slice(i, i + 1)
        alone = steering(kind).command(
            Situation(x[k], y[k], far[k], bearing[k], speed[k], rate[k], rate[k] * DT, starts[k])
        )
        assert alone[0] == pytest.approx(whole[i], abs=1e-12)


def test_points_of_lasers_and_cones() -> None:
    scanner = RangeScanner.planar(LASER, 4, 2.0 * math.pi, (0.1, 0.0, 0.0))
    scan = np.array([[0.5, 1.0, 0.25, 0.0]], dtype=np.float32)
    x, y = ScanPoints(scanner).points(scan)
    # Beams look back, right, ahead and left from 0.1 m ahead of the middle.
    assert x[0] == pytest.approx([-1.9, np.inf, 1.1, 0.1])
    assert y[0] == pytest.approx([0.0, np.inf, 0.0, 0.0])
    cone = RangeSensor(max_range=3.0, std=0.0, resolution=0.01, aperture=math.radians(30.0))
    one = ScanPoints(RangeScanner.ring(cone, 1, 0.0))
    x, y = one.points(np.array([[0.5]], dtype=np.float32))
    assert np.hypot(x, y) == pytest.approx(1.5)
    assert np.degrees(np.arctan2(y, x)).min() == pytest.approx(-15.0)
    assert np.degrees(np.arctan2(y, x)).max() == pytest.approx(15.0)


def test_what_has_gone_out_of_view_is_remembered_where_it_is() -> None:
    ahead = ScanPoints(RangeScanner.planar(LASER, 31, math.radians(90.0)))
    assert not ahead.all_around
    memory = EchoMemory(ahead, 3.0, DT, 0.5)
    first, later = np.array([True]), np.array([False])
    zero, none = np.zeros(1), np.full((1, 1), np.inf)
    memory.recall(np.ones((1, 1)), np.zeros((1, 1)), zero, zero, first)
    # It stands still: the point is in view, so the present scan tells more.
    assert np.isinf(memory.recall(none, none, zero, zero, later)[0]).all()
    # On a quarter of the circle of radius 1 about (0, 1) the robot comes to (1, 1, 90 degrees).
    quarter = np.array([0.5 * math.pi])
    x, y = memory.recall(none, none, quarter, quarter, later)
    assert x[np.isfinite(x)] == pytest.approx([-1.0])
    assert y[np.isfinite(y)] == pytest.approx([0.0], abs=1e-12)
    x, y = memory.recall(none, none, zero, zero, first)
    assert np.isinf(x).all()


def test_an_echo_counts_when_a_second_one_is_there() -> None:
    made = EchoFilter()
    zero, moved = np.zeros(1), np.array([0.05])
    first, later = np.array([True]), np.array([False])

    def seen(x: float, start: NDArray[np.bool_]) -> float:
        points = np.array([[x]]), np.zeros((1, 1))
        return float(made.confirmed(*points, zero, moved, start)[0][0, 0])

    assert seen(1.0, first) == 1.0
    assert seen(0.95, later) == 0.95
    # A random reading, and the wall again: only what comes twice in a row.
    assert seen(0.1, later) == math.inf
    assert seen(0.85, later) == math.inf
    assert seen(0.8, later) == 0.8
    assert seen(math.inf, later) == math.inf
    assert seen(0.1, first) == 0.1


def test_thinned_out_points_are_the_nearest() -> None:
    angle = np.radians([10.0, 11.0, 100.0, -10.0, 12.0])
    far = np.array([[2.0, 1.0, 3.0, np.inf, 1.5]])
    cos, sin = np.cos(angle), np.sin(angle)
    gone = np.isinf(far)
    x, y = np.where(gone, np.inf, far * cos), np.where(gone, np.inf, far * sin)
    near_x, near_y = nearest_by_direction(x, y, 4)
    assert np.sort(np.hypot(near_x, near_y)[0]) == pytest.approx([1.0, 3.0, np.inf, np.inf])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sectors": 3}, "sectors is 3; give 8 or more"),
        ({"low": 0.8}, "give at least low and below 1"),
        ({"window": -1.0}, "window"),
    ],
)
def test_bad_parameters(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        VfhParameters(**values)


def test_bad_samples() -> None:
    with pytest.raises(InputError, match="odd number"):
        DwaParameters(rates=4)
