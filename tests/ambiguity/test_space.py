"""Buildings in space: the plan's map where they are extruded, and what only 3D scanners resolve."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.ambiguity.heading import turns
from ambinav.ambiguity.model import independent_tau, thin
from ambinav.ambiguity.returns import BLIND, beam_returns, panorama_returns
from ambinav.buildings.load import load_environment
from ambinav.buildings.mesh.floor import floor_environment
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import REFLECTOR, Segments
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.map_building.build import MapSettings, build_map
from ambinav.map_building.stored import map_key
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, RangeSensor
from tests.geometry import scenes
from tests.geometry.furnished import furnished

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

SENSOR = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
# Turned by a hair: rays along the walls of a lattice meet corners, which of them is not said.
LASER = RangeScanner.planar(SENSOR, 60, math.tau, (0.0, 0.0, 0.003)).raised(0.4)
LIDAR = RangeScanner.layered(SENSOR, 72, np.radians(np.arange(-15, 16, 5)), z=0.4)


def tall(env: Environment, height: float = 2.5) -> Environment:
    return env.in_space(extruded(env, height))


def level(env: Environment, scanner: RangeScanner, **options: Any) -> Any:
    return build_map(env, scanner, store=False, **options).dataset["level"].values


# -- an extruded plan is the plan --------------------------------------------------------------


def test_a_level_scanner_reads_in_an_extruded_plan_what_it_reads_in_the_plan() -> None:
    env = scenes.scene(5, size=20.0)
    rng = np.random.default_rng(1)
    x, y, theta = rng.uniform((0, 0, -3), (20, 20, 3), (300, 3)).T
    robot = RangeScanner.mixed(
        RangeScanner.planar(SENSOR, 90, 4.0, (0.1, 0.05, 0.3), z=0.3),
        RangeScanner.planar(SENSOR, 8, 2.0, (0.2, 0.0, 0.0), z=1.1),
    )
    flat, solid = robot.scan(env, x, y, theta), robot.scan(tall(env), x, y, theta)
    assert np.array_equal(np.isfinite(flat), np.isfinite(solid))
    assert np.array_equal(np.isnan(flat), np.isnan(solid))
    met = np.isfinite(flat)
    assert np.abs(flat[met] - solid[met]).max() < 1e-4


@pytest.mark.parametrize("headings", [None, 3])
def test_its_map_is_that_of_the_plan(demo: Environment, headings: int | None) -> None:
    options: dict[str, Any] = {"spacing": 0.4, "headings": headings}
    flat, solid = level(demo, LASER, **options), level(tall(demo), LASER, **options)
    assert np.array_equal(np.isnan(flat), np.isnan(solid))
    assert np.nanmax(np.abs(flat - solid)) < 0.02


@pytest.mark.slow
def test_its_map_is_that_of_a_recorded_plan(data_dir: Path) -> None:
    env = load_environment(data_dir / "maps" / "nav2_depot.yaml")
    flat, solid = level(env, LASER, spacing=0.3), level(tall(env), LASER, spacing=0.3)
    assert np.array_equal(np.isnan(flat), np.isnan(solid))
    assert np.nanmax(np.abs(flat - solid)) < 0.02


def test_layers_that_see_walls_alone_change_little(demo: Environment) -> None:
    """Beams at 6 degrees up or down meet the same walls where rooms are high."""
    flat = level(demo, LASER, spacing=0.4)
    fan = RangeScanner.layered(SENSOR, 60, np.radians([-6.0, 0.0, 6.0]), z=5.0)
    many = level(tall(demo, 10.0), fan, spacing=0.4)
    assert np.nanquantile(np.abs(flat - many), 0.95) < 0.1
    assert abs(np.nanmean(flat) - np.nanmean(many)) < 0.02


def test_a_plan_keeps_what_was_worked_out_of_its_floor() -> None:
    plan = scenes.room(6.0, 4.0)
    mesh, itself = plan.triangulation, plan.collision
    env = tall(plan)
    assert env.triangulation is mesh and env.plan.triangulation is mesh
    assert itself is plan and env.collision is env and env.plan.collision.space is None
    assert plan.space is None and plan.plan is plan
    with pytest.raises(InputError, match="floor is nan"):
        plan.in_space(Prisms([(0, 0, 1, 0)], [(0, 1)]), math.nan)


# -- prisms and meshes -------------------------------------------------------------------------


def test_prisms_and_mesh_agree() -> None:
    prisms, mesh = furnished()
    rng = np.random.default_rng(2)
    x, y, theta = rng.uniform((0.3, 0.3, -3), (4.4, 2.7, 3), (200, 3)).T
    ranges, of_mesh = LIDAR.scan(prisms, x, y, theta), LIDAR.scan(mesh, x, y, theta)
    met = np.isfinite(ranges) & np.isfinite(of_mesh)
    assert (np.isfinite(ranges) == np.isfinite(of_mesh)).mean() > 0.999
    assert np.quantile(np.abs(ranges[met] - of_mesh[met]), 0.999) < 1e-4
    options: dict[str, Any] = {"spacing": 0.25, "max_beams": 126}
    one, other = (level(env, LIDAR, **options) for env in (prisms, mesh))
    assert np.array_equal(np.isnan(one), np.isnan(other))
    assert np.nanmax(np.abs(one - other)) < 0.02


def test_a_map_of_a_mesh_counts_heights_from_its_floor() -> None:
    _, mesh = furnished()
    assert isinstance(mesh.space, Mesh)
    high = Mesh(
        mesh.space.vertices + np.array([0.0, 0.0, 7.0]), mesh.space.faces, name="first floor"
    )
    env = floor_environment(high, 1.5, 0.2, floor=7.0)
    assert env.space is high and env.floor == 7.0
    here = LASER.scan(env, 1.0, 3.0, 0.2)
    assert here == pytest.approx(LASER.scan(mesh, 1.0, 3.0, 0.2), abs=1e-5)


# -- the gradient of a range -------------------------------------------------------------------


@pytest.mark.parametrize("in_mesh", [False, True])
def test_derivatives_of_ranges_are_finite_differences(in_mesh: bool) -> None:
    env = furnished()[in_mesh]
    scanner = RangeScanner.mixed(
        RangeScanner.layered(
            SENSOR, 24, [-0.5, -0.1, 0.0, 0.2, 0.6], mount=(0.1, -0.1, 0.2), z=1.0
        ),
        RangeScanner.planar(SENSOR, 12, math.tau, (0.05, 0.1, 0.0), z=1.3, pitch=0.4, roll=-0.3),
    )
    table = BeamTable.of(scanner, 0.02, 0.05)
    pose, step = np.array([1.2, 2.6, 0.7]), 2e-4
    data = np.zeros((7, 1, 5, len(table.limit)), dtype=np.float32)
    shifts = [np.zeros(3), *(sign * step * axis for axis in np.eye(3) for sign in (1, -1))]
    for k, shift in enumerate(shifts):
        x, y, theta = pose + shift
        beam_returns(env, scanner, table, np.array([x]), np.array([y]), float(theta), data[k])
    beams = scanner.beams
    here, expected = data[0, 0, :, :beams], data[1::2, 0, 0, :beams] - data[2::2, 0, 0, :beams]
    expected /= 2 * step
    # Where no beam crosses an edge within the step the range is that of one plane.
    bent = np.abs(data[1::2, 0, 0, :beams] + data[2::2, 0, 0, :beams] - 2 * here[0]).max(axis=0)
    smooth = (bent < 1e-5) & (here[0] < 3.9)
    assert smooth.sum() > 0.7 * beams
    assert here[1:4, smooth] == pytest.approx(expected[:, smooth], abs=0.03)
    steep = scanner.upright[:, 1] != 0.0
    assert np.abs(here[1:4, smooth & steep]).max() > 0.5


def test_headings_of_a_panorama_are_those_cast_one_by_one() -> None:
    env, _ = furnished()
    scanner = RangeScanner.mixed(
        LIDAR.thinned(84), RangeScanner.planar(SENSOR, 12, math.tau, pitch=0.2).raised(0.6)
    )
    table, headings = BeamTable.of(scanner, 0.02, 0.05), np.array([0.0, 0.5, math.pi / 2])
    x, y = np.array([1.0, 3.0]), np.array([3.0, 2.4])
    whole = np.zeros((3, 2, 5, len(table.limit)), dtype=np.float32)
    panorama_returns(env, scanner, table, x, y, headings, whole)
    one = np.zeros_like(whole[0])
    for h, heading in enumerate(headings):
        beam_returns(env, scanner, table, x, y, float(heading), one)
        same = np.isclose(whole[h], one, rtol=1e-3, atol=1e-4)
        assert same.mean() > 0.995


def test_the_fisher_bound_of_an_extruded_plan_is_that_of_the_plan(demo: Environment) -> None:
    options: dict[str, Any] = {"spacing": 0.5, "layers": "fisher", "store": False}
    flat, solid = (build_map(env, LASER, **options).dataset for env in (demo, tall(demo)))
    for name in ("fisher", "fisher_minor"):
        assert np.nanquantile(np.abs(flat[name] - solid[name]), 0.999) < 1e-4
        assert np.array_equal(np.isnan(flat[name]), np.isnan(solid[name]))


def test_the_fisher_bound_in_space_is_the_sum_over_its_beams() -> None:
    env, _ = furnished()
    amap = build_map(env, LIDAR, spacing=0.5, layers="fisher", max_beams=84, store=False)
    row, column = np.argwhere(amap.dataset["free"].values)[20]
    x, y = float(amap.dataset["x"][column]), float(amap.dataset["y"][row])
    step, poses = 1e-3, []
    for axis in np.eye(3):
        poses += [np.array([x, y, 0.0]) + sign * step * axis for sign in (1, -1)]
    ranges = LIDAR.scan(env, *np.array(poses).T).astype(np.float64)
    ranges[:, np.isinf(ranges).any(axis=0)] = 0.0
    gradient = (ranges[::2] - ranges[1::2]) / (2 * step)
    # Beams that cross an edge within the step tell a jump; the bound has none.
    gradient[:, ~(np.abs(gradient) < 20.0).all(axis=0)] = 0.0
    variance = 0.03**2 + 0.001**2 / 12 + env.map_std**2
    information = gradient @ gradient.T / variance + np.diag([1 / 0.25**2] * 2 + [1 / 0.05**2])
    bound = math.sqrt(float(np.linalg.eigvalsh(np.linalg.inv(information)[:2, :2]).max()))
    assert float(amap.dataset["fisher"][row, column]) == pytest.approx(bound, rel=0.1)


# -- what 3D shows -----------------------------------------------------------------------------


def corridor() -> tuple[Environment, Environment]:
    """A bare corridor, and the same with beams under its ceiling and a shelf at 1.5 m."""
    plan = scenes.room(20.0, 2.0)
    walls, heights = plan.segments.xy, np.tile((0.0, 2.6), (len(plan.segments), 1))
    solids = [Solid(shapely.box(k, 0, k + 0.2, 2), 2.3, 2.6) for k in (7.3, 9.8, 12.2)]
    solids.append(Solid(shapely.box(9.0, 1.7, 10.1, 2.0), 1.4, 1.5))
    beams = Prisms(walls, heights, solids=solids, floor=0.0, ceiling=2.6)
    return tall(plan, 2.6), plan.in_space(beams)


def test_beams_and_a_shelf_resolve_what_the_planar_laser_cannot() -> None:
    bare, built = corridor()
    upward = RangeScanner.layered(SENSOR, 60, np.radians(np.arange(-20, 61, 10)), z=0.5)
    planar = RangeScanner.planar(SENSOR, 60, math.tau, z=0.5)
    options: dict[str, Any] = {"spacing": 0.2, "max_beams": 240}
    found = {
        (name, kind): np.nanmean(level(env, scanner, **options)[:, 40:60])
        for name, env in (("bare", bare), ("built", built))
        for kind, scanner in (("planar", planar), ("upward", upward))
    }
    assert found["bare", "planar"] == pytest.approx(found["built", "planar"], abs=1e-6)
    # The corridor effect: along it nothing tells where the robot is.
    assert found["bare", "planar"] > 0.45 and found["bare", "upward"] > 0.4
    assert found["built", "upward"] < 0.6 * found["built", "planar"]


def test_reflectors_in_space_are_read() -> None:
    plan = scenes.room(6.0, 4.0)
    kind = np.array([REFLECTOR, 0, 0, 0], dtype=np.uint8)
    marked = Environment(Segments(plan.segments.xy, kind), plan.free)
    from dataclasses import replace

    sensor = replace(SENSOR, intensity=Intensity(wall=0.3, reflector=1.0, std=0.1))
    scanner = RangeScanner.planar(sensor, 24, math.tau, z=0.5)
    assert tall(marked).has_reflectors and not tall(plan).has_reflectors
    flat, solid = level(marked, scanner, spacing=0.4), level(tall(marked), scanner, spacing=0.4)
    assert np.nanmax(np.abs(flat - solid)) < 1e-3


# -- where a robot can stand -------------------------------------------------------------------


def test_sensors_stand_in_nothing_solid() -> None:
    prisms, mesh = furnished()
    x, y = np.array([1.0, 3.0, 3.0, 1.85]), np.array([2.5, 1.5, 2.5, 1.5])
    ahead = RangeScanner.planar(SENSOR, 12, math.tau, (0.3, 0.0, 0.0))
    for env in (prisms, mesh):
        # Under the table; the last with its sensor alone.
        assert can_stand(env, ahead.raised(0.4), x, y, 0.0).tolist() == [True] * 4
        # Its mast would stand in the table, at any height above.
        assert can_stand(env, ahead.raised(1.0), x, y, 0.0).tolist() == [True, False, True, True]
        # In the table top, which parts the sensor from the robot as well.
        assert can_stand(env, ahead.raised(0.72), x, y, 0.0).tolist() == [True, False, True, False]


# -- sizes -------------------------------------------------------------------------------------


def test_evidence_and_beams_of_layers() -> None:
    assert independent_tau(LASER) == pytest.approx(4.0)
    # 30 degrees hold 1.25 pieces of 24.
    assert independent_tau(LIDAR) == pytest.approx(LIDAR.beams / (15 * 1.25))
    assert thin(LASER).beams == 60
    assert thin(RangeScanner.from_preset("velodyne-vlp-16")).beams == 360


def test_turns_of_layers_map_beams_onto_their_layer() -> None:
    small = RangeScanner.layered(SENSOR, 12, [0.1, -0.2], z=0.3)
    found = turns(small).astype(int)
    for k in range(12):
        turned = small.mounts[:, 2] + math.tau * k / 12
        apart = np.angle(np.exp(1j * (turned - small.mounts[found[k], 2])))
        assert np.abs(apart).max() < 1e-9
        assert (small.upright[found[k]] == small.upright).all()


# -- what is refused ---------------------------------------------------------------------------


def test_building_and_scanner_that_do_not_go_together() -> None:
    plan = scenes.room(6.0, 4.0)
    for ask in (lambda: LIDAR.scan(plan, 1.0, 1.0, 0.0), lambda: build_map(plan, LIDAR)):
        with pytest.raises(InputError, match=r"it is a plan, and the scanner looks up and down.*"
                           r"-15 degrees.*--extrude"):  # fmt: skip
            ask()
    low = LASER.raised(-0.4)
    for ask in (lambda: low.scan(tall(plan), 1.0, 1.0, 0.0), lambda: build_map(tall(plan), low)):
        with pytest.raises(InputError, match=r"at z = 0 m, on its floor.*scanner\.raised"):
            ask()


@pytest.mark.parametrize("in_mesh", [False, True])
def test_a_turned_building_tells_a_turned_robot_the_same(in_mesh: bool) -> None:
    env, angle, shift = furnished()[in_mesh], 0.7, (3.0, -20.0)
    turned = env.transformed(angle, *shift)
    x, y, theta = np.random.default_rng(3).uniform((0.3, 0.3, -3), (5.7, 2.6, 3), (200, 3)).T
    c, s = math.cos(angle), math.sin(angle)
    there = c * x - s * y + shift[0], s * x + c * y + shift[1], theta + angle
    one, other = LIDAR.scan(env, x, y, theta), LIDAR.scan(turned, *there)
    met = np.isfinite(one)
    assert (met == np.isfinite(other)).mean() > 0.999
    # A ray may pass an edge on the other side, by rounding.
    assert np.quantile(np.abs(one[met] - np.where(met, other, 9.0)[met]), 0.999) < 1e-4
    found, wanted = (np.nanmean(level(part, LIDAR, spacing=0.1)) for part in (turned, env))
    assert found == pytest.approx(wanted, abs=0.01)


def test_what_is_known_of_plans_alone() -> None:
    plan = scenes.room(6.0, 4.0)
    env = tall(plan)
    with pytest.raises(InputError, match="wall_normals: the building is in space"):
        build_map(env, LASER, layers="wall_normals")
    with pytest.raises(InputError, match="it is a plan, and the scanner looks up"):
        MonteCarloLocalizer(plan, LIDAR, rng=np.random.default_rng(0))


@pytest.mark.parametrize("which", ["prisms", "mesh", "extruded"])
def test_a_stored_map_keeps_its_building(which: str, tmp_path: Path) -> None:
    prisms, mesh = furnished()
    env = {"prisms": prisms, "mesh": mesh, "extruded": tall(scenes.room(6.0, 4.0))}[which]
    env = env.in_space(env.space, 0.05)
    build_map(env, LASER, spacing=0.5, store=False).save(tmp_path / "room.zarr")
    kept = AmbiguityMap.open(tmp_path / "room.zarr").environment
    assert kept.floor == 0.05
    assert kept.space is not None and env.space is not None
    assert kept.space.checksum == env.space.checksum
    poses = np.random.default_rng(1).uniform((0.3, 0.3, -3), (5.7, 3.7, 3), (100, 3)).T
    assert np.array_equal(LIDAR.scan(kept, *poses), LIDAR.scan(env, *poses), equal_nan=True)
    assert repr(kept.space) == repr(env.space)


def test_a_map_without_its_building_does_not_pass_for_a_plan() -> None:
    """Of a building in space of another class, or cut off."""
    env = tall(scenes.room(6.0, 4.0))
    data = build_map(env, LASER, spacing=0.5, store=False).dataset
    amap = AmbiguityMap(data.drop_vars("space"), source="room.zarr")
    assert amap.environment.is_free(1.0, 1.0)
    with pytest.raises(InputError, match=r"room\.zarr.*the floor alone"):
        LASER.scan(amap.environment, 1.0, 1.0, 0.0)
    with pytest.raises(InputError, match=r"room\.zarr.*the floor alone"):
        ExtendedKalmanFilter(amap.environment, LASER)
    with pytest.raises(InputError, match=r"room\.zarr.*the floor alone"):
        amap.update(env.edited([Obstacle.post(2.0, 2.0, 0.1)]))
    with pytest.raises(InputError, match=r"room\.zarr.*the floor alone"):
        amap.environment.edited([Obstacle.post(2.0, 2.0, 0.1)])
    whole = data["space"].values
    odd = whole.copy()
    odd[len(odd) // 3] ^= 255
    for part in (whole[: len(whole) // 2], whole[:0], odd, np.arange(9, dtype=np.uint8)):
        broken = data.drop_vars("space").assign(space=("space_byte", part))
        with pytest.raises(InputError, match=r"space, the building in space, cannot be read"):
            AmbiguityMap(broken, source="room.zarr").environment  # noqa: B018


def test_stored_maps_are_told_apart_by_what_stands_in_space() -> None:
    bare, built = corridor()
    keys = {
        map_key(env, s.scanner, s.thinned, s.model, 0.2, None, ())
        for env in (bare, built, bare.plan, bare.in_space(extruded(bare, 2.6)))
        for s in [MapSettings.of(env, LASER)]
    }
    assert None not in keys and len(keys) == 3


@pytest.mark.parametrize("in_mesh", [False, True])
def test_layers_that_work_in_space(in_mesh: bool) -> None:
    env = furnished()[in_mesh]
    amap = build_map(env, LIDAR, spacing=0.5, max_beams=84, layers="all", store=False)
    assert {"position", "coastal_entropy", "clearance", "fisher"} <= set(amap.layers)
    assert ("perturbation" in amap.layers) != in_mesh
    assert ("localizability" in amap.layers) != in_mesh
    assert not {"gfm", "wall_normals"} & set(amap.layers)
    assert (amap.dataset["unknown"].values[amap.dataset["free"].values] < BLIND).all()
