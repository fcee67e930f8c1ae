"""What a cone's echo tells of the pose, and what localizers make of rings of cones."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ambinav.buildings.load import load_environment
from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.casting import cast_tables
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.information import beam_lines, beam_noise, line_space
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import ALPHAS, LASER_MODELS, MclParameters
from ambinav.localization.scanner_settings import FIELDS
from ambinav.map_building.build import build_map
from ambinav.routes.evaluate import evaluate_route
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.service.service import AmbiguityService
from tests.localization import worlds
from tests.localization.test_ekf import run_filter

ROOT = Path(__file__).parents[2]
RING = RangeScanner.from_preset("polaroid-6500-ring")

# A room of 12 x 3 m under a passage from x = 4 to x = 6 m, whose end is out of range.
DOORWAY = (
    (0.0, 0.0), (12.0, 0.0), (12.0, 3.0), (6.0, 3.0), (6.0, 20.0), (4.0, 20.0), (4.0, 3.0),
    (0.0, 3.0),
)  # fmt: skip


def one_cone(axis: float, x: float = 0.0) -> RangeScanner:
    sensor = RangeSensor(
        max_range=4.0, std=0.02, resolution=0.001, aperture=math.radians(30.0),
        max_incidence=math.radians(25.0), random_share=0.0,
    )  # fmt: skip
    return RangeScanner.planar(sensor, 1, 0.0, (x, 0.0, axis))


def lines_of(env: Environment, scanner: RangeScanner, pose: np.ndarray) -> np.ndarray:
    """Mean reading of each beam, its derivatives by the pose, and its variance, (B, 5)."""
    cast = cast_tables(env, scanner, np.arange(scanner.beams))
    noise = beam_noise(env, scanner, 0.0)
    work, ranges, ray, edge, line = line_space(scanner.beams, len(cast.cosine))
    beam_lines(*pose, cast, noise, work, ranges, ray, edge, line)
    return np.asarray(line)


def test_the_end_of_a_wall_within_a_cone_tells_its_distance_alone() -> None:
    # The wall over the robot ends at (4, 3), 21.8 degrees from straight up, where the cone looks:
    # what is nearest of it is its end, however the robot turns.
    env, pose = worlds.walls(DOORWAY), np.array([4.6, 1.5, 0.0])
    away = np.array([-0.6, 1.5]) / math.hypot(0.6, 1.5)
    (line,) = lines_of(env, one_cone(math.radians(100.0)), pose)
    # Rays are 2 degrees apart.
    assert line[0] == pytest.approx(math.hypot(0.6, 1.5), abs=0.03)
    assert np.allclose(line[1:3], -away, atol=0.04)
    assert line[3] == pytest.approx(0.0, abs=1e-12)
    # Ahead of the robot's centre the sensor moves sideways as the robot turns.
    (line,) = lines_of(env, one_cone(math.radians(100.0), 0.2), pose - (0.2, 0.0, 0.0))
    assert line[3] == pytest.approx(-0.2 * away[1], abs=0.02)


def test_the_edge_of_a_cone_tells_the_heading_as_a_ray_does() -> None:
    # The normal of the wall is 20 degrees off the axis: the nearest echo is of the cone's edge,
    # 5 degrees off the normal.
    env, pose = worlds.box(12.0, 3.0), np.array([6.0, 1.0, 0.0])
    (line,) = lines_of(env, one_cone(math.radians(110.0)), pose)
    b = math.radians(5.0)
    assert line[0] == pytest.approx(2.0 / math.cos(b))
    assert np.allclose(line[1:4], (0.0, -1.0 / math.cos(b), 2.0 * math.tan(b) / math.cos(b)))


def cones_slowly(scanner: RangeScanner, pose: np.ndarray) -> np.ndarray:
    """Nearest echo of each beam in the L-shaped room, by rays 0.05 degrees apart, (B,)."""
    corner = np.array(worlds.L_ROOM)
    side = np.roll(corner, -1, axis=0) - corner
    out = np.empty(scanner.beams)
    for b, (mx, my, yaw) in enumerate(scanner.mounts):
        sensor = scanner.sensors[scanner.sensor_of_beam[b]]
        half = sensor.aperture / 2
        angle = pose[2] + yaw + np.linspace(-half, half, 601)
        u = np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, np.newaxis]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        to = corner - (pose[0] + c * mx - s * my, pose[1] + s * mx + c * my)
        with np.errstate(divide="ignore", invalid="ignore"):
            under = u[..., 0] * side[:, 1] - u[..., 1] * side[:, 0]
            d = (to[:, 0] * side[:, 1] - to[:, 1] * side[:, 0]) / under
            along = (to[:, 0] * u[..., 1] - to[:, 1] * u[..., 0]) / under
        d[~((d > 0.0) & (along >= 0.0) & (along <= 1.0))] = math.inf
        first = d.argmin(axis=1)
        rows = np.arange(len(angle))
        facing = np.abs(under[rows, first]) / np.hypot(*side[first].T)
        echo = np.where(np.arccos(np.minimum(facing, 1.0)) <= sensor.max_incidence,
                        d[rows, first], math.inf)  # fmt: skip
        out[b] = echo.min()
    return out


@pytest.mark.slow
def test_derivatives_are_those_of_the_cone_itself() -> None:
    """Against differences over steps wider than the rays are apart, of rays much closer."""
    steps = np.array([0.02, 0.02, 0.03])
    errors, slopes = [], []
    for pose in worlds.free_poses(worlds.room(), 40, seed=8, clearance=0.4):
        line = lines_of(worlds.room(), RING, pose)
        here = cones_slowly(RING, pose)
        for k in range(3):
            step = steps * np.eye(3)[k]
            ahead, back = cones_slowly(RING, pose + step), cones_slowly(RING, pose - step)
            with np.errstate(invalid="ignore"):
                slope = (ahead - back) / (2.0 * steps[k])
                # Where the nearest echo jumps to another wall there is no derivative.
                smooth = np.isfinite(line[:, 4]) & (np.abs(ahead - 2.0 * here + back) < 0.01)
            errors.append(line[smooth, 1 + k] - slope[smooth])
            slopes.append(slope[smooth])
    error, slope = np.concatenate(errors), np.concatenate(slopes)
    assert len(slope) > 600 and np.sqrt(np.mean(slope**2)) > 0.3
    assert np.mean(np.abs(error) < 0.1) > 0.99
    assert np.sqrt(np.mean(error**2)) < 0.05


@pytest.mark.slow
def test_the_kalman_filter_keeps_to_a_ring_and_knows_how_well() -> None:
    errors, covariances = run_filter(30, 80, seed=5, scanner=RING)
    nees = np.einsum("rsi,rsij,rsj->rs", errors, np.linalg.inv(covariances), errors)
    far = np.hypot(errors[..., 0], errors[..., 1])
    assert far.max() < 0.1
    assert 2.7 < nees.mean() < 3.6
    assert np.mean(nees < stats.chi2.ppf(0.95, 3)) > 0.91


@pytest.mark.slow
def test_the_kalman_filter_passes_doorways_with_a_ring() -> None:
    """Along walls whose pieces end at doors; with the walls' own normals it lost its heading."""
    env = load_environment(ROOT / "configs" / "demo.geojson")
    service = AmbiguityService(build_map(env, RING, spacing=0.4))
    points = [(6.0, 20.6, 0.0), (8.0, 21.85, 0.0), (26.0, 19.91, 0.0)]
    route = evaluate_route(service, points, Steering("r2"), planner="drawn")
    noise = OdometryNoise()
    alphas = {key: getattr(noise, key) * noise.scale**2 for key in ALPHAS if key != "alpha5"}
    ekf = ExtendedKalmanFilter(env, RING, OdometryModel(**alphas), runs=12)
    rng = np.random.default_rng(2)
    runs = drive_route(
        env, RING, Robot(0.21), route, ekf, rng, 12, noise=noise, open_loop=True, rate=5.0
    )
    figures = metrics(runs)
    assert not figures.lost.any()
    assert figures.position_max.max() < 0.12 and figures.heading_max.max() < 0.15


