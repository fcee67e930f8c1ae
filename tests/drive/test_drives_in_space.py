"""Drives in buildings in space: those of the plan where it is extruded, and 3D scanners."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.people import PERSON_HEIGHT, People
from ambinav.drive.readings import Readings
from ambinav.drive.robot import Robot
from ambinav.drive.world import REACHED
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.localization.parameters import MclParameters
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.drive.cases import laser, route_through
from tests.geometry.furnished import furnished
from tests.localization import worlds

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

LIDAR = RangeScanner.layered(
    RangeSensor(max_range=8.0, std=0.02, resolution=0.001),
    36, [math.radians(e) for e in (-20, -10, 0, 10, 20)], z=0.9,
)  # fmt: skip
ROUTE = [(1.0, 1.0), (7.5, 1.5), (7.5, 3.0), (3.0, 3.5)]
# Turned by a hair: no beam looks along a wall.
LASER = RangeScanner.planar(
    RangeSensor(max_range=5.0, std=0.03, resolution=0.001), 60, math.tau, (0.0, 0.0, 0.003)
).raised(0.4)


def tall(height: float = 2.5) -> Environment:
    plan = worlds.room()
    return plan.in_space(extruded(plan, height))


def driven(env: Environment, scanner: RangeScanner, localizer: Any, **options: Any) -> Drives:
    route = route_through(options.pop("route", ROUTE))
    rng = np.random.default_rng(options.pop("seed", 5))
    robot = Robot(radius=0.2)
    return drive_route(env, scanner, robot, route, localizer, rng, keep_ranges=True, **options)


def off(drives: Drives) -> np.ndarray:
    """Metres that the estimates are off."""
    errors = drives.errors()[..., :2]
    return np.hypot(errors[..., 0], errors[..., 1])


@pytest.mark.slow(kept=("mcl", "ekf"))
@pytest.mark.parametrize("localizer", ["mcl", "ekf", MclParameters(laser_model_type="beam_prob")])
def test_a_level_laser_drives_in_an_extruded_building_as_in_its_plan(localizer: Any) -> None:
    env = tall()
    flat, solid = (driven(one, LASER, localizer, runs=2) for one in (env.plan, env))
    assert flat.ranges is not None and solid.ranges is not None
    assert (flat.outcome == REACHED).all() and (solid.outcome == REACHED).all()
    echo = np.isfinite(flat.ranges)
    assert np.array_equal(echo, np.isfinite(solid.ranges))
    assert np.abs(flat.ranges[echo] - solid.ranges[echo]).max() < 1e-4
    for mine, other in ((flat.estimate, solid.estimate), (flat.truth, solid.truth)):
        assert np.allclose(mine, other, rtol=0.0, atol=1e-6, equal_nan=True)


@pytest.mark.parametrize("localizer", ["mcl", "ekf"])
def test_a_3d_scanner_drives(localizer: str) -> None:
    scanner = RangeScanner.from_preset("velodyne-vlp-16").thinned(360)
    drives = driven(tall(), scanner, localizer, runs=2)
    assert (drives.outcome == REACHED).all()
    assert np.nanquantile(off(drives), 0.9) < (0.1 if localizer == "mcl" else 0.01)


@pytest.mark.sweep
def test_all_beams_of_a_3d_scanner_drive() -> None:
    scanner = RangeScanner.from_preset("velodyne-vlp-16")
    for localizer, most in (("mcl", 0.1), ("ekf", 0.005)):
        drives = driven(tall(), scanner, localizer, runs=3)
        assert (drives.outcome == REACHED).all()
        assert np.nanquantile(off(drives), 0.95) < most


TABLE = MclParameters.for_scanner(LIDAR, beam_table_resolution=0.2)
ACROSS = [(1.0, 0.6), (4.5, 0.6), (4.3, 2.4)]


def test_in_a_mesh_ranges_are_looked_up() -> None:
    prisms, mesh = furnished()
    one, other = (driven(env, LIDAR, TABLE, runs=2, route=ACROSS) for env in (prisms, mesh))
    for drives in (one, other):
        assert (drives.outcome == REACHED).all()
        assert np.nanquantile(off(drives), 0.9) < 0.2
    level = driven(mesh, LASER, "mcl", runs=2, route=ACROSS)
    assert np.nanquantile(off(level), 0.9) < 0.25


def test_a_kalman_filter_tracks_in_a_mesh_as_in_prisms() -> None:
    one, other = (driven(env, LIDAR, "ekf", runs=3, route=ACROSS) for env in furnished())
    for drives in (one, other):
        assert (drives.outcome == REACHED).all()
        assert np.nanquantile(off(drives), 0.9) < 0.02


def test_what_no_building_in_space_takes_is_refused() -> None:
    prisms, mesh = furnished()
    with pytest.raises(InputError, match=r"it is a mesh.*give prisms.*beam_table_resolution"):
        driven(mesh, LIDAR, "mcl", runs=1, route=ACROSS)
    with pytest.raises(InputError, match=r"give the mount a height"):
        driven(prisms, laser(), "mcl", runs=1, route=ACROSS)


def test_people_are_met_in_an_extruded_building_as_in_its_plan() -> None:
    env = tall()
    flat, solid = (
        driven(one, LASER, "mcl", runs=2, people=People(4, speed=0.5)) for one in (env.plan, env)
    )
    bare = driven(env.plan, LASER, "mcl", runs=2)
    assert flat.ranges is not None and solid.ranges is not None and bare.ranges is not None
    echo = np.isfinite(flat.ranges)
    assert np.array_equal(echo, np.isfinite(solid.ranges))
    assert np.abs(flat.ranges[echo] - solid.ranges[echo]).max() < 1e-4
    assert np.allclose(flat.truth, solid.truth, rtol=0.0, atol=1e-6, equal_nan=True)
    assert (flat.ranges[0, 0] < bare.ranges[0, 0] - 0.3).any()


@pytest.mark.parametrize("mesh", [False, True])
def test_rays_pass_over_people_and_end_on_their_heads(mesh: bool) -> None:
    env = furnished()[mesh]
    person = np.array([[[3.5, 3.0, 0.0]]])
    pose = np.array([[1.0, 3.0, 0.0]])

    def ahead(z: float, elevation: float) -> float:
        up = [[z, elevation]]
        scanner = RangeScanner.from_mounts(LIDAR.sensors, [[0.0, 0.0, 0.0]], upright=up)
        return float(Readings(env, scanner).true_ranges(pose, person, 0.25)[0, 0])

    assert PERSON_HEIGHT == 1.7
    for z in (0.3, 1.69):
        assert ahead(z, 0.0) == pytest.approx(2.25, abs=1e-5)
    # Over the head to the wall, and down on it: 2.4 m ahead, 0.3 m below.
    assert ahead(1.71, 0.0) == pytest.approx(5.0, abs=1e-5)
    assert ahead(2.0, -math.atan2(0.3, 2.4)) == pytest.approx(math.hypot(0.3, 2.4), abs=1e-5)
    # Steeply up in front of the person, to the ceiling; and from below it past nothing.
    assert ahead(0.5, math.radians(60.0)) == pytest.approx(2.0 / math.sin(math.radians(60.0)), 1e-5)
    up = math.atan2(1.0, 2.25)
    assert ahead(0.6, up) == pytest.approx(math.hypot(1.0, 2.25), abs=1e-5)
    # Who stands on the sensor is not seen: it looks at the cupboard.
    person[0, 0, :2] = 1.1, 3.0
    assert ahead(0.3, 0.0) == pytest.approx(3.6, abs=1e-5)


SONARS = RangeScanner.planar(
    RangeSensor(
        max_range=4.0, std=0.03, resolution=0.01, aperture=math.radians(20.0),
        max_incidence=math.radians(40.0),
    ), 16, math.tau,
).raised(0.5)  # fmt: skip


@pytest.mark.slow(kept=("ekf",))
@pytest.mark.parametrize(
    ("localizer", "most"),
    [
        ("mcl", 0.25),
        ("ekf", 0.2),
        (MclParameters.for_scanner(SONARS, beam_table_resolution=0.0), 0.2),
    ],
    ids=["mcl", "ekf", "cast"],
)
def test_sonars_drive_in_space(localizer: Any, most: float) -> None:
    """What they read there is nearer than in the plane, and localizers know it."""
    drives = driven(tall(), SONARS, localizer, runs=2)
    assert (drives.outcome == REACHED).all()
    assert np.nanquantile(off(drives), 0.9) < most
