"""The follower on courses whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.config import from_mapping
from ambinav.drive.course import Course
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.follower import ARRIVED, FOLLOWING, TURNING, limited, pursue
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.robot import Robot
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from tests.drive.cases import from_polyline, laser, route_through
from tests.geometry.scenes import room

DT = 0.1
LIMITS = Robot().limits


def command(course: Course, pose: tuple[float, float, float], **changes: object) -> tuple:
    """The command to a robot at a pose, at the start of the course."""
    p = FollowerParameters(**changes).packed
    return pursue(
        *pose, 0.0, 0.0, 0, FOLLOWING, course.arrays, course.goal, course.turns, p, LIMITS, DT
    )


def driven(poses: object, steering: Steering | None = None, **options: object) -> Drives:
    """One drive of a robot that knows where it is."""
    return drive_route(
        room(14.0, 14.0), laser(), Robot(), route_through(poses, steering), "perfect",
        np.random.default_rng(0), 1, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def straight() -> Course:
    return Course.of(np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]]), Steering())


def test_a_course_has_the_route_s_length_and_no_point_twice() -> None:
    course = Course.of(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]]), Steering())
    assert course.length == pytest.approx(7.0)
    assert np.hypot(*np.diff(course.points, axis=0).T).min() > 0.0
    assert (course.directions == 1.0).all()
    assert (course.end == len(course.directions)).all()
    assert course.goal == (3.0, 4.0, math.pi / 2)
    assert not course.turns


def test_a_course_is_cut_at_its_cusps() -> None:
    # Reverse straight back, then forwards: one cusp.
    steering = Steering("reeds-shepp", 0.5)
    course = Course.of(np.array([[3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0]]), steering)
    cusp = int(np.flatnonzero(np.diff(course.directions))[0]) + 1
    assert course.points[cusp] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert set(course.end[:cusp]) == {cusp}
    assert set(course.end[cusp:]) == {len(course.directions)}
    assert course.turns


@pytest.mark.parametrize("poses", [[[0.0, 0.0, 0.0]], [[1.0, 1.0, 0.0], [1.0, 1.0, 2.0]]])
def test_a_course_needs_some_way_to_go(poses: list[list[float]]) -> None:
    with pytest.raises(InputError, match="poses"):
        Course.of(np.array(poses), Steering())


@pytest.mark.parametrize("beside", [-0.3, -0.1, 0.0, 0.2])
@pytest.mark.parametrize("lookahead", [0.5, 0.6, 1.0])
def test_the_curvature_is_that_of_the_arc_to_the_carrot(
    straight: Course, beside: float, lookahead: float
) -> None:
    """Coulter 1992: an arc through a point y aside at distance L has the curvature 2 y / L^2."""
    speed, rate, _, _ = command(
        straight, (2.0, beside, 0.0), lookahead_dist=lookahead, max_robot_pose_search_dist=5.0
    )
    assert rate / speed == pytest.approx(-2.0 * beside / lookahead**2, abs=1e-12)


def test_the_speed_falls_in_bends_and_before_the_goal(straight: Course) -> None:
    # Curvature 2 * 0.3 / 0.36 = 5/3, radius 0.6 m of 0.9 m: two thirds of 0.5 m/s.
    far = {"lookahead_dist": 0.6}
    assert command(straight, (2.0, -0.3, 0.0), **far)[0] == pytest.approx(0.5 * 0.6 / 0.9)
    # Not below the least one: radius 0.36 m would be 0.2 m/s.
    assert command(straight, (2.0, -0.5, 0.0), **far, rotate_to_heading_min_angle=3.0)[0] == 0.25
    near = {"max_robot_pose_search_dist": 20.0}
    assert command(straight, (9.7, 0.0, 0.0), **near)[0] == pytest.approx(0.25)
    assert command(straight, (9.7, 0.0, 0.0), **near, xy_goal_tolerance=0.01)[0] == pytest.approx(
        0.25
    )
    slow = command(straight, (9.98, 0.0, 0.0), **near, xy_goal_tolerance=0.01)
    assert slow[0] == 0.05


def test_it_turns_on_the_spot_where_the_way_goes_off_sideways(straight: Course) -> None:
    speed, rate, _, stage = command(straight, (2.0, 0.0, 1.0))
    assert speed == 0.0 and rate == pytest.approx(-LIMITS[3] * DT) and stage == FOLLOWING
    speed, rate, _, _ = command(straight, (2.0, 0.0, 1.0), use_rotate_to_heading=False)
    assert speed > 0.0 and rate < 0.0


def test_it_arrives_within_the_tolerance_and_looks_along_the_goal() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 1.5]])
    there = {"max_robot_pose_search_dist": 20.0}
    r2, se2 = Course.of(poses, Steering()), Course.of(poses, Steering("se2"))
    assert command(r2, (9.8, 0.0, 0.0), **there)[3] == ARRIVED
    assert command(r2, (9.7, 0.0, 0.0), **there)[3] == FOLLOWING
    assert command(se2, (9.8, 0.0, 0.0), **there)[3] == TURNING
    assert command(se2, (9.8, 0.0, 1.3), **there)[3] == ARRIVED
    ends = driven([[1.0, 1.0, 0.0], [5.0, 1.0, 1.5]], Steering("se2"))
    assert ends.reached.all()
    assert abs(ends.truth[0, -1, 2] - 1.5) < 0.3


def test_a_straight_route_is_followed_to_a_millimetre() -> None:
    line = [[1.0, 2.0], [12.0, 7.0]]
    run = driven(line)
    assert run.reached.all()
    assert from_polyline(run.truth[0, :, :2], line).max() < 1e-3


def test_a_start_beside_the_route_is_made_good() -> None:
    """For small offsets pure pursuit is y'' = -2 y / L^2 - 2 y' / L: it decays with exp(-s / L)."""
    course = Course.of(np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]]), Steering())
    p = FollowerParameters(lookahead_dist=0.6).packed
    x, y, t, piece = 0.0, 0.05, 0.0, 0
    for _ in range(1000):
        speed, rate, piece, _ = pursue(
            x, y, t, 0.5, 0.0, piece, FOLLOWING, course.arrays, course.goal, False, p, LIMITS, 0.01
        )
        x, y, t = x + 0.01 * math.cos(t) * speed, y + 0.01 * math.sin(t) * speed, t + 0.01 * rate
        if x < 6.0:
            decay = 0.05 * math.exp(-x / 0.6) * (math.cos(x / 0.6) + math.sin(x / 0.6))
            assert y == pytest.approx(decay, abs=2e-3)


