"""Reward terms, observation parts and ends that plug-ins compute after the step's kernel.

Our own are compiled into the step. Those of plug-ins are functions over the arrays of all robots
at once, called once a step: a few microseconds each, and nothing where there are none.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats, Floats32
from ambinav_envs.observations import OBSERVATIONS
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.rewards import REWARD_TERMS
from ambinav_envs.robot_states import Seen, Stepped
from ambinav_envs.simulation.layout import REWARD
from ambinav_envs.task_functions import TaskFunctions

Rows = NDArray[np.int64]


class Plugged(NamedTuple):
    """Additions of plug-ins to an outcome of N robots.

    Attributes:
        terms: Terms of the reward as they are, by name, shape (N,).
        weighted: The same times their weights.
        parts: Parts of the observation, by name, float32, shape (N, K).
    """

    terms: dict[str, Floats]
    weighted: dict[str, Floats]
    parts: dict[str, Floats32]


class PluggedFunctions:
    """The functions of plug-ins that the parameters of an environment request.

    Raises:
        InputError: the size of a part is of no use.
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        parts = []
        for part in parameters.plugged_parts:
            calling = OBSERVATIONS.calling(part.name)
            with calling:
                parts.append((part, part.size(parameters), calling))
        self._parts = tuple(parts)
        terms = parameters.plugged_terms
        self._terms = tuple((*pair, REWARD_TERMS.calling(pair[0].name)) for pair in terms)
        self._dt = parameters.dt
        self.task = TaskFunctions(parameters)

    def arrays(self, count: int) -> Plugged:
        """Allocate the output arrays of a step."""
        terms = {term.name: np.zeros(count) for term, _, _ in self._terms}
        parts = {part.name: np.zeros((count, size), np.float32) for part, size, _ in self._parts}
        return Plugged(terms, {name: np.zeros(count) for name in terms}, parts)

    def after_step(
        self,
        state: NDArray[np.void],
        estimates: Callable[[], tuple[Floats, Floats]],
        readings: Floats,
        rows: Rows,
        figures: Floats,
        out: Plugged,
    ) -> None:
        """Judge robots by their task, add the terms to their reward, and write their parts.

        Args:
            state: `layout.STATE` of all robots, shape (N,).
            estimates: See `Simulation.seen`.
            readings: Readings of all robots, shape (N, beams).
            rows: Which robots have stepped.
            figures: See `layout.COLUMNS`; what they get is added to the reward.
            out: Their rows are written.

        Raises:
            InputError: a function fails, or gives an array of another shape than it should.
        """
        if not (self._terms or self._parts or self.task.judges):
            return
        moved = state[rows]
        seen = _as_seen(moved, estimates, readings, rows)
        stepped = Stepped(
            seen=seen,
            before=moved["before"],
            truth=moved["truth"],
            driven=moved["driven"],
            distance=moved["distance"],
            collided=moved["collided"],
            lost=moved["lost"],
            dt=self._dt,
        )
        if self.task.judges:
            self.task.judge(state, rows, stepped, figures)
        for term, weight, calling in self._terms:
            assert term.function is not None
            with calling:
                values = _shaped(term.function(stepped), (len(rows),), term.name)
            out.terms[term.name][rows] = values
            out.weighted[term.name][rows] = weight * values
            figures[rows, REWARD] += weight * values
        self._show(seen, rows, out)

    def after_reset(
        self,
        state: NDArray[np.void],
        estimates: Callable[[], tuple[Floats, Floats]],
        readings: Floats,
        rows: Rows,
        out: Plugged,
    ) -> None:
        """Write the parts of some robots; their terms are 0. See `after_step`."""
        for values in (*out.terms.values(), *out.weighted.values()):
            values[rows] = 0.0
        if self._parts:
            self._show(_as_seen(state[rows], estimates, readings, rows), rows, out)

    def _show(self, seen: Seen, rows: Rows, out: Plugged) -> None:
        for part, size, calling in self._parts:
            assert part.function is not None
            with calling:
                values = _shaped(part.function(seen), (len(rows), size), part.name)
            out.parts[part.name][rows] = values


def _as_seen(
    moved: NDArray[np.void],
    estimates: Callable[[], tuple[Floats, Floats]],
    readings: Floats,
    rows: Rows,
) -> Seen:
    mean, covariance = estimates()
    return Seen(
        estimate=mean[rows],
        covariance=covariance[rows],
        speeds=moved["speeds"],
        goal=moved["goal"],
        readings=readings[rows],
    )


def _shaped(values: object, shape: tuple[int, ...], name: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"plug-in {name!r} gave an array of the shape {array.shape}, not {shape}")
    return array
