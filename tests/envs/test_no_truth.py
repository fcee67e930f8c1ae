"""No part of an observation tells more of the true pose than odometry and the scan do.

Two facts show it together, for every id. The whole observation is a function of the map, the goal,
the first estimate, odometry, the wheels' speeds, the readings and the number of the step: a
simulation whose truth is nan makes the same bits of them. And odometry with the wheels' speeds,
whatever is computed from them, tells nothing of how the motion deviates from it. Twins with the
true pose are left out.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav_envs.observations import OBSERVATIONS
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.plugged import _as_seen
from ambinav_envs.registration import IDS
from ambinav_envs.simulation.simulation import Simulation
from tests.envs.blind import Recording, record, simulation_of

Floats = NDArray[np.float64]

WITHOUT_ID: dict[str, dict[str, Any]] = {
    "slippery": {"suite": "hall", "slip": 1.0, "slip_radius": 3.0, "shortest": 6.0},
    "no waypoint": {"suite": "procedural", "waypoint": False, "window_cells": 24},
}
# The last twin rooms have whatever the others have.
FEWER_FEATURES = tuple(f"ambinav/TwinRooms{k}-" for k in range(1, 5))
# Suites are buildings: offices and procedural ones stand for the others.
OTHER_SUITES = tuple(f"ambinav/{suite}-" for suite in ("Corridor", "Hall", "Loop", "Warehouse"))
# A twin without the map drives the same episodes and observes less.
WITHOUT_MAP = ("ambinav/Office-NoMap-v1", "ambinav/Kidnapped-NoMap-v1")


def marks_of(name: str) -> list[pytest.MarkDecorator]:
    """Return the marks of an id."""
    twin = "-NoMap-" in name and name not in WITHOUT_MAP
    fewer = name.startswith((*OTHER_SUITES, *FEWER_FEATURES))
    return [pytest.mark.sweep] if twin or fewer else []


NAMES = [
    *(pytest.param(name, marks=marks_of(name)) for name in IDS if "-TruePose-" not in name),
    *WITHOUT_ID,
]
# 64 robots for 60 steps leave at least 800 steps on either side: a useless regression explains less
# than this, and mostly less than nothing.
MOST_EXPLAINED = 0.02
# Few particles are quick, and what is tested does not depend on their number.
FEW = {"min_particles": 20, "max_particles": 40}


def options_of(name: str) -> dict[str, Any]:
    options: dict[str, Any] = {"buildings": 1, **WITHOUT_ID.get(name, {})}
    arguments = IDS.get(name, options)
    if "mcl" in arguments:
        options["mcl"] = arguments["mcl"] | FEW
    if "kidnapped" in arguments:
        options["kidnap_seconds"] = (1.0, 2.0)
    return options


def simulated(name: str, count: int, **more: Any) -> Simulation:
    id_ = name if name in IDS else "ambinav/Navigation-v1"
    return simulation_of(id_, count, **options_of(name) | more)


@cache
def driven(name: str, difficulty: int = 0) -> tuple[Recording, NavigationParameters]:
    more = {"difficulty": difficulty} if difficulty else {}
    simulation = simulated(name, 64, **more, window=False)
    return record(simulation, 60, seed=1), simulation.parameters


def motion(before: Floats, after: Floats) -> Floats:
    """Length (backwards negative) and turn of the arc between poses, shape (..., 2)."""
    dx, dy, turn = np.moveaxis(after - before, -1, 0)
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    middle = before[..., 2] + 0.5 * turn
    chord = dx * np.cos(middle) + dy * np.sin(middle)
    return np.stack([chord / np.sinc(turn / (2.0 * math.pi)), turn], axis=-1)


def motion_error(drive: Recording, slip: float) -> Floats:
    """What of each step odometry does not report: metres and radians, shape (T, N, 2).

    How much wheels slip on a slippery floor is known of the model.
    """
    reported = motion(drive.odometry[:-1], drive.odometry[1:])
    reported[..., 0] /= np.where(drive.slipping, 1.0 + slip, 1.0)
    return motion(drive.before, drive.truth) - reported


def explained(drive: Recording, part: Floats, slip: float, squares: bool = False) -> Floats:
    """Return the share of the motion error's variance that a ridge regression explains, (2,).

    It reads the odometry's motions and a part of the observation from 2 steps before to 2 steps
    after, is fitted on the even robots and judged on the odd ones.
    """
    reported = motion(drive.odometry[:-1], drive.odometry[1:])
    read = np.concatenate([reported, part], axis=-1)
    count = len(read)
    history = np.concatenate([read[k : count - 4 + k] for k in range(5)], axis=-1)
    target = motion_error(drive, slip)[2:-2]
    good = drive.driving[4:]
    sides = []
    for side in (0, 1):
        x, y = history[:, side::2][good[:, side::2]], target[:, side::2][good[:, side::2]]
        sides.append((x, y))
    (x, y), (other, judged) = sides
    assert min(len(x), len(other)) > 800, (len(x), len(other))
    mean, std = x.mean(axis=0), x.std(axis=0) + 1e-9
    columns, others = (x - mean) / std, (other - mean) / std
    if squares:
        pairs = np.triu_indices(columns.shape[1])
        columns, others = (
            np.concatenate([c, (c[:, pairs[0]] * c[:, pairs[1]])], axis=1)
            for c in (columns, others)
        )
    columns, others = (np.column_stack([np.ones(len(c)), c]) for c in (columns, others))
    penalty = (0.1 if not squares else 100.0) * np.eye(columns.shape[1])
    weights = np.linalg.solve(columns.T @ columns + penalty, columns.T @ y)
    left = ((judged - others @ weights) ** 2).sum(axis=0)
    return np.asarray(1.0 - left / (judged**2).sum(axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_observation_is_made_without_the_truth(name: str) -> None:
    """Bit for bit, where the truth is nan."""
    drive = record(simulated(name, 6), 40, seed=0, replay=True)
    assert set(drive.parts) <= set(OBSERVATIONS.names())
    assert drive.driving[10].sum() >= 3


@pytest.mark.parametrize(
    "difficulty",
    [pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow), 3],
)
def test_at_any_difficulty_too(difficulty: int) -> None:
    """With late estimates, sweeps, slip, gain, people, boxes and walls that are elsewhere."""
    for localizer in ("ekf", "mcl"):
        simulation = simulation_of(
            "ambinav/Procedural-v1", 6, buildings=1, difficulty=difficulty, localizer=localizer
        )
        assert simulation.parameters.late_steps > 0
        record(simulation, 40, seed=2, replay=True)
    drive, p = driven("ambinav/Procedural-v1", difficulty)
    velocity = drive.parts["velocity"].astype(float)
    assert (explained(drive, velocity, p.slip) < MOST_EXPLAINED).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_velocity_is_odometry_and_nothing_more(name: str) -> None:
    """Slip and kidnapping included."""
    drive, p = driven(name)
    robot = p.robot
    speed, rate = np.moveaxis(
        drive.parts["velocity"].astype(float) * (robot.max_speed, robot.max_turn_rate), -1, 0
    )
    # Chords of arcs, as complex numbers.
    heading = drive.odometry[0, :, 2] + np.cumsum(rate * p.dt, axis=0)
    chord = speed * p.dt * np.sinc(rate * p.dt / (2.0 * math.pi))
    moves = chord * np.exp(1j * (heading - 0.5 * rate * p.dt))
    place = drive.odometry[0, :, :2] @ (1.0, 1.0j) + np.cumsum(moves, axis=0)
    reported = drive.odometry[1:]
    assert np.abs(place - reported[..., :2] @ (1.0, 1.0j))[drive.driving].max() < 1e-5
    assert np.abs(np.exp(1j * (heading - reported[..., 2])) - 1.0)[drive.driving].max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_odometry_tells_nothing_of_the_motion_error(name: str) -> None:
    drive, p = driven(name)
    for part in ("velocity", "remaining"):
        values = drive.parts[part].astype(float)
        for squares in (False, True) if part == "velocity" else (False,):
            share = explained(drive, values, p.slip, squares)
            assert (share < MOST_EXPLAINED).all(), (part, squares, share)


@pytest.mark.slow
def test_the_regression_finds_a_leak() -> None:
    """The true ground speed, which the observation had before version 1."""
    drive, p = driven("ambinav/Office-v1")
    assert (explained(drive, drive.ground, p.slip) > 0.99).all()
    # It finds a tenth of the variance too, under noise of three times the deviation.
    error = motion_error(drive, p.slip)
    noise = np.random.default_rng(0).normal(
        scale=3.0 * error[drive.driving].std(axis=0), size=error.shape
    )
    share = explained(drive, error + noise, p.slip)
    assert share == pytest.approx((0.1, 0.1), abs=0.04)


def test_the_replay_finds_a_leak() -> None:
    """The true pose as the estimate, which is nan in the replay."""
    options = {"buildings": 1, "window": False, "waypoint": False}
    simulation = simulation_of("ambinav/Office-TruePose-v1", 2, **options)
    with pytest.raises(AssertionError, match="goal"):
        record(simulation, 2, seed=0, replay=True)


@pytest.mark.slow
def test_the_wheels_do_not_tell_of_a_kidnapping() -> None:
    """They turn on as commanded, as those of a robot that is not carried off."""
    drive, other = driven("ambinav/Kidnapped-v1")[0], driven("ambinav/Procedural-v1")[0]
    both = drive.driving & other.driving
    assert both[20:].sum() > 500
    assert (drive.parts["velocity"][both] == other.parts["velocity"][both]).all()


def test_plugins_see_the_speeds_of_the_wheels() -> None:
    simulation = simulated("slippery", 4)
    record(simulation, 5, seed=0)
    state = simulation.state
    seen = _as_seen(state, simulation.seen, simulation.readings, np.arange(4))
    assert (seen.speeds == state["speeds"]).all() and (seen.speeds != state["ground"]).all()