@pytest.mark.parametrize("radius", [1.5, 2.5, 4.0])
def test_a_circle_is_tracked_to_the_sagitta_of_its_chords(radius: float) -> None:
    """On a circle of radius r the arc to the carrot is the circle's own.

    A carrot on a chord of h = 5 cm is at most h^2 / 8 r inside of it, and so is the robot.
    """
    angles = np.linspace(0.0, 1.6 * math.pi, 9)
    x, y = 7.0 + radius * np.sin(angles), 7.0 - radius * np.cos(angles)
    run = driven(np.column_stack([x, y, angles]), Steering("dubins", radius))
    assert run.reached.all()
    off = np.hypot(run.truth[0, :, 0] - 7.0, run.truth[0, :, 1] - 7.0) - radius
    sagitta = 0.05**2 / (8.0 * radius)
    assert -2.0 * sagitta < off.min() and off.max() < 2.0 * sagitta


def test_a_route_with_a_cusp_is_driven_backwards_and_forwards() -> None:
    steering = Steering("reeds-shepp", 0.8)
    poses = [[6.0, 3.0, 0.0], [3.0, 3.0, 0.0], [8.0, 5.0, 0.5]]
    run = driven(poses, steering)
    assert run.reached.all()
    dense = steering.dense(np.array(poses), 0.02)[0]
    assert from_polyline(run.truth[0, :, :2], dense).max() < 0.1
    truth = run.truth[0]
    steps = np.diff(truth[:, :2], axis=0)
    ahead = np.cos(truth[:-1, 2]) * steps[:, 0] + np.sin(truth[:-1, 2]) * steps[:, 1]
    assert ahead.min() < -0.02 < 0.02 < ahead.max()
    assert truth[:, 0].min() == pytest.approx(3.0, abs=0.15)


