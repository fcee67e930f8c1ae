"""Drives that a controller steers: held against the follower's own, which one can imitate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.drive.course import Course
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.robot import Robot
from ambinav.drive.world import COLLIDED, TIMED_OUT
from ambinav.geometry.environment import Environment
from ambinav_envs.leaderboard.follow import Followers
from tests.drive.cases import laser, route_through
from tests.geometry.scenes import environment

RUNS = 3
ROUTE = [[1.5, 1.5], [6.0, 1.5], [6.0, 5.0]]


class Imitator:
    """Steers as the follower does."""

    def __init__(self) -> None:
        route = route_through(ROUTE)
        course = Course.of(route.poses, route.steering)
        self._followers = Followers([course] * RUNS, Robot(), FollowerParameters(), 0.1)
        self.ranges: Any = None

    def command(self, belief: Any, covariance: Any, speeds: Any, ranges: Any) -> Any:
        self.ranges = ranges
        return self._followers.steer(belief, speeds)


class Steady:
    """Goes on as it is commanded."""

    def __init__(self, speed: float, rate: float) -> None:
        self._want = np.tile([speed, rate], (RUNS, 1))

    def command(self, belief: Any, covariance: Any, speeds: Any, ranges: Any) -> Any:
        return self._want


@pytest.fixture(scope="module")
def hall() -> Environment:
    return environment(shapely.box(0.0, 0.0, 8.0, 6.5) - shapely.box(2.5, 3.0, 3.5, 4.5))


def driven(env: Environment, controller: Any, localizer: str = "odometry", **more: Any) -> Drives:
    return drive_route(
        env, laser(beams=24), Robot(), route_through(ROUTE), localizer, np.random.default_rng(3),
        RUNS, controller=controller, **more,
    )  # fmt: skip


def test_one_that_does_as_the_follower_changes_no_bit(hall: Environment) -> None:
    followed, steered = driven(hall, None), driven(hall, Imitator())
    assert followed.reached.all()
    for name in ("truth", "odometry", "estimate", "outcome", "samples"):
        assert np.array_equal(getattr(followed, name), getattr(steered, name), equal_nan=True)


def test_it_sees_even_where_the_localizer_looks_at_nothing(hall: Environment) -> None:
    controller = Imitator()
    driven(hall, controller, "perfect")
    assert controller.ranges.shape == (RUNS, 24)


def test_walls_and_time_end_its_drives(hall: Environment) -> None:
    assert (driven(hall, Steady(0.5, 0.0), "perfect").outcome == COLLIDED).all()
    assert (driven(hall, Steady(0.0, 0.5), max_time=2.0).outcome == TIMED_OUT).all()


def test_open_loop_it_has_no_say(hall: Environment) -> None:
    alone, steered = (driven(hall, c, open_loop=True) for c in (None, Steady(0.5, 0.0)))
    assert np.array_equal(alone.truth, steered.truth, equal_nan=True)
