"""Milestones of the roadmap: free, seeded, and more of them where it is narrow."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav_planners import RoutePlanner
from ambinav_planners.ompl_setup import prepare
from ambinav_planners.roadmap import Roadmap
from ambinav_planners.sampler import FreeSampler
from ambinav_planners.spaces import new_state, pose_reader
from tests.planners.conftest import LASER
from tests.planners.test_reachability import building

START, GOAL = (1.0, 2.0, 0.0), (7.0, 2.0, 0.0)
Poses = np.ndarray[tuple[int, int], np.dtype[np.float64]]


def draw(robot: RoutePlanner, count: int, seed: int) -> Poses:
    problem = robot.problem(START, GOAL)
    setup = prepare(problem)
    sampler = FreeSampler(setup.si, problem, np.random.default_rng(seed))
    heading = problem.steering.space != "r2"
    state, read = new_state(setup.si, START, heading), pose_reader(heading)
    out = []
    for _ in range(count):
        assert sampler.sample(state)
        out.append(read(state))
    return np.array(out)


@pytest.mark.parametrize("space", ["r2", "se2"])
def test_milestones_are_free_and_seeded(space: str) -> None:
    robot = RoutePlanner(building(1.0).service, footprint=0.3, space=space)
    poses = draw(robot, 6000, seed=4)
    assert robot.checker.poses_free(poses).all()
    np.testing.assert_array_equal(poses, draw(robot, 6000, seed=4))
    assert not np.array_equal(poses, draw(robot, 6000, seed=5))
    if space == "se2":  # all round
        assert np.histogram(poses[:, 2], bins=8, range=(-math.pi, math.pi))[0].min() > 600


def test_a_narrow_door_gets_more_than_its_area_and_no_place_is_left_out() -> None:
    robot = RoutePlanner(building(0.7).service, footprint=0.3)
    poses = draw(robot, 20000, seed=1)
    door = (np.abs(poses[:, 0] - 4.0) < 0.1) & (np.abs(poses[:, 1] - 2.0) < 0.05)
    area = 0.2 * 0.1 / (2 * 3.3 * 3.4)
    assert door.mean() > 3.0 * area
    cells = np.histogram2d(poses[:, 0], poses[:, 1], bins=(8, 8), range=((0.3, 3.6), (0.3, 3.7)))[0]
    assert cells.min() > 0.3 * 0.5 * len(poses) / 128


def test_ompl_asks_the_sampler() -> None:
    robot = building(1.0)
    problem = robot.problem(START, GOAL)
    graphs = []
    for _ in range(2):
        roadmap = Roadmap.over(problem, seed=3)
        roadmap.grow(200)
        graphs.append(roadmap.graph())
    # The sampler's seed alone decides: OMPL's own samples would differ from run to run.
    np.testing.assert_array_equal(graphs[0].poses, graphs[1].poses)


def test_a_roadmap_without_a_free_pose_ends() -> None:
    room = an.environment_from_shapes([shapely.box(0, 0, 1, 1)])
    amap = an.build_map(
        room, an.RangeScanner.planar(sensor=LASER, beams=36, aperture=6.0), spacing=0.1
    )
    centre = (0.5, 0.5, 0.0)
    roadmap = Roadmap.over(RoutePlanner(amap, footprint=0.49999).problem(centre, centre), seed=1)
    roadmap.grow(10)
    assert roadmap.milestones == 0