def test_what_suits_a_scanner() -> None:
    for scanner in (RING, worlds.mixed(), RangeScanner.from_preset("pioneer-sonar-laser")):
        found = MclParameters.for_scanner(scanner)
        assert found == MclParameters(
            laser_model_type="beam_prob", importance_factor=0.3, sigma_hit=0.1, z_hit=0.7,
            z_max=0.2, z_short=0.05, z_rand=0.05, beam_table_resolution=0.1,
        )  # fmt: skip
    assert MclParameters.for_scanner(worlds.laser()) == MclParameters()


@pytest.mark.slow
@given(
    st.dictionaries(st.sampled_from(("z_hit", "z_max", "sigma_hit", "importance_factor")),
                    st.floats(0.01, 1.0)),
    st.sampled_from((None, *LASER_MODELS)),
)  # fmt: skip
def test_what_is_given_stands(values: dict[str, Any], model: str | None) -> None:
    if model is not None:
        values = values | {"laser_model_type": model}
    found = MclParameters.for_scanner(RING, **values)
    assert {key: getattr(found, key) for key in values} == values
    if model in FIELDS:
        # Who chooses a field has AMCL's own.
        assert found == MclParameters(**values)


def test_unknown_parameters_are_refused() -> None:
    with pytest.raises(InputError, match="'sigma' is unknown; did you mean sigma_hit"):
        MclParameters.for_scanner(RING, sigma=0.1)


@pytest.mark.parametrize("model", LASER_MODELS)
@pytest.mark.parametrize("scanner", [worlds.laser(), worlds.mixed(), worlds.sonar_ring()])
def test_fields_are_warned_of_where_there_are_cones(scanner: RangeScanner, model: str) -> None:
    parameters = MclParameters(
        laser_model_type=model, min_particles=10, max_particles=20, likelihood_resolution=0.1
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        MonteCarloLocalizer(worlds.room(), scanner, parameters, rng=np.random.default_rng(1))
    cones = any(sensor.aperture > 0.0 for sensor in scanner.sensors)
    assert len(caught) == int(cones and model.startswith("likelihood_field"))
    for one in caught:
        assert one.category is InputWarning
        assert model in str(one.message) and "choose beam_prob" in str(one.message)


def test_without_parameters_the_localizer_takes_what_suits_the_scanner() -> None:
    rng = np.random.default_rng(1)
    ring = MonteCarloLocalizer(worlds.room(), worlds.sonar_ring(), rng=rng)
    assert ring.parameters == MclParameters.for_scanner(worlds.sonar_ring())
    laser = MonteCarloLocalizer(worlds.room(), worlds.laser(), rng=rng)
    assert laser.parameters == MclParameters()
