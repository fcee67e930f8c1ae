"""Boxes and people: rays and collisions against the same things built as walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.drive.clutter import with_obstacles
from ambinav.drive.readings import Readings
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.casting import cast_rays, nearest_echoes
from ambinav.localization.ekf_update import scratch_for
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.simulation.obstacles import SPARE, shade
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import room


def polygon(box: np.ndarray) -> shapely.Polygon:
    """A box as a polygon."""
    middle, a, b = box[:2], box[2:4], box[4:]
    return shapely.Polygon([middle + a + b, middle - a + b, middle - a - b, middle + a - b])


@pytest.mark.slow
def test_boxes_stand_free_and_can_be_passed() -> None:
    envs = NavigationVectorEnv(50, map=room(), obstacles=6, window=False)
    envs.reset(seed=0)
    state, walls = envs.simulation.state, room().free.boundary
    counts = state["boxes"]
    assert counts.max() == 6 and counts.mean() > 4.0
    for i in range(50):
        boxes = [polygon(box) for box in envs.simulation.boxes[i, : counts[i]]]
        ends = shapely.points([state["truth"][i, :2], state["goal"][i]])
        passage = 2 * 0.22 + SPARE
        for k, box in enumerate(boxes):
            assert 0.3**2 - 1e-9 <= box.area <= 0.8**2 + 1e-9
            assert room().free.contains(box) and walls.distance(box) >= passage
            assert min(shapely.distance(box, ends)) >= passage
            assert all(box.distance(other) >= passage for other in boxes[:k])


def test_rays_meet_boxes_and_people_as_they_meet_walls() -> None:
    env = NavigationEnv(map=room(), obstacles=5, people=4, window=False)
    p, simulation = env.simulation.parameters, env.simulation
    scratch, shaded = scratch_for(60, 60), 0
    for seed in range(20):
        env.reset(seed=seed)
        site, state = simulation.sites[0], simulation.state[0]
        assert site is not None
        boxes = simulation.boxes[0, : state["boxes"]]
        world = with_obstacles(room(), [polygon(box) for box in boxes])
        people = simulation.people
        wanted = Readings(world, p.scanner).true_ranges(state["truth"][None], people, 0.25)[0]
        cast_rays(*state["truth"], site.record.cast, scratch.cast)
        shade(
            *state["truth"], people, 0.25, simulation.boxes, len(boxes), 0,
            site.record.cast.origin, site.record.cast.start, scratch.cast, 4.0,
        )  # fmt: skip
        nearest_echoes(site.record.cast, scratch.cast, scratch.ranges, scratch.ray, scratch.edge)
        assert np.allclose(scratch.ranges, wanted, atol=1e-5)
        # What hit no wall has no edge, so the filter cannot take it for one.
        plain = p.scanner.scan(room(), *state["truth"])
        before = wanted < plain - 1e-6
        assert (scratch.edge[before] == -1).all()
        shaded += int(before.sum())
    assert shaded > 50


@pytest.mark.slow
def test_robots_stop_at_boxes_as_they_stop_at_walls() -> None:
    count = 80
    envs = NavigationVectorEnv(
        count, map=room(), obstacles=6, window=False, localizer="perfect", max_steps=10_000,
        autoreset_mode="Disabled", goal_radius=1e-3, robot={"max_turn_rate": 1.0},
        odometry_scale=0.0,
    )  # fmt: skip
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = np.column_stack([rng.uniform(0.0, 1.0, count), rng.uniform(-0.4, 0.4, count)])
    met, simulation = 0, envs.simulation
    left = np.ones(count, dtype=bool)
    out = simulation.outcome()
    worlds = {}
    for _ in range(200):
        before = simulation.state["truth"].copy()
        simulation.step(actions, left, out)
        for i in np.flatnonzero(left & (simulation.state["outcome"] == 3)):
            if i not in worlds:
                boxes = simulation.boxes[i, : simulation.state["boxes"][i]]
                worlds[i] = with_obstacles(room(), [polygon(box) for box in boxes])
            here = simulation.state["truth"][i]
            assert worlds[i].clearance(*here[:2]) - 0.22 < 1e-6
            met += worlds[i].clearance(*here[:2]) < room().clearance(*here[:2]) - 1e-6
            checker = CollisionChecker(worlds[i], Footprint.disc(0.22 - 1e-6), Steering())
            assert checker.poses_free([before[i], here]).all()
        left &= simulation.state["outcome"] == 0
    assert met > 8


def test_people_keep_off_walls_and_robots() -> None:
    envs = NavigationVectorEnv(20, map=room(), people=5, window=False)
    envs.reset(seed=1)
    environment, moved = room(), 0.0
    for _ in range(60):
        before = envs.simulation.people.copy()
        envs.step(np.tile((-1.0, 0.1), (20, 1)))
        x, y = envs.simulation.people[..., 0], envs.simulation.people[..., 1]
        assert environment.is_free(x, y, 0.25 - 1e-6).all()
        moved = max(moved, float(np.hypot(*(envs.simulation.people - before)[..., :2].T).max()))
    assert math.isclose(moved, 0.2, rel_tol=1e-9)
