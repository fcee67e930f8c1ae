"""Whole drives: what must be the same, what must be refused, and what is known to come out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.stats import chi2

from ambinav.drive.clutter import with_obstacles
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.drive.schedule import scheduled
from ambinav.drive.world import COLLIDED, REACHED, TIMED_OUT
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.parameters import MclParameters
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from tests.drive.cases import from_polyline, laser, route_through
from tests.geometry.scenes import environment, room

ROUTE = [[1.5, 1.5], [6.0, 1.5], [6.0, 5.0]]


@pytest.fixture(scope="module")
def hall() -> Environment:
    """A room with a pillar off its middle, so that no two places look alike."""
    return environment(shapely.box(0.0, 0.0, 8.0, 6.5) - shapely.box(2.5, 3.0, 3.5, 4.5))


def runs_of(env: Environment, localizer: object, runs: int = 4, **options: object) -> Drives:
    return drive_route(
        env, laser(beams=24), Robot(), route_through(ROUTE), localizer,
        np.random.default_rng(3), runs, **options,
    )  # fmt: skip


def few_particles() -> MclParameters:
    return MclParameters(min_particles=200, max_particles=400)


def same(a: Drives, b: Drives, runs: int) -> bool:
    """Whether the first runs are equal to the last bit."""
    n = int(a.samples[:runs].max())
    return all(
        np.array_equal(getattr(a, name)[:runs, :n], getattr(b, name)[:runs, :n], equal_nan=True)
        for name in ("truth", "odometry", "estimate", "covariance")
    )


@pytest.mark.slow
@pytest.mark.parametrize("localizer", ["perfect", "odometry", "mcl"])
def test_the_same_seed_gives_the_same_drive(hall: Environment, localizer: str) -> None:
    how = {"people": People(2), "keep_ranges": True}
    chosen = few_particles() if localizer == "mcl" else localizer
    one, two = (runs_of(hall, chosen, **how) for _ in range(2))
    assert same(one, two, 4)
    np.testing.assert_array_equal(one.ranges, two.ranges)
    # And a run is the same whatever the number of runs.
    assert same(runs_of(hall, chosen, 2, **how), one, 2)


def test_runs_differ(hall: Environment) -> None:
    found = runs_of(hall, "odometry")
    assert len(np.unique(found.odometry[:, 20, 0])) == 4


def test_a_route_that_nobody_has_measured_can_be_driven(hall: Environment) -> None:
    """The patience with a run comes from the course, not from the figures of the route."""
    route = Route.through(ROUTE)
    drives = drive_route(
        hall, laser(beams=24), Robot(), route, "perfect", np.random.default_rng(3), 2
    )
    assert drives.reached.all()


def test_who_knows_the_truth_arrives(hall: Environment) -> None:
    found = runs_of(hall, "perfect")
    assert (found.outcome == REACHED).all() and metrics(found).arrived.all()
    assert metrics(found).position_max.max() == 0.0
    # Corners are cut by pure pursuit: a quarter of the lookahead distance is plenty.
    driven = found.truth[0, : found.samples[0], :2]
    assert from_polyline(driven, ROUTE).max() < 0.15
    assert found.ranges is None
    assert "4 reached" in repr(found)


def test_a_localizer_keeps_the_robot_on_its_way(hall: Environment) -> None:
    found = runs_of(hall, few_particles(), 8)
    figures = metrics(found)
    assert figures.arrived.all() and not figures.lost.any()
    assert figures.position_rmse.max() < 0.2
    assert found.updated.any(axis=1).all() and not found.updated.all()


def test_a_kalman_filter_may_guide_the_robot(hall: Environment) -> None:
    found = runs_of(
        hall, ExtendedKalmanFilter(hall, laser(beams=24), runs=8), 8, noise=OdometryNoise(scale=0.1)
    )
    figures = metrics(found)
    assert figures.arrived.all()
    assert figures.position_rmse.max() < 0.1
    assert found.updated.any(axis=1).all()


@pytest.mark.slow
def test_dead_reckoning_is_as_wrong_as_it_says() -> None:
    noise = OdometryNoise(scale=0.03)
    found = drive_route(
        room(12.0, 12.0), laser(beams=4), Robot(),
        route_through([[2.0, 2.0], [9.0, 2.0], [9.0, 8.0]]), "odometry",
        np.random.default_rng(11), 200, noise=noise,
    )  # fmt: skip
    assert found.reached.all()
    last = found.samples - 1
    rows = np.arange(200)
    error, spread = found.errors()[rows, last], found.covariance[rows, last]
    nees = (error * np.linalg.solve(spread, error[..., None])[..., 0]).sum(axis=-1)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 3 * 200)
    assert low < nees.sum() < high
    first = found.errors()[:, 0] / np.array([0.05, 0.05, 0.02])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 600)
    assert low < (first**2).sum() < high


def test_who_believes_a_wrong_odometry_meets_the_wall() -> None:
    """A heading that drifts to the left in odometry drives the robot to the right."""
    noise = OdometryNoise(scale=0.0, bias_turn=0.1)
    found = drive_route(
        room(20.0, 4.0), laser(beams=4), Robot(), route_through([[1.0, 2.0], [19.0, 2.0]]),
        "odometry", np.random.default_rng(0), 2, noise=noise, start_std=(1e-9, 1e-9, 1e-9),
    )  # fmt: skip
    assert (found.outcome == COLLIDED).all()
    x, y, _ = found.truth[0, found.samples[0] - 1]
    assert y == pytest.approx(0.22, abs=1e-6)
    # Truth is an arc of curvature -0.1: 1.78 m below its start after sqrt(2 * 10 * 1.78 ...) m.
    assert x - 1.0 == pytest.approx(math.sqrt(10.0**2 - (10.0 - 1.78) ** 2), abs=0.1)
    assert np.isnan(found.truth[0, found.samples[0] :]).all()


def test_open_loop_the_truth_stays_on_the_route(hall: Environment) -> None:
    found = runs_of(hall, few_particles(), 3, open_loop=True)
    assert found.open_loop and (found.outcome == REACHED).all()
    assert (found.truth == found.truth[:1]).all()
    assert from_polyline(found.truth[0, :, :2], ROUTE).max() < 1e-9
    assert found.truth[0, -1] == pytest.approx([6.0, 5.0, math.pi / 2])
    assert found.samples.tolist() == [len(found.time)] * 3
    assert np.ptp(found.estimate[:, -1, 0]) > 0.0


def test_a_schedule_takes_the_time_that_its_limits_need() -> None:
    robot = Robot(max_turn_rate=1.0, acceleration=0.5)
    poses = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 2.0, 0.0]])
    found = scheduled(poses, Steering(), robot, 0.5, 0.01)
    # Each leg: length / v + v / a; the turn between them: a quarter turn at 1 rad/s.
    want = 4.0 / 0.5 + 1.0 + 2.0 / 0.5 + 1.0 + math.pi / 2
    assert 0.01 * (len(found) - 1) == pytest.approx(want, abs=0.011)
    steps = np.hypot(*np.diff(found[:, :2], axis=0).T)
    assert steps.max() <= 0.5 * 0.01 + 1e-9
    assert np.abs(np.diff(found[:, 2])).max() <= 0.01 + 1e-9
    turning = np.abs(np.diff(found[:, 2])) > 1e-9
    # But for the steps in which it begins or ends, a turn is made on the spot.
    assert steps[turning][1:-1].max() == 0.0


def test_a_schedule_drives_through_the_bends_of_a_smooth_route() -> None:
    """A polyline along an arc of 1 m radius, 5 degrees a vertex, takes no longer than the arc."""
    angles = np.radians(np.arange(0.0, 91.0, 5.0))
    poses = np.column_stack([np.sin(angles), 1.0 - np.cos(angles), angles])
    found = scheduled(poses, Steering(), Robot(acceleration=100.0), 0.5, 0.01)
    length = np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()
    # The first and the last piece, half a chord each, are taken at half the speed.
    ends = 2.0 * (0.5 * length / 18) / 0.5
    assert 0.01 * (len(found) - 1) == pytest.approx(length / 0.5 + ends, abs=0.03)
    # The first and the last piece have the direction of their chords.
    assert found[0, 2] == pytest.approx(np.radians(2.5))
    assert found[-1, 2] == pytest.approx(np.radians(87.5))
    steps = np.hypot(*np.diff(found[:, :2], axis=0).T)
    assert steps[18:-18].min() > 0.9 * 0.5 * 0.01


def test_a_schedule_slows_down_in_bends_and_stops_at_cusps() -> None:
    robot = Robot(max_turn_rate=0.5)
    arc = np.array([[2.0, 0.0, 0.0], [2.5, 0.5, math.pi / 2]])
    found = scheduled(arc, Steering("dubins", 0.5), robot, 0.5, 0.05)
    speed = np.hypot(*np.diff(found[:, :2], axis=0).T) / 0.05
    assert speed.max() <= 0.5 * 0.5 + 1e-6
    back = np.array([[3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
    found = scheduled(back, Steering("reeds-shepp", 0.5), Robot(), 0.5, 0.01)
    x = found[:, 0]
    assert x.min() == pytest.approx(1.0, abs=0.005) and x[-1] == pytest.approx(4.0)
    assert 0.01 * (len(x) - 1) == pytest.approx(5.0 / 0.5 + 2 * 0.2, abs=0.03)


def test_what_the_map_does_not_know_stands_in_the_way(hall: Environment) -> None:
    world = with_obstacles(hall, [shapely.box(4.0, 0.9, 4.5, 2.1)])
    found = runs_of(hall, "perfect", 1, world=world)
    assert found.collided.all()
    assert found.truth[0, found.samples[0] - 1, 0] == pytest.approx(4.0 - 0.22, abs=1e-6)


def test_people_block_beams(hall: Environment) -> None:
    empty, full = (
        runs_of(hall, "perfect", 2, people=people, keep_ranges=True)
        for people in (None, People(6, speed=0.8))
    )
    assert same(empty, full, 2)
    assert empty.ranges is not None and full.ranges is not None
    shorter = full.ranges < empty.ranges - 0.2
    assert 0.02 < shorter.mean() < 0.5
    assert (full.ranges > empty.ranges + 0.2).mean() < 0.05


def test_a_run_is_given_up_in_the_end(hall: Environment) -> None:
    found = runs_of(hall, "perfect", 2, max_time=3.0)
    assert (found.outcome == TIMED_OUT).all()
    assert found.seconds.tolist() == pytest.approx([3.0, 3.0])
    assert not metrics(found).arrived.any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"runs": 0}, "runs is 0"),
        ({"localizer": "perfekt"}, "no localizer 'perfekt'; did you mean perfect"),
        ({"rate": 0.0}, "rate is 0"),
        ({"max_time": -1.0}, "max_time is -1"),
        ({"start_std": (0.1, 0.1)}, "start_std"),
        ({"start_std": (0.1, 0.1, 0.0)}, "start_std"),
    ],
)
def test_bad_arguments_are_refused(
    hall: Environment, options: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        runs_of(hall, **{"localizer": "perfect", **options})


def test_a_seed_is_no_generator(hall: Environment) -> None:
    seed: Any = 1
    with pytest.raises(InputError, match="give a numpy Generator"):
        route = route_through([[1.0, 1.0], [5.0, 1.0]])
        drive_route(hall, laser(), Robot(), route, "perfect", seed, 1)


def test_a_start_in_the_wall_is_refused(hall: Environment) -> None:
    for start, words in (([0.1, 1.0], "0.10 m from a wall"), ([-5.0, 1.0], "outside of the map")):
        with pytest.raises(InputError, match=f"route: its start.*{words}"):
            drive_route(
                hall, laser(), Robot(), route_through([start, [5.0, 1.0]]), "perfect",
                np.random.default_rng(0), 1,
            )  # fmt: skip