def test_a_route_that_ends_where_it_begins_is_driven_all_round() -> None:
    run = driven([[2.0, 2.0], [8.0, 2.0], [8.0, 8.0], [2.0, 8.0], [2.0, 2.0]])
    assert run.reached.all()
    assert run.seconds[0] > 24.0 / 0.5 * 0.9


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(
    st.floats(-0.5, 0.5), st.floats(-2.0, 2.0), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0),
    st.floats(0.01, 0.5),
)  # fmt: skip
def test_limits_hold_whatever_is_commanded(
    speed: float, rate: float, want_speed: float, want_rate: float, dt: float
) -> None:
    most, fastest, acceleration, turn_acceleration = LIMITS
    v, w = limited(speed, rate, want_speed, want_rate, LIMITS, dt)
    assert abs(v) <= most + 1e-12 and abs(w) <= fastest + 1e-12
    assert abs(v - speed) <= acceleration * dt + 1e-12
    assert abs(w - rate) <= turn_acceleration * dt + 1e-12


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.floats(1.0, 13.0), st.floats(1.0, 13.0)), min_size=2, max_size=4))
def test_limits_hold_on_a_drive(places: list[tuple[float, float]]) -> None:
    if math.dist(places[0], places[-1]) < 0.5:
        return
    run = driven(places, max_time=60.0)
    truth, n = run.truth[0], int(run.samples[0])
    steps = np.hypot(*np.diff(truth[:n, :2], axis=0).T)
    turns = np.abs((np.diff(truth[:n, 2]) + math.pi) % (2 * math.pi) - math.pi)
    assert (steps <= 0.5 * DT + 1e-9).all()
    assert (turns <= 2.0 * DT + 1e-9).all()
    # A chord is shorter than its arc by a factor of at least sin(0.1) / 0.1.
    assert (np.abs(np.diff(steps)) <= 2.5 * DT * DT + 1e-4).all()
    assert (np.abs(np.diff(turns)) <= 3.2 * DT * DT + 1e-9).all()


def test_parameters_have_nav2_s_names_and_defaults() -> None:
    p = FollowerParameters(lookahead_dist=0.8, use_rotate_to_heading=False)
    assert (p.lookahead_dist, p.use_rotate_to_heading) == (0.8, False)
    assert (p.desired_linear_vel, p.lookahead_time, p.rotate_to_heading_min_angle) == (
        0.5, 1.5, 0.785,
    )  # fmt: skip
    assert (p.min_lookahead_dist, p.max_lookahead_dist) == (0.3, 0.9)
    assert (p.regulated_linear_scaling_min_radius, p.regulated_linear_scaling_min_speed) == (
        0.9, 0.25,
    )  # fmt: skip


def test_the_lookahead_grows_with_the_speed_if_asked(straight: Course) -> None:
    p = FollowerParameters(use_velocity_scaled_lookahead_dist=True).packed
    for speed, lookahead in ((0.0, 0.3), (0.4, 0.6), (2.0, 0.9)):
        want, rate, _, _ = pursue(
            1.0, -0.1, 0.0, speed, 0.0, 0, FOLLOWING, straight.arrays, straight.goal, False, p,
            LIMITS, DT,
        )  # fmt: skip
        assert rate / want == pytest.approx(0.2 / lookahead**2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lookahead_distance": 1.0}, "did you mean .*lookahead_dist"),
        ({"lookahead_dist": -1.0}, "lookahead_dist is -1.0; give a number above 0"),
        ({"lookahead_time": math.nan}, "lookahead_time is nan"),
        ({"lookahead_time": True}, "give a number"),
        ({"use_rotate_to_heading": 1.0}, "give true or false"),
        ({"min_lookahead_dist": 2.0}, "at most max_lookahead_dist"),
    ],
)
def test_bad_parameters_are_refused(values: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        from_mapping(FollowerParameters, values)


@pytest.mark.parametrize("field", ["radius", "max_speed", "max_turn_rate", "acceleration"])
def test_a_robot_needs_sensible_numbers(field: str) -> None:
    for value in (-0.1, math.nan, math.inf):
        with pytest.raises(InputError, match=f"robot: {field} is"):
            Robot(**{field: value})
    for odd in (None, [1.0], True, "wide"):
        with pytest.raises(InputError, match=f"robot: {field} is"):
            Robot(**{field: odd})  # type: ignore[arg-type]
    assert getattr(Robot(**{field: "2e-1"}), field) == 0.2
    assert Robot(radius=0.0).footprint.is_disc
