"""Buildings that are not as their map says: who goes by the map, and who by the world."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.drive.clutter import with_obstacles
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.tasks import draw_task
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.simulation.layout import RUNNING
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room
from tests.envs.test_difficulty import AHEAD, EXACT, STAND
from tests.envs.test_tasks import polygon, two_doors


def test_map_and_world_are_told_apart() -> None:
    """Localizer, window and waypoint go by the map; scan and collisions by the world."""
    options: dict[str, Any] = {"map": room(), "scanner": EXACT, "walls_std": 0.08}
    env = NavigationEnv(**options, localizer="perfect", waypoint=True)
    plain = NavigationEnv(**options | {"walls_std": 0.0}, localizer="perfect", waypoint=True)
    task = {"start": (12.5, 6.0, 0.0), "goal": (13.5, 2.0)}
    seen, _ = env.reset(seed=0, options=task)
    mapped, _ = plain.reset(seed=0, options=task)
    for part in ("window", "waypoint", "goal"):
        equal(seen[part], mapped[part])
    site = env.simulation.sites[0]
    assert site is not None and site.truth is not None
    assert not np.allclose(seen["scan"], mapped["scan"], atol=1e-3)
    angle = env.simulation.parameters.scanner.mounts[:, 2]
    np.testing.assert_allclose(
        env.simulation.readings[0], site.world.environment.cast(12.5, 6.0, angle, 20.0), atol=1e-5
    )
    while env.simulation.state["outcome"][0] == RUNNING:
        info = env.step(AHEAD)[4]
    assert info["outcome"] == "collided"
    x, y = info["true_pose"][:2]
    assert site.world.environment.clearance(x, y) == pytest.approx(0.22, abs=1e-6)
    assert abs(float(room().clearance(x, y)) - 0.22) > 1e-3
    # A filter that believes the map errs by about as much as its walls are off.
    filtered = NavigationEnv(map=room(), walls_std=0.08, odometry_scale=0.0)
    filtered.reset(seed=0, options=task)
    errors = [filtered.step(np.float32([-1.0, 0.3]))[4]["error"] for _ in range(20)]
    assert 0.005 < np.mean(errors) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("suite", ["office", "warehouse", "hall"])
def test_starts_and_goals_are_free_and_joined_in_both_worlds(suite: str) -> None:
    envs = NavigationVectorEnv(
        40, suite=suite, buildings=2, difficulty=3, walls_std=0.1, window=False, kidnapped=0.3
    )
    envs.reset(seed=0)
    state = envs.simulation.state
    for i, (site, task) in enumerate(
        zip(envs.simulation.sites, envs.simulation.tasks, strict=True)
    ):
        assert site is not None and task is not None and site.truth is not None
        places = [[*task.start], [*task.goal, 0.0]]
        if state["kidnap_step"][i] > 0:
            places.append([*state["kidnap_pose"][i]])
            assert np.isfinite(state["kidnap_cost"][i])
        for lattice in (site.lattice, site.world.lattice):
            assert lattice.checker.poses_free(places).all()
            assert (lattice.checker.clearance(places) > 0.04).all()
        assert np.isfinite(task.distance) and task.distance < 100.0
        assert task.cost == task.distance == state["shortest"][i]
    before = state["truth"].copy()
    _, _, terminated, _, info = envs.step(np.tile(STAND, (40, 1)))
    assert not terminated.any() and not info["cost_collision"].any()
    assert np.array_equal(before, envs.simulation.state["truth"])


def test_a_door_is_closed_in_the_world_too() -> None:
    env = NavigationEnv(
        map=two_doors(), window=False, closed_door=1.0, longest=30.0, walls_std=0.03,
        ambiguity_weight=2.0, waypoint=True,
    )  # fmt: skip
    for seed in range(5):
        _, info = env.reset(seed=seed)
        site, task = env.simulation.sites[0], env.simulation.tasks[0]
        assert site is not None and task is not None and task.door is not None
        world = with_obstacles(site.world.environment, [polygon(task.door)])
        lattice = site.lattice.like(
            CollisionChecker(world, Footprint.disc(0.22), Steering("r2"), simulated=True)
        )
        apart = draw_task(
            lattice, np.ones(4, np.uint64), 2, 30, start=task.start, goal=task.goal
        ).distance
        assert info["shortest"] == task.distance == pytest.approx(apart, rel=0.03)


def test_a_start_in_a_wall_of_the_world_is_refused() -> None:
    env = NavigationEnv(map=room(), walls_std=0.15)
    plain = NavigationEnv(map=room())
    spots = [(0.23, y, 0.0) for y in np.linspace(1.0, 11.0, 30)]
    refused = 0
    for spot in spots:
        task = {"start": spot, "goal": (3.0, 3.0)}
        plain.reset(options=task)
        try:
            env.reset(options=task)
        except InputError as error:
            refused += 1
            assert "with walls_std and furniture_std" in str(error)
    assert 3 < refused < 30


@pytest.mark.slow
def test_rendering_shows_the_world() -> None:
    pictures = []
    for std in (0.0, 1.0):
        env = NavigationEnv(map=tables(), furniture_std=std, render_mode="rgb_array", scanner=EXACT)
        env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "goal": (5.0, 0.5)})
        pictures.append(env.render())
    one, other = pictures
    assert one is not None and other is not None
    assert 0.01 < np.mean((one != other).any(axis=2)) < 0.3


def tables() -> Environment:
    """A room of 10 m by 8 m with six tables of 1 m."""
    boxes = [shapely.box(x, y, x + 1.0, y + 1.0) for x in (2.0, 4.5, 7.0) for y in (2.0, 5.0)]
    return an.environment_from_shapes([shapely.box(0, 0, 10, 8)], boxes)
