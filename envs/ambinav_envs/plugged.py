"""Terms of the reward and parts of the observation that plug-ins compute after the step's kernel.

Our own are compiled into the step. Those of plug-ins are functions over the arrays of all robots
at once, called once a step: a few microseconds each, and nothing where there are none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav_envs.simulation.layout import REWARD

if TYPE_CHECKING:
    from ambinav_envs.parameters import NavigationParameters
    from ambinav_envs.simulation.simulation import Outcome, Simulation

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Seen(NamedTuple):
    """What n robots know of themselves; poses are x, y, theta in the map frame.

    Attributes:
        estimate: Where they believe they are, shape (n, 3), metres and radians.
        covariance: How sure they are, shape (n, 3, 3).
        speeds: Speed (m/s) and turn rate (rad/s), shape (n, 2).
        goal: x and y, metres, shape (n, 2).
        readings: Of the scanner, shape (n, beams), metres: inf no echo, -inf too near.
    """

    estimate: Floats
    covariance: Floats
    speeds: Floats
    goal: Floats
    readings: Floats


class Stepped(NamedTuple):
    """What a step has made of n robots, the truth included; poses as in `Seen`.

    Attributes:
        seen: What they know of themselves.
        before: True poses before the step, shape (n, 3).
        truth: True poses after it, shape (n, 3).
        driven: Metres of the step, shape (n,).
        distance: What the path to the goal costs from here, metres where `way_weight` is 0, shape
            (n,).
        collided: Whether they touched a wall or a box, shape (n,).
        lost: Whether they are lost, shape (n,).
        dt: Seconds of the step.
    """

    seen: Seen
    before: Floats
    truth: Floats
    driven: Floats
    distance: Floats
    collided: Bools
    lost: Bools
    dt: float


class Plugged(NamedTuple):
    """What plug-ins add to an outcome, of N robots.

    Attributes:
        terms: Terms of the reward as they are, by name, shape (N,).
        weighted: The same times their weights.
        parts: Parts of the observation, by name, float32, shape (N, K).
    """

    terms: dict[str, Floats]
    weighted: dict[str, Floats]
    parts: dict[str, NDArray[np.float32]]


class PluggedFunctions:
    """The functions of plug-ins that the parameters of an environment ask for.

    Args:
        parameters: Of the environment.

    Raises:
        InputError: a plug-in cannot be loaded.
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        self._terms = parameters.plugged_terms
        self._parts = parameters.plugged_parts
        self._sizes = {part.name: part.size(parameters) for part in self._parts}
        self._dt = parameters.dt

    def arrays(self, count: int) -> Plugged:
        """Arrays for a step to write to."""
        terms = {term.name: np.zeros(count) for term, _ in self._terms}
        weighted = {name: np.zeros(count) for name in terms}
        parts = {name: np.zeros((count, size), np.float32) for name, size in self._sizes.items()}
        return Plugged(terms, weighted, parts)

    def after_step(self, simulation: Simulation, rows: NDArray[np.int64], out: Outcome) -> None:
        """Add the terms of some robots to their reward, and show them their parts.

        Raises:
            ValueError: a function gives another shape than it should.
        """
        if not (self._terms or self._parts):
            return
        seen = _seen(simulation, rows)
        if self._terms:
            stepped = _stepped(simulation, rows, seen, self._dt)
            for term, weight in self._terms:
                values = _shaped(term.function(stepped), (len(rows),), term.name)
                out.plugged.terms[term.name][rows] = values
                out.plugged.weighted[term.name][rows] = weight * values
                out.figures[rows, REWARD] += weight * values
        self._show(seen, rows, out)

    def after_reset(self, simulation: Simulation, rows: NDArray[np.int64], out: Outcome) -> None:
        """Show some robots their parts; their terms are 0."""
        for values in (*out.plugged.terms.values(), *out.plugged.weighted.values()):
            values[rows] = 0.0
        if self._parts:
            self._show(_seen(simulation, rows), rows, out)

    def _show(self, seen: Seen, rows: NDArray[np.int64], out: Outcome) -> None:
        for part in self._parts:
            shape = (len(rows), self._sizes[part.name])
            out.plugged.parts[part.name][rows] = _shaped(part.function(seen), shape, part.name)


def _seen(simulation: Simulation, rows: NDArray[np.int64]) -> Seen:
    state = simulation.state[rows]
    return Seen(
        estimate=state["mean"],
        covariance=state["covariance"],
        speeds=state["speeds"],
        goal=state["goal"],
        readings=simulation.readings[rows],
    )


def _stepped(simulation: Simulation, rows: NDArray[np.int64], seen: Seen, dt: float) -> Stepped:
    state = simulation.state[rows]
    return Stepped(
        seen=seen,
        before=state["before"],
        truth=state["truth"],
        driven=state["way"],
        distance=state["distance"],
        collided=state["met"],
        lost=state["lost"],
        dt=dt,
    )


def _shaped(values: object, shape: tuple[int, ...], name: str) -> NDArray[np.generic]:
    found = np.asarray(values)
    if found.shape != shape:
        raise ValueError(f"plug-in {name!r} gave an array of the shape {found.shape}, not {shape}")
    return found
