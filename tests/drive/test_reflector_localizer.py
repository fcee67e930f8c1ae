"""The localizer `reflectors`: consistent, indifferent to walls, and dead reckoning without any."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.stats import chi2

import ambinav as an
from ambinav.drive.drive import drive_route
from ambinav.drive.localizer_spec import LocalizerContext, chosen_localizer
from ambinav.drive.localizers import DeadReckoning
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.reflector_localizer import ReflectorLocalizer
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, RangeSensor, read_intensity
from tests.drive.cases import route_through

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

SENSOR = RangeSensor(
    max_range=20.0, std=0.01, resolution=0.001, intensity=Intensity(0.3, 1.0, 0.15)
)
SCANNER = RangeScanner.planar(SENSOR, 720, 2 * math.pi, mount=(0.25, -0.1, 0.6))
BARE = an.environment_from_shapes([shapely.box(0, 0, 20, 12)])
POSTS = [(3.0, 3.0), (16.0, 2.5), (10.0, 10.0), (18.0, 9.0), (2.0, 9.5)]
HALL = BARE.edited(add=[Obstacle.post(x, y, 0.05, reflective=True) for x, y in POSTS])
ROUTE = route_through([[5.0, 5.0], [14.0, 5.0], [14.0, 8.0], [6.0, 7.0]])
NOISE = OdometryNoise()
DEVIATION = np.array([0.05, 0.05, 0.02])


def localizer(
    environment: Environment = HALL, scanner: RangeScanner = SCANNER, runs: int = 1, **given: Any
) -> ReflectorLocalizer:
    context = LocalizerContext(environment, scanner, NOISE, runs, np.random.default_rng(0))
    made = chosen_localizer({"type": "reflectors", **given}, NOISE, Robot(), 8.0).make(context)
    assert isinstance(made, ReflectorLocalizer)
    return made


@pytest.mark.slow(kept=("1.0",))
@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_errors_are_what_the_covariance_says(speed: float) -> None:
    """NEES within its chi-square interval over 30 runs, with the map as exact as the world."""
    robot = Robot(max_speed=speed)
    drives = drive_route(
        HALL, SCANNER, robot, ROUTE, localizer(runs=30, map_std=0.0), np.random.default_rng(4), 30,
        noise=NOISE, rate=8.0, follower=FollowerParameters(desired_linear_vel=speed),
        open_loop=True,
    )  # fmt: skip
    figures = metrics(drives)
    assert not figures.lost.any()
    assert np.median(figures.position_rmse) < 0.02
    error = drives.errors()
    square = np.einsum("rti,rtij,rtj->rt", error, np.linalg.inv(drives.covariance), error)
    # A sample every 4 m tells nothing of the next one: each mean is of 30 independent runs.
    apart = square[:, 8 :: round(4.0 * 8.0 / speed)]
    low, high = chi2.ppf([0.0005, 0.9995], 3 * apart.size) / apart.size
    # Rounding to beams is uniform, not normal, and less than it is taken for.
    assert 0.6 * low < apart.mean() < high
    assert (square < chi2.ppf(0.95, 3)).mean() > 0.93


def test_walls_mean_nothing() -> None:
    """To the bit: readings of walls are anything."""
    pose, rng = np.array([9.0, 5.0, 0.3]), np.random.default_rng(2)
    ranges = SCANNER.read(HALL, *pose, rng)[None]
    read = read_intensity(SCANNER, HALL, *pose[:, None], ranges, rng)
    wild = np.where(read > 0.6, ranges, rng.uniform(0.5, 19.0, ranges.shape)).astype(np.float32)
    results = []
    for scan in (ranges, wild):
        run = localizer()
        run.start((pose + 0.02)[None], np.diag(DEVIATION**2))
        assert run.update(np.zeros((1, 3)), scan, read)[0]
        results.append((run.mean, run.covariance))
    for first, second in zip(*results, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("angle", "dx", "dy"), [(0.0, 40.0, -7.0), (1.1, 0.0, 0.0), (-2.4, 3.0, 5.0)]
)
def test_turned_and_shifted_buildings_change_nothing(angle: float, dx: float, dy: float) -> None:
    rng, c, s = np.random.default_rng(3), math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    poses = np.array([[9.0, 5.0, 0.3], [9.3, 5.1, 0.35], [9.6, 5.2, 0.4]])
    back = np.array(
        [[math.cos(0.3), -math.sin(0.3), 0], [math.sin(0.3), math.cos(0.3), 0], [0, 0, 1]]
    )
    odometry = (poses - poses[0]) @ back
    here, there = localizer(), localizer(HALL.transformed(angle, dx, dy))
    cov = np.diag(DEVIATION**2)
    begin = poses[:1] + 0.03
    here.start(begin, cov)
    there.start(begin @ turn.T + (dx, dy, angle), turn @ cov @ turn.T)
    for pose, moved in zip(poses, odometry, strict=True):
        ranges = SCANNER.read(HALL, *pose, rng)[None]
        read = read_intensity(SCANNER, HALL, *pose[:, None], ranges, rng)
        for run in (here, there):
            assert run.update(moved[None], ranges, read)[0]
    expected = here.mean @ turn.T + (dx, dy, angle)
    off = there.mean - expected
    off[:, 2] = np.remainder(off[:, 2] + math.pi, 2 * math.pi) - math.pi
    # Reflectors come in another order, and each is used from the pose after those before.
    assert np.abs(off).max() < 1e-3
    assert np.allclose(there.covariance, turn @ here.covariance @ turn.T, atol=1e-5)


def test_without_reflectors_in_view_it_is_dead_reckoning() -> None:
    """Behind a wall from all of them: to the bit, and the covariance grows."""
    world = HALL.edited(add=[Obstacle.wall([(0.0, 1.8), (20.0, 1.8)])])
    run, plain = localizer(world), DeadReckoning(NOISE, 1)
    rng = np.random.default_rng(1)
    for each in (run, plain):
        each.start(np.array([[4.0, 0.9, 0.0]]), np.diag(DEVIATION**2))
    sizes = []
    for k in range(6):
        pose, moved = np.array([4.0 + k, 0.9, 0.0]), np.array([[float(k), 0.0, 0.0]])
        ranges = SCANNER.read(world, *pose, rng)[None]
        read = read_intensity(SCANNER, world, *pose[:, None], ranges, rng)
        assert not run.update(moved, ranges, read)[0]
        plain.update(moved, ranges)
        np.testing.assert_array_equal(run.mean, plain.mean)
        np.testing.assert_array_equal(run.covariance, plain.covariance)
        sizes.append(np.trace(run.covariance[0]))
    assert (np.diff(sizes) > 0.0).all()


def test_one_or_two_in_view_are_used() -> None:
    """A robot that passes a single post drifts less than one that passes none."""
    lone = BARE.edited(add=[Obstacle.post(10.0, 9.0, 0.05, reflective=True)])
    noise = OdometryNoise(scale=0.5)
    lost = []
    for name in ("reflectors", "odometry"):
        drives = drive_route(
            lone, SCANNER, Robot(max_speed=1.0), ROUTE, name, np.random.default_rng(6), 20,
            noise=noise, rate=8.0, follower=FollowerParameters(desired_linear_vel=1.0),
            open_loop=True,
        )  # fmt: skip
        lost.append(metrics(drives).lost.mean())
    assert lost[0] < 0.5 < lost[1]


def test_a_symmetric_layout_does_not_confuse_a_robot_that_knows_where_it_is() -> None:
    """Posts on a square grid of 4 m: aliased everywhere, but a tracked pose keeps to its own."""
    grid = [(x, y) for x in (2.0, 6.0, 10.0, 14.0, 18.0) for y in (2.0, 6.0, 10.0)]
    world = BARE.edited(add=[Obstacle.post(x, y, 0.05, reflective=True) for x, y in grid])
    route = route_through([[4.0, 4.0], [16.0, 4.0], [16.0, 8.0]])
    drives = drive_route(
        world, SCANNER, Robot(max_speed=1.0), route, "reflectors", np.random.default_rng(6), 20,
        noise=OdometryNoise(scale=0.5), rate=8.0,
        follower=FollowerParameters(desired_linear_vel=1.0), open_loop=True,
    )  # fmt: skip
    assert not metrics(drives).lost.any()
    # One that is wrong by half of the grid's period keeps to the wrong posts, and is sure of it.
    run, truth = localizer(world), np.array([8.0, 4.0, 0.0])
    rng = np.random.default_rng(2)
    run.start((truth + np.array((3.9, 0.0, 0.0)))[None], np.diag(DEVIATION**2))
    ranges = SCANNER.read(world, *truth, rng)[None]
    read = read_intensity(SCANNER, world, *truth[:, None], ranges, rng)
    assert run.update(np.zeros((1, 3)), ranges, read)[0]
    assert abs(run.mean[0, 0] - 12.0) < 0.05


def test_posts_beside_their_places_shift_the_estimate_more_than_it_says() -> None:
    """Off by 5 cm: none lost, and `map_std` helps, but a constant error is taken for noise."""
    off = np.random.default_rng(2).normal(0.0, 0.05, (len(POSTS), 2))
    posts = (np.array(POSTS) + off).tolist()
    world = BARE.edited(add=[Obstacle.post(x, y, 0.05, reflective=True) for x, y in posts])
    errors = []
    for map_std in (0.02, 0.05):
        run = localizer(runs=8, map_std=map_std)
        drives = drive_route(
            HALL, SCANNER, Robot(max_speed=1.0), ROUTE, run, np.random.default_rng(4), 8,
            world=world, noise=NOISE, rate=8.0,
            follower=FollowerParameters(desired_linear_vel=1.0), open_loop=True,
        )  # fmt: skip
        figures = metrics(drives)
        assert not figures.lost.any()
        assert np.median(figures.nees) > 7.0
        errors.append(float(np.median(figures.position_rmse)))
    assert errors[1] < 0.03 < errors[0] < 0.05


def test_what_cannot_be_used_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"has no reflectors, .* kind 'reflector' .*reflectors\.md"
    ):
        localizer(BARE)
    with pytest.raises(InputError, match=r"measures no intensities, .* add `intensity:`"):
        localizer(scanner=SCANNER.with_intensity(None))
    for given, message in (
        ({"confidence": 1.0}, "confidence is 1; give a share between 0 and 1"),
        ({"max_incidence": 100.0}, "max_incidence is 100; give at most 90 degrees"),
        ({"max_range": -1.0}, "max_range"),
        ({"gate": 3.0}, "gate"),
    ):
        with pytest.raises(InputError, match=message):
            localizer(**given)
    run = localizer()
    run.start(np.array([[5.0, 5.0, 0.0]]), np.eye(3))
    for intensities in (None, np.ones((1, 3), dtype=np.float32)):
        with pytest.raises(InputError, match="intensities have the shape"):
            run.update(np.zeros((1, 3)), np.ones((1, 720), dtype=np.float32), intensities)
