"""Tasks that a follower cannot do: what befalls the robot, against geometry worked out apart."""

from __future__ import annotations

import math
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import shapely

import ambinav as an
import ambinav_envs
from ambinav.drive.clutter import with_obstacles
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.free_space import FreeSpaceLattice
from ambinav_envs.buildings.tasks import draw_task
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.tasks import HARD_TASKS, TWIN_ROOMS
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

gym.register_envs(ambinav_envs)
STAND = np.array([-1.0, 0.0], dtype=np.float32)
AHEAD = np.array([1.0, 0.0], dtype=np.float32)


def two_doors() -> Environment:
    """Two rooms of 6 m by 8 m; a wall of 0.2 m between them has doors of 1 m at y = 1 and y = 7."""
    floor = shapely.box(0, 0, 12, 8).difference(shapely.box(5.9, 0, 6.1, 8))
    doors = [shapely.box(5.8, y - 0.5, 6.2, y + 0.5) for y in (1.0, 7.0)]
    return an.environment_from_shapes([shapely.union_all([floor, *doors])])


def polygon(box: np.ndarray) -> shapely.Polygon:
    """A box as a polygon."""
    middle, a, b = box[:2], box[2:4], box[4:]
    return shapely.Polygon([middle + a + b, middle - a + b, middle - a - b, middle + a - b])


def behind_a_door(**options: Any) -> NavigationEnv:
    return NavigationEnv(
        map=two_doors(), window=False, closed_door=1.0, longest=30.0, waypoint=True, **options
    )


@pytest.mark.parametrize("weight", [0.0, 5.0])
def test_a_closed_door_is_a_wall_of_the_world_with_another_way_around(weight: float) -> None:
    env = behind_a_door(ambiguity_weight=weight)
    for seed in range(8):
        env.reset(seed=seed)
        simulation = env.simulation
        task, box = simulation.tasks[0], simulation.boxes[0, 0]
        assert task is not None and task.door is not None
        assert simulation.state["boxes"][0] == 1 and np.array_equal(box, task.door)
        # It stands in one of the two doorways, from post to post.
        assert abs(box[0] - 6.0) < 0.1 and min(abs(box[1] - 1.0), abs(box[1] - 7.0)) < 0.1
        assert math.hypot(*box[2:4]) == pytest.approx(0.6, abs=0.02) and abs(box[2]) < 0.1
        # A building with that wall has paths of the same length, and the map's are shorter.
        world = with_obstacles(two_doors(), [polygon(box)])
        radius = simulation.parameters.robot.radius
        lattice = FreeSpaceLattice.of(
            CollisionChecker(world, Footprint.disc(radius), Steering("r2"), simulated=True)
        )
        site = simulation.sites[0]
        assert site is not None
        lengths = [
            draw_task(each, np.ones(4, np.uint64), 2, 30, start=task.start, goal=task.goal).distance
            for each in (lattice, site.lattice)
        ]
        assert task.distance == pytest.approx(lengths[0], rel=0.03)
        assert 1.3 <= task.distance / lengths[1] <= 4.0 + 1e-6
        assert simulation.state["shortest"][0] == task.distance


def test_the_same_door_is_closed_whatever_the_route() -> None:
    boxes = []
    for weight in (0.0, 5.0):
        env = behind_a_door(ambiguity_weight=weight)
        boxes.append([env.reset(seed=k) and env.simulation.boxes[0, 0].copy() for k in range(5)])
    equal(*boxes)


def test_the_waypoint_leads_through_the_closed_door_and_a_robot_touches_it() -> None:
    env = behind_a_door(localizer="perfect", odometry_scale=0.0)
    env.reset(seed=0, options={"start": (4.0, 7.0, 0.0), "goal": (9.0, 7.0)})
    assert env.simulation.boxes[0, 0, 0] == pytest.approx(6.0, abs=0.2)
    info: dict[str, Any] = {}
    done = False
    while not done:
        seen, _, done, _, info = env.step(AHEAD)
        assert seen["waypoint"][1] > 0.95
    assert info["outcome"] == "collided"
    assert info["true_pose"][0] == pytest.approx(6.0 - 0.05 - 0.22, abs=0.12)


def test_without_another_way_no_door_is_closed_and_that_is_said() -> None:
    env = NavigationEnv(map=room(), window=False, closed_door=1.0)
    with pytest.raises(InputError, match=r"closed_door: the paths drawn in .* lead through no"):
        env.reset(seed=0)


def test_a_share_of_the_doors_is_closed_beside_clutter() -> None:
    envs = NavigationVectorEnv(
        40, map=two_doors(), window=False, closed_door=0.5, obstacles=2, longest=30.0
    )
    envs.reset(seed=0)
    doors = [task is not None and task.door is not None for task in envs.simulation.tasks]
    assert 8 <= sum(doors) <= 32
    assert (envs.simulation.state["boxes"] - doors <= 2).all()
    assert (envs.simulation.state["boxes"] - doors).max() == 2


def test_a_kidnapped_robot_is_elsewhere_and_odometry_does_not_tell() -> None:
    env = NavigationEnv(
        map=two_doors(), window=False, kidnapped=1.0, kidnap_seconds=(1.0, 2.0), obstacles=3,
        longest=30.0, localizer="odometry", odometry_scale=0.0, dt=0.1,
    )  # fmt: skip
    for seed in range(10):
        _, info = env.reset(seed=seed)
        state = env.simulation.state[0]
        at, pose = int(state["kidnap_step"]), state["kidnap_pose"].copy()
        cost = float(state["kidnap_cost"])
        assert 10 <= at <= 20
        boxes = shapely.union_all([polygon(b) for b in env.simulation.boxes[0, : state["boxes"]]])
        assert boxes.distance(shapely.Point(pose[:2])) > 0.3
        start, told = info["true_pose"].copy(), info["odometry"].copy()
        for k in range(1, at + 3):
            _, _, _, _, info = env.step(STAND)
            assert np.array_equal(info["true_pose"], pose if k > at else start)
            assert np.array_equal(info["odometry"], told)
            assert info["terms"]["progress"] == 0.0
        # What is left of the path counts from there.
        task = env.simulation.tasks[0]
        assert task is not None
        env.reset(options={"start": tuple(pose), "goal": tuple(task.goal)})
        assert env.simulation.state["shortest"][0] == pytest.approx(cost, rel=0.02)


