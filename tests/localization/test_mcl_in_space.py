"""What Monte Carlo localization takes from a scanner in space: beams, settings, tables, fields."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.geometry.segments import REFLECTOR, Segments
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.filter_state import filter_model, filter_tables
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.localization.range_table import looked_up, range_table
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing import Intensity
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.geometry.furnished import furnished
from tests.localization import worlds

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

SENSOR = RangeSensor(max_range=8.0, std=0.02, resolution=0.001)
LIDAR = RangeScanner.layered(SENSOR, 36, [-0.3, -0.1, 0.0, 0.2], z=0.9)
MIXED = RangeScanner.mixed(
    LIDAR, RangeScanner.planar(SENSOR, 18, math.tau, z=0.3), worlds.sonar_ring().raised(0.3)
)


def tall(plan: Environment) -> Environment:
    return plan.in_space(extruded(plan, 2.5))


@pytest.mark.parametrize("name", ["velodyne-vlp-16", "ouster-os1-32", "livox-mid-360"])
def test_sixty_beams_are_spread_over_layers_and_directions(name: str) -> None:
    scanner = RangeScanner.from_preset(name)
    env = tall(worlds.room())
    beam = filter_model(env, scanner, MclParameters.for_scanner(scanner), None).beam
    yaw = np.sort(np.mod(scanner.mounts[beam, 2], math.tau))
    gaps = np.diff(yaw, append=yaw[0] + math.tau)
    assert len(beam) <= 62 and math.degrees(gaps.max()) < 20.0
    elevation = scanner.upright[:, 1]
    assert np.ptp(elevation[beam]) > 0.75 * np.ptp(elevation)
    if name != "livox-mid-360":
        # Of every layer about as many.
        counts = np.unique(np.round(elevation[beam], 6), return_counts=True)[1]
        assert len(counts) == len(np.unique(np.round(elevation, 6))) and np.ptp(counts) <= 1


def test_what_looks_up_and_down_takes_the_ray_model() -> None:
    assert MclParameters.for_scanner(LIDAR).laser_model_type == "beam_prob"
    assert MclParameters.for_scanner(LIDAR).beam_table_resolution == 0.0
    level = RangeScanner.planar(SENSOR, 36, math.tau, z=0.5)
    assert MclParameters.for_scanner(level) == MclParameters()
    asked = MclParameters.for_scanner(LIDAR, laser_model_type="likelihood_field")
    with pytest.warns(InputWarning, match="end on floors, ceilings and furniture"):
        MonteCarloLocalizer(tall(worlds.room()), LIDAR, asked, rng=np.random.default_rng(0))
    with pytest.raises(InputError, match="it is a plan, and the scanner looks up"):
        MonteCarloLocalizer(worlds.room(), LIDAR, rng=np.random.default_rng(0))


def test_ends_of_beams_lie_below_and_above_the_plan() -> None:
    """A beam that rises ends nearer to the robot, seen from above."""
    model = filter_model(tall(worlds.room()), LIDAR, MclParameters(), None)
    length = np.hypot(model.mount[:, 2], model.mount[:, 3])
    assert np.allclose(length, np.cos(LIDAR.upright[model.beam, 1]))


@pytest.mark.slow(kept=("False",))
@pytest.mark.parametrize("in_mesh", [False, True])
def test_a_table_holds_what_a_scanner_reads_at_its_points(in_mesh: bool) -> None:
    env = furnished()[in_mesh]
    beams = np.arange(MIXED.beams)
    table = range_table(env, MIXED, beams, 0.5)
    # Four layers, one of them of the lower laser too, and a sonar.
    assert len(table.ranges) == 6
    rows, columns = np.nonzero(table.cells >= 0)
    ranges = np.empty(len(beams))
    # They look along the table's directions; the sensors of a ring stand off its points.
    lasers = LIDAR.beams + 18
    for row, column in list(zip(rows, columns, strict=True))[::7]:
        x, y = table.x + column / table.inverse, table.y + row / table.inverse
        looked_up(x, y, 0.0, table, ranges)
        expected = MIXED.scan(env, x, y, 0.0)
        assert np.allclose(ranges[:lasers], expected[:lasers], atol=1e-4, equal_nan=True)


@pytest.mark.sweep
def test_reflectors_are_surfaces_of_the_building() -> None:
    plan = worlds.box(6.0, 4.0)
    kind = np.array([REFLECTOR, 0, 0, 0], dtype=np.uint8)
    plan = Environment(Segments(plan.segments.xy, kind), plan.free, name="room")
    scanner = worlds.laser(12).raised(0.4).with_intensity(Intensity(30.0, 220.0, 20.0))
    rays = MclParameters(laser_model_type="beam_prob")
    shares = []
    for env in (plan, tall(plan)):
        localizer = MonteCarloLocalizer(env, scanner, rays, rng=np.random.default_rng(1))
        assert localizer.channel is not None and localizer.reads_intensities
        shares.append(localizer.channel.reflects.mean())
        localizer.start([3.0, 2.0, 0.0], np.diag([1e-4, 1e-4, 1e-4]))
        localizer.update(
            [0.0, 0.0, 0.0],
            scanner.scan(env, 3.0, 2.0, 0.0),
            np.where(np.sin(scanner.mounts[:, 2]) < 0.0, 220.0, 30.0),
        )
        assert np.hypot(*(localizer.mean[0, :2] - (3.0, 2.0))) < 0.05
    assert shares == [0.25, 1.0 / 6.0]
    # The Kalman filter takes bearings of those that the plan shows.
    assert ExtendedKalmanFilter(tall(plan), scanner).reads_intensities
    lamp = Solid(shapely.box(2, 1, 3, 2), 2.0, 2.2, REFLECTOR)
    lit = worlds.box(6.0, 4.0).in_space(Prisms(solids=[lamp], floor=0.0))
    assert not ExtendedKalmanFilter(lit, scanner).reads_intensities


def test_where_ranges_are_looked_up_no_ray_is_cast() -> None:
    mesh = furnished()[1]
    table = MclParameters.for_scanner(LIDAR, beam_table_resolution=0.5)
    model = filter_model(mesh, LIDAR, table, None)
    cast = filter_tables(mesh, LIDAR, model)
    assert cast is not None and cast.beam.size == 0
    field = filter_model(mesh, LIDAR.thinned(1).raised(0.1), MclParameters(), None)
    assert filter_tables(mesh, LIDAR.thinned(1).raised(0.1), field) is None
    trusting = MclParameters.for_scanner(
        LIDAR, beam_table_resolution=0.5, localizability_weighting=1.0
    )
    with pytest.raises(InputError, match="it is a mesh"):
        MonteCarloLocalizer(mesh, LIDAR, trusting, rng=np.random.default_rng(0))
