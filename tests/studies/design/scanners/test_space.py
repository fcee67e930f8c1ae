"""Planar and 3D scanners in one table: a corridor that only its ceiling tells apart."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.cli.design_scanners import ComparedSpaceOptions, _without_third_dimension
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.localization.information import scan_information
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.design.scanners.compare import ScannerTable, compare_scanners
from ambinav.studies.design.scanners.mounting import mounted
from ambinav.studies.design.scanners.route_figures import ErrorModel, expected_errors

SENSOR = RangeSensor(max_range=4.0, std=0.02, resolution=0.001)
PLANAR = RangeScanner.planar(SENSOR, 60, 2 * math.pi, name="planar")
LAYERS = RangeScanner.layered(
    SENSOR,
    60,
    [math.radians(one) for one in (0.0, 20.0, 28.0, 36.0, 44.0, 52.0)],
    z=0.5,
    name="layers",
)
ROUTE = Route.through([(5.0, 1.2), (15.0, 1.2)])


@pytest.fixture(scope="module")
def corridor() -> Environment:
    """20 x 2 m, 2.5 m high, with beams of 0.3 m below its ceiling at uneven distances."""
    plan = environment_from_shapes([shapely.box(0, 0, 20, 2)], name="corridor")
    solid = extruded(plan, 2.5)
    beams = [Solid(shapely.box(x, 0, x + 0.25, 2), 2.2, 2.5) for x in (4.0, 6.3, 9.4, 11.5, 14.6)]
    prisms = Prisms(
        solid.walls.xy, solid.wall_z, solid.walls.kind, solids=beams, floor=0.0, ceiling=2.5,
        free=plan.free,
    )  # fmt: skip
    return plan.in_space(prisms)


@pytest.fixture(scope="module")
def table(corridor: Environment) -> ScannerTable:
    return compare_scanners(
        corridor, [PLANAR, LAYERS], spacing=0.4, routes=[("route.csv", ROUTE)], store=False
    )


def test_beams_below_the_ceiling_tell_layers_what_the_plane_does_not_have(
    table: ScannerTable,
) -> None:
    assert [row.name for row in table.rows] == ["layers", "planar"]
    layers, planar = table.rows
    assert planar.bad_area > 15.0
    assert layers.bad_area < 0.5 * planar.bad_area
    assert layers.routes is not None and planar.routes is not None
    assert layers.routes.mean_error < 0.5 * planar.routes.mean_error
    assert table.remarks[0] == (
        "Mounted 0.3 m above the floor, because their files give no height: planar."
    )


def test_a_planar_laser_has_the_figures_of_the_plan(
    corridor: Environment, table: ScannerTable
) -> None:
    flat = compare_scanners(
        corridor.plan, [PLANAR], spacing=0.4, routes=[("route.csv", ROUTE)], store=False
    )
    (plan,), space = flat.rows, table.rows[1]
    assert space.bad_area == pytest.approx(plan.bad_area, abs=0.17)  # a cell
    assert plan.routes is not None and space.routes is not None
    assert space.routes.mean_error == pytest.approx(plan.routes.mean_error, rel=1e-3)
    assert flat.remarks == ()


def test_information_is_that_of_the_plane(corridor: Environment) -> None:
    rng = np.random.default_rng(4)
    poses = rng.uniform((0.5, 0.4, -3.0), (19.5, 1.6, 3.0), (40, 3))
    known = scan_information(corridor.plan, PLANAR, poses, 0.02)
    found = scan_information(corridor, PLANAR.raised(0.3), poses, 0.02)
    assert np.abs(found - known).max() < 2e-3 * np.abs(known).max()


def test_a_higher_beam_tells_where_along_the_corridor(corridor: Environment) -> None:
    """One ray ahead and up by 45 degrees onto a beam's side: sigma by cosine, and no more."""
    one = RangeScanner.layered(SENSOR, 1, [math.pi / 4], z=0.5, name="one")
    # 1.8 m from the beam at 9.4 m it meets the side of that at z = 2.3.
    (found,) = scan_information(corridor, one, np.array([[7.6, 1.0, 0.0]]), 0.0)
    variance = 0.02**2 + 0.001**2 / 12
    assert found[0, 0] == pytest.approx(2.0 / variance, rel=1e-4)
    assert found[1, 1] == pytest.approx(0.0, abs=1e-6 * found[0, 0])


def test_errors_along_a_turning_route(corridor: Environment) -> None:
    route = Route.through([(5.0, 1.0), (9.0, 1.4), (15.0, 0.8)])
    model = ErrorModel(beams=60)
    plan, _ = expected_errors(corridor.plan, PLANAR, route, model)
    space, _ = expected_errors(corridor, PLANAR.raised(0.3), route, model)
    assert space == pytest.approx(plan, rel=5e-3)


def test_mounting() -> None:
    assert mounted(LAYERS, 0.3) is LAYERS
    assert mounted(PLANAR, 0.3).upright[:, 0].tolist() == [0.3] * 60
    with pytest.raises(InputError, match="height is 0"):
        mounted(PLANAR, 0.0)
    options = ComparedSpaceOptions(scanner_height=0.8)
    carrier = options.carrier([PLANAR, replace(LAYERS, robot_radius=0.4)])
    assert carrier.upright[:, 0].max() == 0.8
    assert carrier.robot_radius == 0.4


def test_of_all_presets_a_plan_gets_the_level_ones(capsys: pytest.CaptureFixture[str]) -> None:
    names = ["livox-mid-360", "rplidar-a1", "velodyne-vlp-16"]
    every = [RangeScanner.load(name) for name in names]
    kept = _without_third_dimension(every, ["velodyne-vlp-16"])
    assert [one.name for one in kept] == ["rplidar-a1", "velodyne-vlp-16"]
    said = " ".join(capsys.readouterr().err.split())
    assert "livox-mid-360 look up and down and are left out of a plan; --extrude M" in said