def test_kidnapping_changes_nothing_until_it_happens() -> None:
    one, other = (
        NavigationEnv(map=room(), window=False, kidnapped=share, slip=slip, slip_radius=1e-9)
        for share, slip in ((0.0, 1e-9), (1.0, 1e-9))
    )
    equal(one.reset(seed=1), other.reset(seed=1))
    for _ in range(int(other.simulation.state["kidnap_step"][0])):
        result = one.step(AHEAD)
        equal(result, other.step(AHEAD))
        if result[2]:
            break


def test_an_unknown_start_is_not_given_away() -> None:
    small = {"max_particles": 1000, "laser_model_type": "likelihood_field_prob"}
    options: dict[str, Any] = {"localizer": "mcl", "mcl": small, "window": False}
    errors, deviations = [], []
    for unknown in (True, False):
        envs = NavigationVectorEnv(16, map=room(), start_unknown=unknown, **options)
        seen, info = envs.reset(seed=0)
        errors.append(np.median(info["error"]))
        deviations.append(np.median(seen["uncertainty"][:, 0]))
    assert errors[0] > 1.0 > 0.2 > errors[1]
    assert deviations[0] > 1.0 > 0.2 > deviations[1]
    with pytest.raises(InputError, match="needs a first estimate; give localizer='mcl'"):
        NavigationEnv(map=room(), start_unknown=True)


def test_odometry_counts_wheels_that_slip() -> None:
    env = NavigationEnv(
        map=two_doors(), window=False, slip=0.5, slip_radius=1.0, odometry_scale=0.0,
        localizer="perfect", goal_radius=1e-3,
    )  # fmt: skip
    env.reset(seed=0, options={"start": (0.5, 4.0, 0.0), "goal": (5.5, 4.0)})
    middle = env.simulation.state["slippery"][0].copy()
    assert 1.5 < middle[0] < 4.5 and middle[1] == pytest.approx(4.0, abs=0.2)
    before = env.simulation.state["odometry"][0].copy()
    travelled, place = 0.0, (0.5, 4.0)
    for _ in range(90):
        _, _, done, _, info = env.step(AHEAD)
        inside = math.dist(place, middle) <= 1.0
        place, length = info["true_pose"][:2], info["travelled"] - travelled
        told = math.dist(info["odometry"][:2], before[:2])
        assert told == pytest.approx((1.5 if inside else 1.0) * length, abs=1e-9)
        before, travelled = info["odometry"].copy(), info["travelled"]
        if done:
            break


def test_who_is_unsure_has_not_arrived() -> None:
    common: dict[str, Any] = {
        "map": room(), "window": False, "localizer": "odometry", "start_std": (0.2, 0.1, 0.02),
        "goal_radius": 1.0, "success_radius": 5.0,
    }  # fmt: skip
    for most, ends in ((None, True), (0.21, True), (0.19, False)):
        env = NavigationEnv(goal_std=most, **common)
        env.reset(seed=3, options={"start": (2.0, 2.0, 0.0), "goal": (2.1, 2.0)})
        assert env.step(STAND)[2] is ends


def test_a_scanner_of_plain_numbers() -> None:
    scanner = NavigationParameters.of({"scanner": {"beams": 30, "aperture": 1.5}}).scanner
    assert scanner.beams == 30 and np.ptp(scanner.mounts[:, 2]) == pytest.approx(1.5)
    with pytest.raises(InputError, match="aperture"):
        NavigationParameters.of({"scanner": {"aperture": 7.0}})
    with pytest.raises(InputError, match="did you mean"):
        NavigationParameters.of({"scanner": {"beam": 7}})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kidnapped": 1.5}, "kidnapped"),
        ({"kidnap_seconds": (3.0, 1.0)}, "the first and the last moment"),
        ({"detour": (0.9, 2.0)}, "two numbers above 1"),
        ({"goal_std": 0.0}, "goal_std"),
        ({"slip": -1.0}, "slip"),
    ],
)
def test_what_makes_no_sense_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        NavigationParameters.of(options)


@pytest.mark.slow(
    kept=("ambinav/Kidnapped-v1", "ambinav/NarrowScanner-v1", "ambinav/TwinRooms5-v3")
)
@pytest.mark.parametrize("name", [spec.name for spec in (*HARD_TASKS, *TWIN_ROOMS[2::2])])
def test_a_pickled_batch_goes_on_bit_for_bit(name: str) -> None:
    options = {"kidnap_seconds": (1.0, 4.0)} if "Kidnapped" in name else {}
    envs = gym.make_vec(name, num_envs=4, buildings=2, **options).unwrapped
    envs.reset(seed=0)
    rng = np.random.default_rng(0)

    def some() -> np.ndarray:
        return rng.uniform((-1.0, -0.6, -1.0), (-0.2, 0.6, 0.4), (4, 3)).astype(np.float32)

    for _ in range(20):
        envs.step(some())
    copy = pickle.loads(pickle.dumps(envs))
    for _ in range(60):
        action = some()
        equal(envs.step(action), copy.step(action))
