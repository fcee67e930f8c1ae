"""Starts at which the robot may be in several places, and what it observes of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.optimize import minimize
from shapely.affinity import rotate

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import between, compose
from ambinav.localization.random import states
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.errors import InputError
from ambinav_envs import NavigationEnv, NavigationVectorEnv
from ambinav_envs.buildings.aliases import APART, Aliases, hypotheses
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.suites import suite
from ambinav_envs.planar_scanner import default_scanner
from ambinav_envs.registration import IDS
from ambinav_envs.tasks import TWIN_ROOMS

TASK = "ambinav/TwinRooms3-v2"
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


def first_observations(task: str, count: int) -> tuple[Floats, Floats, Ints]:
    """Return log shares, features of each hypothesis from the first observation, and the true one.

    Shapes (N, 3), (N, 3, F) and (N,). Hypotheses that do not exist have the log share -inf.
    """
    envs = NavigationVectorEnv(count, **{**IDS[task], "buildings": 6, "window": False})
    seen, _ = envs.reset(seed=5)
    shown = seen["hypotheses"].astype(float).reshape(count, 3, 4)
    share, off, ahead, aside = shown.transpose(2, 0, 1)
    clusters, truth = envs.simulation.clusters, envs.simulation.state["truth"]
    away = np.hypot(*(clusters[:, :, 1:3] - truth[:, None, :2]).transpose(2, 0, 1))
    away[share <= 0.0] = np.inf
    # Near and far have bends where the paths that are drawn end, in 10 m.
    bends = [np.maximum(near - off, 0.0) for near in (0.6, 0.9)]
    bends += [np.maximum(off - far, 0.0) for far in (1.2, 1.6)]
    features = np.stack([off, off**2, *bends, ahead, aside], axis=-1)
    with np.errstate(divide="ignore"):
        return np.log(share), features, away.argmin(axis=1)


def log_losses(log_share: Floats, scores: Floats, true: Ints) -> Floats:
    """Return the log loss of each episode, natural logarithm, for shares times exp(scores)."""
    whole = np.logaddexp.reduce(log_share + scores, axis=1)
    row = np.arange(len(true))
    return np.asarray(whole - (log_share + scores)[row, true])


@pytest.mark.slow(kept=("ambinav/TwinRooms1-v2",))
@pytest.mark.parametrize("name", [spec.name for spec in TWIN_ROOMS])
def test_the_first_observation_tells_no_more_than_the_shares(name: str) -> None:
    log_share, features, true = first_observations(name, 400)
    exists = np.isfinite(log_share)
    assert (exists.sum(axis=1) >= 2).all()
    features = (features - features[exists].mean(axis=0)) / features[exists].std(axis=0)

    def loss(weights: Floats, rows: Any) -> float:
        fit = log_losses(log_share[rows], features[rows] @ weights, true[rows]).mean()
        return float(fit + 1e-3 * weights @ weights)

    plain = log_losses(log_share, np.zeros_like(log_share), true)
    fitted = np.empty_like(plain)
    fold = np.arange(len(true)) % 4
    for k in range(4):
        weights = minimize(loss, np.zeros(features.shape[2]), fold != k).x
        rows = fold == k
        fitted[rows] = log_losses(log_share[rows], features[rows] @ weights, true[rows])
    gain = plain - fitted
    assert gain.mean() < 2.0 * gain.std() / math.sqrt(len(gain))
    # The shares themselves are right: they lose what they say that they will.
    expected = -(np.exp(log_share) * np.where(exists, log_share, 0.0)).sum(axis=1)
    error = (plain - expected).std() / math.sqrt(len(plain))
    assert plain.mean() == pytest.approx(expected.mean(), abs=3.0 * error)


@pytest.mark.sweep
def test_paths_from_all_hypotheses_have_the_length_asked_for() -> None:
    for spec in TWIN_ROOMS[1::2]:
        given = {**IDS[spec.name], "buildings": 2, "window": False}
        envs = NavigationVectorEnv(24, **given)
        _, info = envs.reset(seed=9)
        simulation = envs.simulation
        assert ((info["shortest"] >= 6.0) & (info["shortest"] <= 25.0)).all()
        for site, task, clusters in zip(
            simulation.sites, simulation.tasks, simulation.clusters, strict=True
        ):
            assert site is not None and task is not None
            for share, x, y, _ in clusters:
                if share > 0.05:
                    # Those of the particles are centimetres off.
                    metres = site.lattice.distance(task.cost_to_go.costs, x, y)
                    assert 5.7 < metres < 25.3


@pytest.mark.slow
def test_given_ends_keep_their_aliases() -> None:
    env = NavigationEnv(**arguments())
    _, info = env.reset(seed=4)
    pose, goal = info["true_pose"], env.simulation.state["goal"][0]
    # A start that is given is the true one, and a goal that is given may be at any distance.
    for options in ({"start": pose}, {"goal": goal}, {"start": pose, "goal": goal}):
        _, info = env.reset(seed=6, options=options)
        if "start" in options:
            np.testing.assert_allclose(info["true_pose"], pose)
        assert (env.simulation.clusters[0, :2, 0] > 0.02).all()


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
