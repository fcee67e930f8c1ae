"""The kernels against slow code, and each end that an episode can have."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.buildings.load import load_environment
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.service.service import AmbiguityService
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.rewards import TERMS
from ambinav_envs.simulation.observe import ahead
from tests.envs.cases import room
from tests.envs.slow import SlowNavigation

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"
WEIGHTS = dict(zip(TERMS, (1.0, 9.0, 7.0, 6.0, 0.5, 0.8, 3.0, 2.0, 0.4, 1.3), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("room", 1), ("room", 2), ("demo", 3), ("demo", 4)])
def test_every_number_is_that_of_the_slow_way(name: str, seed: int) -> None:
    environment = room() if name == "room" else load_environment(DEMO)
    options = {
        "reward": WEIGHTS,
        "gamma": 0.97,
        "odometry_scale": 1.5,
        "ambiguity_weight": seed % 2,
    }
    env = NavigationEnv(map=environment, **options)
    env.reset(seed=seed)
    slow = SlowNavigation(env)
    rng = np.random.default_rng(seed)
    bias = rng.uniform(-0.3, 0.3)
    for k in range(60):
        action = np.array([rng.uniform(-0.5, 1.0), np.clip(rng.normal(bias, 0.3), -1.0, 1.0)])
        seen, reward, terminated, _, info = env.step(action)
        wanted, sum_of_terms, facts = slow.step(action)
        for part, value in wanted.items():
            # An axis has no direction where both deviations are nearly the same.
            assert np.allclose(seen[part], value, atol=2e-3 if part == "uncertainty" else 2e-5), (
                k, part, seen[part], value,
            )  # fmt: skip
        assert np.allclose(info["estimate"], facts["estimate"], atol=1e-6)
        assert info["error"] == pytest.approx(facts["error"], abs=1e-6)
        assert np.allclose(info["true_pose"], slow.truth) and facts["met"] == terminated
        for term in ("progress", "collision", "time", "ambiguity", "fisher", "error"):
            assert info["terms"][term] == pytest.approx(facts["terms"][term], abs=1e-5), term
        if terminated:
            break
        assert reward == pytest.approx(sum_of_terms, abs=1e-4)
        assert sum(info["reward_terms"].values()) == pytest.approx(reward)
        assert info["exposure"] == pytest.approx(slow.exposure, abs=1e-4)
        assert info["travelled"] == pytest.approx(slow.travelled, abs=1e-4)
    assert k > 5


def scripted(
    env: NavigationEnv, action: tuple[float, float], steps: int = 400
) -> dict[str, object]:
    """Info of the last step of an episode with the same action all the time."""
    for _ in range(steps):
        *_, terminated, truncated, info = env.step(np.array(action))
        if terminated or truncated:
            return info | {"terminated": terminated, "truncated": truncated}
    raise AssertionError("the episode does not end")


def test_arrives_where_it_believes_and_is() -> None:
    env = NavigationEnv(map=room(), localizer="perfect", odometry_scale=0.0, dt=0.1)
    _, info = env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "goal": (4.0, 1.0)})
    assert info["shortest"] == pytest.approx(3.0, abs=0.05)
    info = scripted(env, (1.0, 0.0))
    assert info["outcome"] == "arrived" and info["is_success"] and info["terminated"]
    assert info["terms"]["arrival"] == 1.0 and info["reward_terms"]["arrival"] == 1.0
    assert info["travelled"] == pytest.approx(2.7, abs=0.06) and info["cost"] == 0.0
    assert info["error"] == 0.0


def test_misses_a_goal_that_it_only_believes_to_be_at() -> None:
    # Worn wheels report twice the distance, and nothing else is looked at.
    env = NavigationEnv(
        map=room(), localizer="odometry", odometry={"scale": 0.01, "bias_distance": 1.0}
    )
    env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "goal": (4.0, 1.0)})
    info = scripted(env, (1.0, 0.0))
    assert info["outcome"] == "missed" and not info["is_success"] and info["terminated"]
    assert info["error"] > 1.0 and info["lost"] and info["cost_lost"] == 1.0 == info["cost"]
    assert info["terms"]["lost"] == -0.2


def test_is_lost_after_more_than_a_second_of_large_errors() -> None:
    env = NavigationEnv(
        map=room(), localizer="odometry", odometry={"scale": 0.0, "bias_distance": 1.0},
        end_when_lost=True, start_std=(1e-9, 1e-9, 1e-9), dt=0.1,
    )  # fmt: skip
    env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "goal": (12.0, 1.0)})
    info = scripted(env, (1.0, 0.0))
    assert info["outcome"] == "lost" and info["terminated"] and info["was_lost"]
    # Half as fast as its wheels (0.25 m/s after a step, 0.5 m/s then): 0.5 m of error are reached
    # in step 21.
    assert info["travelled"] == pytest.approx(0.0125 + 0.025 * 31)


SAYS, SILENT = (-1.0, 0.0, 1.0), (-1.0, 0.0, 0.5)


@pytest.mark.parametrize(("goal", "outcome"), [(4.45, "arrived"), (4.55, "missed")])
def test_ends_where_it_declares_to_be_there(goal: float, outcome: str) -> None:
    """By the truth, and whatever the estimate says."""
    env = NavigationEnv(map=room(), localizer="odometry", declare=["arrived"], declare_seconds=0.6)
    env.reset(seed=0, options={"start": (4.0, 1.0, 0.0), "goal": (goal, 1.0)})
    for action in (SAYS, SAYS, SILENT, SAYS, SAYS):
        assert "outcome" not in env.step(np.array(action))[4]
    *_, terminated, _, info = env.step(np.array(SAYS))
    assert terminated and info["outcome"] == outcome
    assert info["terms"]["missed"] == -(outcome == "missed")
    # Nothing else ends it, wherever the estimate is.
    env.reset(seed=0, options={"start": (4.0, 1.0, 0.0), "goal": (4.1, 1.0)})
    for _ in range(20):
        assert not env.step(np.array(SILENT))[2]


@pytest.mark.parametrize("localizer", ["ekf", "mcl", "odometry"])
def test_who_is_lost_calls_for_help_and_waits(localizer: str) -> None:
    env = NavigationEnv(
        map=room(), localizer=localizer, declare=["arrived", "lost"], help_seconds=2.0,
        declare_seconds=0.2, kidnapped=1.0, kidnap_seconds=(0.0, 0.1), longest=30.0,
    )  # fmt: skip
    env.reset(seed=0)
    for _ in range(3):
        *_, info = env.step(np.array([-1.0, 0.0, 0.0, 0.0]))
    assert info["error"] > 1.0
    # Whatever it does while it waits, it stands and cannot arrive.
    moves = [env.step(np.array([1.0, 1.0, 0.0, 1.0]))]
    moves += [env.step(np.array([1.0, 1.0, 1.0, 0.0])) for _ in range(9)]
    assert all(move[4]["travelled"] == info["travelled"] for move in moves)
    assert not any(move[2] for move in moves)
    assert moves[-2][4]["error"] > 1.0 and moves[-1][4]["error"] < 0.3
    assert env.step(np.array([1.0, 0.0, 0.0, 0.0]))[4]["travelled"] > info["travelled"]


def test_collides_at_exactly_its_radius() -> None:
    env = NavigationEnv(map=room(), localizer="perfect", odometry_scale=0.0)
    env.reset(seed=0, options={"start": (13.0, 6.0, 0.0), "goal": (13.0, 1.0)})
    info = scripted(env, (1.0, 0.0))
    assert info["outcome"] == "collided" and info["cost_collision"] == 1.0 == info["cost"]
    assert info["true_pose"][0] == pytest.approx(15.0 - 0.22, abs=1e-6)
    assert info["terms"]["collision"] == -1.0 and not info["is_success"]


def test_is_cut_off_after_so_many_steps() -> None:
    env = NavigationEnv(map=room(), max_episode_steps=7)
    env.reset(seed=0)
    info = scripted(env, (-1.0, 0.0))
    assert info["outcome"] == "timeout" and info["truncated"] and not info["terminated"]
    assert env.simulation.state["steps"][0] == 7


def test_progress_is_a_potential() -> None:
    env = NavigationEnv(map=room(), localizer="perfect", reward={"progress": 1.0})
    _, info = env.reset(seed=5)
    rng, total, ended = np.random.default_rng(5), 0.0, False
    while not ended:
        _, reward, terminated, truncated, _ = env.step(rng.uniform(-1.0, 1.0, 2))
        total += reward
        ended = terminated or truncated
    assert total == pytest.approx(info["shortest"] - env.simulation.state["distance"][0])


def test_waypoints_lie_ahead_on_the_shortest_way() -> None:
    env = NavigationEnv(map=room(), localizer="perfect", waypoint=True, waypoint_distance=1.5)
    start, goal = (3.0, 5.0, 0.0), (8.0, 5.0)
    seen, info = env.reset(seed=0, options={"start": start, "goal": goal})
    # The pillar is in between.
    assert abs(seen["waypoint"][2]) > 0.5 and seen["goal"][1] == pytest.approx(1.0)
    for seed in range(20):
        seen, info = env.reset(seed=seed)
        site, task = env.simulation.sites[0], env.simulation.tasks[0]
        assert site is not None and task is not None
        x, y, theta = info["true_pose"]
        away, ahead, aside = seen["waypoint"]
        angle = theta + math.atan2(aside, ahead)
        x, y = x + 10 * away * math.cos(angle), y + 10 * away * math.sin(angle)
        left = site.lattice.distance(task.cost_to_go.costs, x, y)
        assert left == pytest.approx(max(info["shortest"] - 1.5, 0.0), abs=0.4)


@pytest.mark.slow(kept=("True-0.2",))
@pytest.mark.parametrize(("fan", "rtol"), [(False, 0.12), (True, 0.2)])
def test_the_way_that_waypoints_lie_on_is_the_cheapest_one(fan: bool, rtol: float) -> None:
    """Of a scanner that looks ahead, the price hangs on the direction of travel."""
    building: dict[str, Any] = {"map": load_environment(DEMO), "shortest": 6.0}
    if fan:
        sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
        building = {"map": room(), "scanner": RangeScanner.planar(sensor, 20, 1.5)}
    costs = []
    for seed in range(10):
        for weight in (5.0, 0.0):
            env = NavigationEnv(**building, ambiguity_weight=weight)
            _, info = env.reset(seed=seed)
            (site,), (task,) = env.simulation.sites, env.simulation.tasks
            assert site is not None and task is not None
            service = AmbiguityService(site.building.amap, "level", 5.0)
            assert (service.ambiguity.values.shape[2] > 1) == fan
            place, cost = tuple(info["true_pose"][:2]), 0.0
            while place != tuple(task.goal):
                there = ahead(*place, task.goal, 0.5, task.cost_to_go.towards, site.lattice.frame)
                facing = math.atan2(there[1] - place[1], there[0] - place[0])
                cost += float(service.motion_cost(*place, *there, facing, facing))
                place = there
            costs.append((cost, task.cost, task.distance))
    cost, reported, distance = np.array(costs).reshape(10, 2, 3).T
    np.testing.assert_array_equal(distance[0], distance[1])
    np.testing.assert_allclose(cost[0], reported[0], rtol=rtol)
    assert (cost[0] <= 1.02 * cost[1]).all() and (cost[0] < 0.95 * cost[1]).any()


@pytest.mark.slow
def test_reckons_with_cones_mounts_and_mixed_sensors() -> None:
    laser = RangeSensor(max_range=4.0, std=0.02, resolution=0.01)
    sonar = RangeSensor(
        max_range=3.0, std=0.03, resolution=0.02, aperture=0.4, min_range=0.15, max_incidence=0.4,
        random_share=0.0,
    )  # fmt: skip
    scanner = RangeScanner.mixed(
        RangeScanner.planar(laser, 20, math.pi, mount=(0.1, 0.0, 0.2)),
        RangeScanner.ring(sonar, 8, 0.2),
    )
    env = NavigationEnv(map=room(), scanner=scanner, people=3, obstacles=4)
    seen, _ = env.reset(seed=3)
    assert seen["scan"].shape == (28,)
    for _ in range(50):
        seen, _, terminated, _, info = env.step(np.array([0.0, 0.1]))
        if terminated:
            break
    assert env.observation_space.contains(seen) and info["error"] < 0.3
