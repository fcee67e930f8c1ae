"""Environments in buildings of prisms and in meshes."""

from __future__ import annotations

import math
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.solids import with_solids
from ambinav.demo import DEMO_BUILDING
from ambinav.drive.clutter import with_obstacles
from ambinav.drive.readings import Readings
from ambinav.drive.world import unicycle
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.layout import Part
from ambinav.sensing.space_layout import Camera
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.simulation.space_scan import DOOR_HEIGHT
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room
from tests.envs.test_tasks import polygon, two_doors
from tests.geometry.furnished import furnished

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

SENSOR = RangeSensor(max_range=5.0, std=0.03, resolution=0.001)
# Turned by a hair: no beam looks along a wall.
LASER = RangeScanner.planar(SENSOR, 36, math.tau, (0.0, 0.0, 0.003)).raised(0.4)
LIDAR = RangeScanner.layered(SENSOR, 24, np.radians([-15.0, 0.0, 10.0]), z=0.5)


def tall() -> Environment:
    plan = room()
    return plan.in_space(extruded(plan, 2.5))


def episode(environment: Environment, scanner: RangeScanner, **options: Any) -> Any:
    """What is seen in twenty steps, and how far off the estimate is at most."""
    env = NavigationEnv(map=environment, scanner=scanner, **options)
    seen, _ = env.reset(seed=3)
    rows, worst = [seen], 0.0
    for k in range(20):
        seen, _, ended, _, info = env.step(np.array([0.4, 0.5 * math.sin(k / 3.0)]))
        rows.append(seen)
        worst = max(worst, info["error"])
        if ended:
            break
    return rows, worst


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"scan_time": 0.2},
        {"people": 4, "obstacles": 5},
        {"people": 4, "obstacles": 5, "scan_time": 0.2, "walls_std": 0.03, "furniture_std": 0.3},
    ],
)
def test_a_level_scanner_sees_in_an_extruded_room_what_it_sees_in_the_plan(
    options: dict[str, Any],
) -> None:
    env = tall()
    (flat, _), (solid, _) = (episode(one, LASER, **options) for one in (env.plan, env))
    assert len(flat) == len(solid) > 5
    for mine, other in zip(flat, solid, strict=True):
        assert set(mine) == set(other)
        for part, values in mine.items():
            assert np.allclose(values, other[part], rtol=0.0, atol=1e-3), part


@pytest.mark.slow(kept=("ekf",))
@pytest.mark.parametrize("localizer", ["ekf", "mcl"])
def test_a_3d_scanner_is_localized(localizer: str) -> None:
    rows, worst = episode(tall(), LIDAR, localizer=localizer)
    assert len(rows) > 5 and worst < 0.3


EXACT = RangeSensor(max_range=20.0, std=0.0, resolution=1e-5, random_share=0.0)
CAMERA = RangeScanner((Part(EXACT, Camera(6, 4, math.radians(80.0), math.radians(50.0), z=0.5)),))


