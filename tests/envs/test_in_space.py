"""Environments in buildings of prisms."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.demo import BUILDING
from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav_envs.navigation import NavigationEnv
from tests.envs.cases import room
from tests.geometry.furnished import furnished

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


def test_a_level_scanner_sees_in_an_extruded_room_what_it_sees_in_the_plan() -> None:
    env = tall()
    (flat, _), (solid, _) = (episode(one, LASER) for one in (env.plan, env))
    assert len(flat) == len(solid) > 5
    for mine, other in zip(flat, solid, strict=True):
        assert set(mine) == set(other)
        for part, values in mine.items():
            assert np.allclose(values, other[part], rtol=0.0, atol=1e-3), part


@pytest.mark.parametrize("localizer", ["ekf", "mcl"])
def test_a_3d_scanner_is_localized(localizer: str) -> None:
    rows, worst = episode(tall(), LIDAR, localizer=localizer)
    assert len(rows) > 5 and worst < 0.3


@pytest.mark.parametrize(
    "option", [{"people": 1}, {"obstacles": 2}, {"closed_door": 0.5}, {"scan_time": 0.1}]
)
def test_what_is_known_for_plans_alone_is_refused(option: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{next(iter(option))} is known for plans alone"):
        episode(tall(), LASER, **option)


def test_a_mesh_and_a_scanner_on_the_floor_are_refused() -> None:
    with pytest.raises(InputError, match=r"it is a mesh.*environments to train in.*give prisms"):
        episode(furnished()[1], LASER)
    with pytest.raises(InputError, match="give the mount a height"):
        episode(tall(), LASER.raised(-0.4))


def test_a_map_file_may_say_its_heights() -> None:
    env = NavigationEnv(
        map={"file": str(BUILDING), "space": {"extrude": 2.5}},
        scanner={"beams": 12, "height": 0.4},
        max_steps=2,
    )
    env.reset(seed=1)
    found = env.unwrapped.simulation.source.get(0).environment
    assert found.space is not None and found.space.ceiling == 2.5
    for wrong, part in (
        ({}, "map: the key 'file' is missing"),
        ({"file": str(BUILDING), "extrude": 2}, "map: the key 'extrude' is unknown"),
        ({"file": str(BUILDING), "space": {"extrude": -1}}, "map: space: extrude is -1; give"),
    ):
        with pytest.raises(InputError, match=part):
            NavigationEnv(map=wrong)
    with pytest.raises(InputError, match="give the mount a height"):
        NavigationEnv(map={"file": str(BUILDING), "space": {"extrude": 2.0}}).reset(seed=1)


def test_files_of_a_configuration_are_found_beside_it(tmp_path: Path) -> None:
    shutil.copy(BUILDING, tmp_path / "demo.geojson")
    path = tmp_path / "ppo.yaml"
    path.write_text(
        "steps: 64\nenvs: 2\nenvironment: {id: ambinav/Navigation-v0, scanner: {height: 0.3}, "
        "map: {file: demo.geojson, space: {extrude: 2.5}}}\n"
    )
    pytest.importorskip("stable_baselines3")
    from ambinav_envs.training.config_file import load_config

    assert load_config(path).environment["map"]["file"] == str(tmp_path / "demo.geojson")
