"""What a cone's echo tells of the pose, and what localizers make of rings of cones."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from ambinav.drive.noise import OdometryNoise
from ambinav.errors import InputError, InputWarning
from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables, cast_tables
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.information import beam_noise, line_space, scan_information
from ambinav.localization.information import beam_lines as beam_lines_kernel
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.localization.scanner_settings import CONE_PRODUCT, FIELDS
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.localization import worlds
from tests.localization.worlds import turned

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
    cast: CastTables = cast_tables(env, scanner, np.arange(scanner.beams))
    noise = beam_noise(env, scanner, 0.0)
    work, ranges, ray, edge, line = line_space(scanner.beams, len(cast.cosine))
    beam_lines_kernel(*pose, cast, noise, work, ranges, ray, edge, line)
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
    print(len(slope), np.sqrt(np.mean(slope**2)), np.mean(np.abs(error)<.1), np.sqrt(np.mean(error**2)), np.quantile(np.abs(error),[.5,.9,.95,.99]))
    assert len(slope) > 600 and np.sqrt(np.mean(slope**2)) > 0.3
    assert np.mean(np.abs(error) < 0.1) > 0.97
    assert np.sqrt(np.mean(error**2)) < 0.12