@pytest.mark.slow(kept=("scanner1-1", "scanner2-12"))
@pytest.mark.parametrize(
    ("scanner", "moments"),
    [
        # Beams of one azimuth are taken at once, those of a picture all.
        (RangeScanner.layered(EXACT, 24, np.radians([-15.0, 0.0, 10.0]), z=0.5), 24),
        (CAMERA, 1),
        (RangeScanner.planar(EXACT, 12, math.radians(200.0), z=0.9, pitch=0.2), 12),
    ],
)
def test_beams_of_a_scan_are_taken_from_where_the_robot_was_then(
    scanner: RangeScanner, moments: int
) -> None:
    duration, building = 0.2, tall()
    env = NavigationEnv(
        map=building, scanner=scanner, scan_time=duration, localizer="perfect", window=False
    )
    env.reset(seed=4, options={"start": (9.0, 6.0, 0.5), "goal": (12.0, 6.0)})
    space, across, up = building.space, scanner.mounts, scanner.upright
    assert isinstance(space, Prisms) and not across[:, :2].any()
    share = np.tile(np.arange(1 - moments, 1) / moments, scanner.beams // moments)
    if moments == 1:
        share = np.zeros(scanner.beams)
    moved = 0.0
    for _ in range(12):
        env.step(np.array([0.2, 0.8]))
        state = env.simulation.state[0]
        was = np.array(
            [unicycle(*state["truth"], *state["ground"], duration * one) for one in share]
        )
        ranges = []
        for poses in (was, np.tile(state["truth"], (scanner.beams, 1))):
            azimuth, flat = poses[:, 2] + across[:, 2], np.cos(up[:, 1])
            direction = np.column_stack(
                [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(up[:, 1])]
            )
            ranges.append(space.cast(np.column_stack([poses[:, :2], up[:, 0]]), direction, 20.0)[0])
        off = np.abs(env.simulation.readings[0] - ranges[0])
        assert off.max() < 2e-5, off
        moved = max(moved, float(np.abs(ranges[0] - ranges[1]).max()))
    assert moved > 0.1 if moments > 1 else moved == 0.0


@pytest.mark.slow(kept=("ekf",))
@pytest.mark.parametrize("localizer", ["perfect", "ekf", "mcl"])
def test_sonars_read_the_nearest_echo_in_their_cones(localizer: str) -> None:
    """As `RangeScanner.scan` has it: below a table top, over a floor that is met too flatly."""
    plan, building = tall().plan, tall()
    top = Solid(shapely.box(8.0, 5.0, 10.0, 7.0), 0.7, 0.75)
    assert isinstance(building.space, Prisms)
    building = plan.in_space(with_solids(building.space, [top]))
    cone = RangeSensor(
        max_range=5.0, std=0.0, resolution=1e-5, aperture=math.radians(25.0), random_share=0.0,
        max_incidence=math.radians(40.0),
    )  # fmt: skip
    ring = RangeScanner.ring(cone, 8, 0.15).raised(0.4)
    env = NavigationEnv(map=building, scanner=ring, localizer=localizer, window=False)
    env.reset(seed=4, options={"start": (9.0, 6.0, 0.5), "goal": (12.0, 6.0)})
    for _ in range(8):
        env.step(np.array([0.2, 0.8]))
        truth = env.simulation.state[0]["truth"]
        expected = ring.scan(building, *truth)
        readings = env.simulation.readings[0]
        assert np.array_equal(np.isfinite(readings), np.isfinite(expected))
        met = np.isfinite(expected)
        assert met.any()
        assert np.abs(readings[met] - expected[met]).max() < 2e-5


def test_rays_meet_boxes_people_and_doors_at_their_heights() -> None:
    plan = two_doors()
    building = plan.in_space(extruded(plan, 2.5))
    scanner = RangeScanner.layered(EXACT, 24, np.radians([-30.0, -12.0, 0.0, 8.0]), z=1.2)
    env = NavigationEnv(
        map=building, scanner=scanner, localizer="perfect", window=False, closed_door=1.0,
        longest=30.0, obstacles=4, people=3,
    )  # fmt: skip
    simulation, shaded = env.simulation, np.zeros(2, dtype=int)
    for seed in range(10):
        env.reset(seed=seed)
        state = simulation.state[0]
        assert state["door"] and state["boxes"] >= 1
        door, *boxes = map(polygon, simulation.boxes[0, : state["boxes"]])
        alone = with_obstacles(building, [door], height=DOOR_HEIGHT)
        among = with_obstacles(alone, boxes)
        pose = state["truth"][None]
        bare, doors = (Readings(world, scanner).true_ranges(pose)[0] for world in (building, alone))
        wanted = Readings(among, scanner).true_ranges(pose, simulation.people, 0.25)[0]
        assert np.abs(simulation.readings[0] - wanted).max() < 2e-5
        shaded += (doors < bare - 0.01).sum(), (wanted < doors - 0.01).sum()
    assert (shaded > 10).all()


@pytest.mark.slow(kept=("options1",))
@pytest.mark.parametrize(
    "options", [{}, {"people": 1, "obstacles": 1}, {"people": 1, "obstacles": 1, "scan_time": 0.2}]
)
def test_a_mesh_is_read_as_the_prisms_of_the_same_room(options: dict[str, Any]) -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    ceiling = RangeSensor(
        max_range=5.0, std=0.0, resolution=1e-5, random_share=0.0, max_incidence=math.radians(60)
    )
    for sensor in (EXACT, ceiling):
        scanner = RangeScanner.layered(sensor, 24, np.radians([-25.0, 0.0, 20.0]), z=0.9)
        scans = []
        for building in furnished():
            env = NavigationEnv(
                map=building, scanner=scanner, localizer="perfect", window=False,
                obstacle_sizes=(0.2, 0.3), robot={"radius": 0.15}, dt=0.1, **options,
            )  # fmt: skip
            env.reset(seed=2)
            rows = [env.simulation.readings[0].copy()]
            for _ in range(8):
                env.step(np.array([-0.4, 0.6]))
                rows.append(env.simulation.readings[0].copy())
            scans.append(np.array(rows))
        prisms, mesh = scans
        echo = np.isfinite(prisms)
        assert np.array_equal(echo, np.isfinite(mesh)) and (sensor is EXACT) == echo.all()
        assert np.abs(prisms[echo] - mesh[echo]).max() < 1e-4


def test_a_robot_is_localized_in_a_mesh_by_ranges_looked_up() -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    mesh, scanner = furnished()[1], LIDAR.raised(0.4)
    table = {"laser_model_type": "beam_prob", "beam_table_resolution": 0.2}
    options: dict[str, Any] = {"localizer": "mcl", "mcl": table, "people": 1}
    rows, worst = episode(mesh, scanner, **options)
    assert len(rows) > 5 and worst < 0.3
    # One of a batch is the environment by itself, to the last bit; and a copy goes on as it was.
    envs = NavigationVectorEnv(3, map=mesh, scanner=scanner, **options)
    many, _ = envs.reset(seed=[1, 3, 2])
    assert all(np.array_equal(many[part][1], rows[0][part]) for part in many)
    copied = pickle.loads(pickle.dumps(envs))
    actions = np.tile(np.float32([0.4, 0.2]), (3, 1))
    for _ in range(3):
        equal(envs.step(actions), copied.step(actions))


def test_a_mesh_and_a_scanner_on_the_floor_are_refused() -> None:
    with pytest.raises(InputError, match=r"it is a mesh.*no kernel casts rays; give prisms"):
        episode(furnished()[1], LASER)
    with pytest.raises(InputError, match="give the mount a height"):
        episode(tall(), LASER.raised(-0.4))


def test_a_map_file_may_say_its_heights() -> None:
    env = NavigationEnv(
        map={"file": str(DEMO_BUILDING), "space": {"extrude": 2.5}},
        scanner={"beams": 12, "height": 0.4},
        max_steps=2,
    )
    env.reset(seed=1)
    found = env.unwrapped.simulation.source.get(0).environment
    assert found.space is not None and found.space.ceiling == 2.5
    for wrong, part in (
        ({}, "map: the key 'file' is missing"),
        ({"file": str(DEMO_BUILDING), "extrude": 2}, "map: the key 'extrude' is unknown"),
        ({"file": str(DEMO_BUILDING), "space": {"extrude": -1}}, "map: space: extrude is -1; give"),
    ):
        with pytest.raises(InputError, match=part):
            NavigationEnv(map=wrong)
    with pytest.raises(InputError, match="give the mount a height"):
        NavigationEnv(map={"file": str(DEMO_BUILDING), "space": {"extrude": 2.0}}).reset(seed=1)


def test_files_of_a_configuration_are_found_beside_it(tmp_path: Path) -> None:
    shutil.copy(DEMO_BUILDING, tmp_path / "demo.geojson")
    path = tmp_path / "ppo.yaml"
    path.write_text(
        "steps: 64\nenvs: 2\nenvironment: {id: ambinav/Navigation-v1, scanner: {height: 0.3}, "
        "map: {file: demo.geojson, space: {extrude: 2.5}}}\n"
    )
    pytest.importorskip("stable_baselines3")
    from ambinav_envs.training.config_file import load_training_config

    assert load_training_config(path).environment["map"]["file"] == str(tmp_path / "demo.geojson")
