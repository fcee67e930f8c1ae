"""Starts at which the robot may be in several places, and what it observes of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import between, compose
from ambinav.localization.random import states
from ambinav.runtime.errors import InputError
from ambinav_envs import NavigationEnv, NavigationVectorEnv
from ambinav_envs.buildings.aliases import APART, Aliases, hypotheses
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.suites import suite
from ambinav_envs.planar_scanner import default_scanner
from ambinav_envs.registration import IDS

TASK = "ambinav/TwinRooms3-v1"
STILL = np.array([-1.0, 0.0, -1.0])


def arguments(**more: Any) -> dict[str, Any]:
    """Return those of the task, in the plain building; it is not turned."""
    return {**IDS[TASK], "buildings": 1, "window": False, **more}


@pytest.mark.parametrize(("name", "wings"), [("twin-rooms", 2), ("triple-rooms", 3)])
def test_wings_are_equal_but_for_one_post(name: str, wings: int) -> None:
    for variant in (0, 7):
        free = suite(name).building(variant).free
        assert isinstance(free, shapely.Polygon)
        turned = rotate(free, 360.0 / wings, origin=(0.0, 0.0))
        # Twice the post, 0.8 m wide: where it stands, and where it is turned to.
        assert free.symmetric_difference(turned).area == pytest.approx(2.0 * 0.8**2, rel=0.02)


@pytest.mark.slow
def test_aliases_are_the_pose_turned_about_the_centre() -> None:
    environment = suite("twin-rooms").building(0)
    building = Building.of(environment, default_scanner(), 0.22, keep=False)
    found = Aliases.of(building, 1)
    assert len(found.poses) > 500
    # By no computation on scans: half a turn about the middle of the corridor.
    turned = found.poses * (-1.0, -1.0, 1.0)
    assert np.abs(found.alike[:, 0, :2] - turned[:, :2]).max() < 0.05
    assert np.abs(np.cos(found.alike[:, 0, 2] - turned[:, 2]) + 1.0).max() < 1e-3
    pose = np.append(found.poses[100, :2] + 0.03, 1.0)
    both = found.among(pose, np.array([9.0, 0.5]))
    assert both is not None
    np.testing.assert_allclose(both[1, :2], -pose[:2], atol=0.05)
    # A goal in the centre is the same for both.
    assert found.among(pose, np.array([0.2, 0.0])) is None


def test_shares_are_probabilities() -> None:
    poses = np.zeros((3, 3))
    stream = states(np.random.default_rng(1), 1)[0]
    drawn = np.array([hypotheses(poses, (0.4, 0.9), stream)[:, 3] for _ in range(20_000)])
    np.testing.assert_allclose(drawn.sum(axis=1), 1.0)
    assert drawn.max() < 0.9
    # The robot is at the first: among all poses of a share, so many of them must be the first.
    for low, high in ((0.05, 0.15), (0.4, 0.6), (0.6, 0.8)):
        within = (drawn >= low) & (drawn < high)
        expected = drawn[within].mean()
        assert within[:, 0].sum() / within.sum() == pytest.approx(expected, abs=0.02)


@pytest.mark.slow
def test_particles_start_where_the_robot_may_be() -> None:
    envs = NavigationVectorEnv(24, **arguments(start_prior=[0.7, 0.7]))
    seen, info = envs.reset(seed=2)
    clusters, truth = envs.simulation.clusters, envs.simulation.state["truth"]
    assert seen["hypotheses"].shape == (24, 12)
    # The first update of the filter has changed the shares a little.
    assert np.abs(clusters[:, 0, 0] - 0.7).max() < 0.1
    assert (clusters[:, :2, 0].sum(axis=1) > 0.95).all()
    away = np.hypot(*(clusters[:, :2, 1:3] - truth[:, None, :2]).transpose(2, 0, 1))
    assert away.min(axis=1).max() < 0.2
    assert (away.max(axis=1) > APART).all()
    # The heaviest is the estimate, and the right one as often as its share says.
    np.testing.assert_allclose(clusters[:, 0, 1:3], info["estimate"][:, :2], atol=0.05)
    assert 0.4 < (away[:, 0] < 0.2).mean() < 0.95
    # What is seen is the goal from each of them.
    for k in range(2):
        goal = np.append(envs.simulation.state["goal"][0], 0.0)
        x, y, _ = between(clusters[0, k, 1:], goal)
        shown = seen["hypotheses"][0, 4 * k : 4 * k + 4]
        expected = [
            clusters[0, k, 0],
            math.hypot(x, y) / 10,
            *(np.array([x, y]) / math.hypot(x, y)),
        ]
        np.testing.assert_allclose(shown, expected, atol=1e-5)


@pytest.mark.slow
def test_clusters_move_with_odometry_between_updates() -> None:
    env = NavigationEnv(**arguments(mcl={"update_min_d": 10.0, "update_min_a": 3.0}))
    env.reset(seed=4)
    before = env.simulation.clusters[0].copy(), env.simulation.state["odometry"][0].copy()
    for _ in range(4):
        env.step(np.array([1.0, 0.2, -1.0]))
    motion = between(before[1], env.simulation.state["odometry"][0])
    moved = compose(before[0][:2, 1:], motion)
    np.testing.assert_allclose(env.simulation.clusters[0, :2, 1:3], moved[:, :2], atol=1e-6)


@pytest.mark.slow
def test_clusters_are_seen_as_late_as_the_estimate() -> None:
    now, late = (NavigationEnv(**arguments(pose_latency=latency)) for latency in (0.0, 0.4))
    seen = [now.reset(seed=4)[0]["hypotheses"]]
    delayed = [late.reset(seed=4)[0]["hypotheses"]]
    for _ in range(6):
        action = np.array([-0.6, 0.5, -1.0])
        seen.append(now.step(action)[0]["hypotheses"])
        delayed.append(late.step(action)[0]["hypotheses"])
    # Two steps of 0.2 s; until then those of the start.
    for step in range(7):
        np.testing.assert_array_equal(delayed[step], seen[max(step - 2, 0)])


@pytest.mark.slow
def test_one_hypothesis_without_particles() -> None:
    seen, _ = NavigationEnv(**arguments(localizer="perfect")).reset(seed=1)
    np.testing.assert_array_equal(seen["hypotheses"][:4], [1.0, *seen["goal"]])
    assert not seen["hypotheses"][4:].any()
    other, _ = NavigationEnv(**arguments()).reset(seed=1)
    # The twin with the true pose has the same episodes.
    goals = {tuple(np.round(other["hypotheses"][4 * k + 1 : 4 * k + 4], 1)) for k in range(2)}
    assert tuple(np.round(seen["goal"], 1)) in goals


@pytest.mark.slow
def test_the_robot_that_stands_learns_nothing() -> None:
    env = NavigationEnv(**arguments(start_prior=[0.6, 0.6]))
    seen, _ = env.reset(seed=3)
    for _ in range(20):
        seen, *_ = env.step(STILL)
    assert seen["hypotheses"][0] == pytest.approx(0.6, abs=0.1)


@pytest.mark.slow
def test_bad_aliased_starts() -> None:
    for given, text in (
        ({"localizer": "ekf"}, "start_aliases is 2 and localizer 'ekf', which needs a first"),
        (
            {"start_prior": [0.9, 0.5]},
            r"start_prior is \(0.9, 0.5\); give two probabilities between",
        ),
    ):
        with pytest.raises(InputError, match=text):
            NavigationEnv(**arguments(**given))
    env = NavigationEnv(**arguments(shortest=40.0, longest=50.0))
    with pytest.raises(InputError, match="start_aliases: in 'twin-rooms-0' no start and goal are"):
        env.reset(seed=1)
    with pytest.raises(InputError, match=r"start \(50, 0\) in twin-rooms-0 is "):
        NavigationEnv(**arguments()).reset(seed=1, options={"start": (50.0, 0.0, 0.0)})
    near = arguments(shortest=0.5, longest=3.0)
    with pytest.raises(InputError, match="start_aliases: in 'small'"):
        NavigationEnv(**{**near, "suite": None, "map": small(), "buildings": None}).reset()


def small() -> Environment:
    """Return a room whose corners differ, seen whole from everywhere."""
    floor = shapely.Polygon([(0, 0), (3.5, 0), (3.5, 1.5), (2.6, 1.5), (2.6, 2.8), (0, 2.8)])
    return environment_from_shapes([floor], name="small")
