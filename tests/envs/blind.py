"""Recorded drives, and the observation over again by a simulation that has no truth."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ambinav.drive.noise import propagate_covariance
from ambinav_envs.simulation.layout import RUNNING
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.simulation.step import LOCALIZE

Floats = NDArray[np.float64]

# All that a replay starts from: the task, the number of the step, and the first estimate.
GIVEN = ("goal", "slot", "steps", "mean", "covariance")


class Recording(NamedTuple):
    """T steps of N robots; rows of robots whose episode has ended are not `driving`.

    Attributes:
        parts: Observation after each step, by part, shape (T, N, K).
        before: True pose before the step, after any kidnapping, shape (T, N, 3).
        truth: True pose after it.
        odometry: Odometry pose from before the first step on, shape (T + 1, N, 3).
        ground: Speed and turn rate over the floor, shape (T, N, 2).
        error: Distance of the estimate from the truth, metres, shape (T, N).
        slipping: Whether the wheels slip in the step, shape (T, N).
        driving: Whether the step is one of an episode without a collision, shape (T, N).
    """

    parts: dict[str, NDArray[np.float32]]
    before: Floats
    truth: Floats
    odometry: Floats
    ground: Floats
    error: Floats
    slipping: NDArray[np.bool_]
    driving: NDArray[np.bool_]


def loops(count: int, columns: int, steps: int, seed: int) -> Floats:
    """Draw actions that drive loops of about a metre, whatever is seen, and never declare."""
    rng = np.random.default_rng(seed)
    actions = np.full((steps, count, columns), -1.0)
    # Each level holds for 4 steps, and every step jitters.
    speed = np.repeat(rng.uniform(-1.0, 1.0, (steps // 4 + 1, count)), 4, axis=0)[:steps]
    turn = np.repeat(rng.uniform(0.1, 0.9, (steps // 4 + 1, count)), 4, axis=0)[:steps]
    actions[..., 0] = speed + rng.uniform(-0.3, 0.3, speed.shape)
    actions[..., 1] = rng.choice((-1.0, 1.0), count) * (turn + rng.uniform(-0.1, 0.1, turn.shape))
    return actions


def simulation_of(name: str, count: int, **options: Any) -> Simulation:
    envs = gym.make_vec(name, num_envs=count, **options)
    simulation: Simulation = envs.unwrapped.simulation  # type: ignore[attr-defined]
    return simulation


def begin(simulation: Simulation, out: Any, seed: int) -> None:
    rows = range(simulation.count)
    simulation.reset(rows, [np.random.default_rng((seed, i)) for i in rows], None, out)


class BlindSimulation:
    """The robots of another simulation, from odometry, wheels' speeds and readings alone.

    Whatever else a robot's record holds is nan or 0, and so are people and boxes.
    """

    def __init__(self, seen: Simulation, seed: int) -> None:
        self.simulation = Simulation(seen.source, seen.parameters, seen.count)
        self.out = self.simulation.outcome()
        begin(self.simulation, self.out, seed)
        state = self.simulation.state
        given = {name: state[name].copy() for name in GIVEN}
        self.odometry = state["odometry"].copy()
        for field in state.dtype.names or ():
            state[field] = math.nan if state[field].dtype.kind == "f" else 0
        for field, values in given.items():
            state[field] = values
        self.simulation.people[:] = self.simulation.boxes[:] = math.nan

    def follow(self, odometry: Floats, speeds: Floats, readings: Floats) -> None:
        """Localize and observe after a step."""
        simulation = self.simulation
        state, parameters, count = simulation.state, simulation.parameters, simulation.count
        state["odometry"], state["speeds"] = odometry, speeds
        state["steps"] += 1
        simulation.readings[:] = readings
        filters = simulation._filters
        if filters is None:
            noise = parameters.odometry.packed
            for i in range(count):
                robot = state["mean"][i], state["covariance"][i]
                propagate_covariance(*robot, *self.odometry[i], *odometry[i], noise)
            simulation._advance(np.arange(count), LOCALIZE, self.out)
        else:
            for i, site in enumerate(simulation.sites):
                assert site is not None and site.particles is not None
                filters.update(np.array([i]), state, simulation.readings, site.particles)
        self.odometry = odometry.copy()
        late = simulation._memory.late
        if late.shape[1] > 0:
            slot = int(state["steps"][0]) % late.shape[1]
            late["mean"][:, slot] = state["mean"]
            late["covariance"][:, slot] = state["covariance"]
        simulation.observe(self.out)


def record(simulation: Simulation, steps: int, seed: int, replay: bool = False) -> Recording:
    """Drive loops; with `replay` assert on the way that the observation needs no truth."""
    out, state, p = simulation.outcome(), simulation.state, simulation.parameters
    begin(simulation, out, seed)
    blind = BlindSimulation(simulation, seed) if replay else None
    active = np.ones(simulation.count, dtype=np.bool_)
    odometry, rows, parts = [state["odometry"].copy()], [], []
    for action in loops(simulation.count, p.columns, steps, seed):
        simulation.step(action, active, out)
        if blind is not None:
            blind.follow(state["odometry"], state["speeds"], simulation.readings)
            for name, values in out.observation.items():
                same = blind.out.observation[name][active]
                np.testing.assert_array_equal(values[active], same, err_msg=name)
        active &= state["outcome"] == RUNNING
        off = np.hypot(*(state["before"] - np.pad(state["slippery"], ((0, 0), (0, 1))))[:, :2].T)
        slips = (p.slip > 0.0) & (off <= p.slip_radius)
        error = np.hypot(*(state["mean"] - state["truth"])[:, :2].T)
        moved = state["before"].copy(), state["truth"].copy(), state["ground"].copy()
        rows.append((*moved, error, slips, active.copy()))
        odometry.append(state["odometry"].copy())
        parts.append({name: values.copy() for name, values in out.observation.items()})
    before, truth, ground, errors, slipping, driving = map(np.array, zip(*rows, strict=True))
    stacked = {name: np.array([part[name] for part in parts]) for name in parts[0]}
    return Recording(stacked, before, truth, np.array(odometry), ground, errors, slipping, driving)
