"""For fine bins and small displacements, -log I is dp^T F dp / 4, F the Fisher information.

F is worked out apart from the kernel by Censi's formula (2007, "On achievable accuracy for range-
finder localization"): F = sum g g^T / sigma^2, g = [cos a / cos b, sin a / cos b, r tan b] with a
the direction of the surface's normal and b = a - the ray's direction.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.ambiguity import reference
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.pair import compare
from ambinav.ambiguity.returns import beam_returns
from ambinav.geometry.environment import Environment
from ambinav.sensing import RangeScanner
from tests.geometry import scenes

MAP_STD = 0.02
# Offsets within the cell are left out: the cell is next to nothing.
CELL = 1e-12
POSES = ((1.3, 1.1), (2.6, 2.2), (3.9, 0.9))
STEPS = (
    (0.002, 0.0, 0.0), (0.0, 0.002, 0.0), (0.0, 0.0, 0.001), (0.001, -0.0015, 0.0),
    (-0.001, 0.0005, 0.0007), (0.001, 0.001, -0.0005),
)  # fmt: skip


def fisher(env: Environment, x: float, y: float, variance: float) -> NDArray[np.float64]:
    """Information of 60 beams about x, y and theta, (3, 3)."""
    look = -math.pi + 2 * math.pi * np.arange(60) / 60
    r, hit = scenes.cast_slowly(env.segments.xy, np.full(60, x), np.full(60, y), look)
    wall = env.segments.xy[hit]
    a = np.arctan2(wall[:, 3] - wall[:, 1], wall[:, 2] - wall[:, 0]) + math.pi / 2
    b = a - look
    g = np.stack([np.cos(a) / np.cos(b), np.sin(a) / np.cos(b), r * np.tan(b)])[:, r < 4.0]
    return np.asarray(g @ g.T / variance)


@pytest.fixture(scope="module")
def room() -> Environment:
    # Turned, so that no beam comes near a corner.
    return scenes.room(5.0, 3.5).transformed(0.1)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("tau", [1.0, 4.0])
def test_kernel(
    room: Environment, laser: RangeScanner, pose: tuple[float, float],
    step: tuple[float, float, float], tau: float,
) -> None:  # fmt: skip
    table = BeamTable.of(laser, MAP_STD, 0.05)
    data = np.zeros((2, 5, len(table.limit)), dtype=np.float32)
    data[:, 4] = 1.0
    dp = np.array(step)
    for row, theta in enumerate((0.0, step[2])):
        x, y = np.array([pose[0] + row * step[0]]), np.array([pose[1] + row * step[1]])
        beam_returns(room, laser, table, x, y, theta, data[row : row + 1])
    alike, *_ = compare(
        data, 0, 1, table.limit, table.inverse_cap, table.use, None, tau, CELL, CELL
    )
    sensor = laser.sensors[0]
    variance = 0.03**2 + sensor.resolution**2 / 12 + MAP_STD**2
    expected = dp @ fisher(room, *pose, variance) @ dp / 4
    assert -math.log(alike) * tau == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("step", STEPS)
def test_reference(
    room: Environment, laser: RangeScanner, step: tuple[float, float, float]
) -> None:
    model = AmbiguityModel(radius=0.5, map_std=MAP_STD, tau=1.0)
    dp, (x, y) = np.array(step), POSES[1]
    here = reference.beams(room, laser, model, x, y, 0.0)
    there = reference.beams(room, laser, model, x + dp[0], y + dp[1], dp[2])
    limit, cap = np.full(60, 4.0), np.full(60, -math.log(0.06))
    alike, *_ = reference.compare(here, there, limit, cap, 1.0, np.eye(3) * CELL)
    variance = 0.03**2 + 0.001**2 / 12 + MAP_STD**2
    assert -math.log(alike) == pytest.approx(dp @ fisher(room, x, y, variance) @ dp / 4, rel=0.01)


def test_derivatives_are_those_of_the_ranges(room: Environment) -> None:
    """Finite differences of what is cast, for beams mounted off the centre."""
    sensor = RangeScanner.from_preset("hokuyo-urg-04lx").sensors[0]
    scanner = RangeScanner.planar(sensor, 24, 2 * math.pi, mount=(0.2, -0.1, 0.4))
    table = BeamTable.of(scanner, MAP_STD, 0.05)
    theta, h = 0.3, 1e-3
    pose = np.array([2.0, 1.7, theta])

    def cast(at: NDArray[np.float64]) -> NDArray[np.float64]:
        data = np.zeros((1, 5, len(table.limit)), dtype=np.float32)
        beam_returns(room, scanner, table, at[:1], at[1:2], float(at[2]), data)
        return data[0, :4, :24].astype(np.float64)

    gradient = cast(pose)[1:]
    for axis in range(3):
        e = np.eye(3)[axis] * h
        difference = (cast(pose + e)[0] - cast(pose - e)[0]) / (2 * h)
        # One beam may straddle a corner.
        assert np.sort(np.abs(difference - gradient[axis]))[-2] < 5e-3
