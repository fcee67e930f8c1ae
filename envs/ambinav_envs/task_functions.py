"""The functions of a task: where its episodes begin and end, and how they are judged."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.localization.random import uniform
from ambinav.runtime.array_types import Floats, Ints, UInts
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.tasks import Task
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.registration import TASKS
from ambinav_envs.robot_states import EpisodeEnd, Stepped
from ambinav_envs.simulation.layout import (
    ARRIVED,
    MISSED,
    OUTCOMES,
    REWARD,
    RUNNING,
    TERMS,
    TIMEOUT,
    VALUES,
    WEIGHTED,
)
from ambinav_envs.simulation.site import Site
from ambinav_envs.task_spec import DrawContext, Ends

_TERMS_OF_ENDS = (("arrival", ARRIVED, 1.0), ("missed", MISSED, -1.0))
"""Terms of the reward that an end decides: name, end, value."""


class TaskFunctions:
    """The functions of the task that an environment has, or those of all tasks.

    Attributes:
        judges: Whether the task has a rule of its own for the ends of episodes.
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        self._shortest, self._weights = parameters.shortest, parameters.weights
        self._name = parameters.task or ""
        spec = None if parameters.task is None else TASKS.get(parameters.task)
        self._draw = None if spec is None else spec.draw
        self._judge = None if spec is None else spec.judge
        self.judges = self._judge is not None

    def draw(self, site: Site, state: UInts, longest: float, start: Any, goal: Any) -> Task:
        """Draw an episode's start and goal where they are not given.

        Args:
            site: The building.
            state: State of the random numbers, uint64, shape (4,); advanced in place.
            longest: Greatest length of the path between the two, metres.
            start: x, y, theta, or None.
            goal: x, y, or None.

        Raises:
            InputError: there are none, or the task's function gives what cannot be used.
        """
        shortest = self._shortest
        if start is not None or goal is not None:
            return site.goals.between(state, shortest, longest, start, goal)
        if self._draw is None:
            return site.goals.draw(state, shortest, longest)
        ends = self._ends(site, state, longest)
        try:
            return site.goals.between(state, shortest, longest, *ends)
        except InputError as error:
            raise InputError(f"task {self._name!r}: {error}") from error

    def _ends(self, site: Site, state: UInts, longest: float) -> Ends:
        """Return start and goal by the task's function."""
        rng = np.random.default_rng(state.tolist())
        # Another draw for this episode, as for a door that can be closed, has other numbers.
        uniform(state)
        checker = site.lattice.checker
        context = DrawContext(
            site.building.environment,
            rng,
            lambda x, y: checker.why_not(float(x), float(y)) is None,
            self._shortest,
            longest,
        )
        assert self._draw is not None
        with TASKS.calling(self._name):
            start, goal = self._draw(context)
        return start, goal

    def judge(self, state: NDArray[np.void], rows: Ints, stepped: Stepped, figures: Floats) -> None:
        """Decide by the task's function which episodes have ended, and correct their rewards.

        Args:
            state: `layout.STATE` of all robots; the outcome is written.
            rows: Which robots have stepped.
            stepped: Their state.
            figures: See `layout.COLUMNS`; of all robots.

        Raises:
            InputError: it fails, or gives what cannot be used.
        """
        assert self._judge is not None
        before = state["outcome"][rows]
        with TASKS.calling(self._name):
            after = _ends_of(self._judge(stepped, before.copy()), before)
        state["outcome"][rows] = after
        for name, end, value in _TERMS_OF_ENDS:
            column = TERMS.index(name)
            weight = self._weights[column]
            change = value * ((after == end).astype(float) - (before == end))
            figures[rows, VALUES + column] += change
            figures[rows, WEIGHTED + column] += weight * change
            figures[rows, REWARD] += weight * change


def _ends_of(values: object, before: Ints) -> Ints:
    """Return the ends that a task gives, checked; without one the episode's time is over as ever.

    Raises:
        ValueError: they are no numbers of `EpisodeEnd`, or not one a robot.
    """
    ends = np.asarray(values)
    if ends.shape != before.shape or ends.dtype.kind not in "iu":
        raise ValueError(
            f"judge gave an array of {ends.dtype} of the shape {ends.shape}, not integers of the "
            f"shape {before.shape}"
        )
    if len(ends) and not 0 <= ends.min() <= ends.max() < len(OUTCOMES):
        raise ValueError(
            f"judge gave {ends.min()} to {ends.max()}, not numbers of EpisodeEnd, "
            f"{min(EpisodeEnd)} to {max(EpisodeEnd)}"
        )
    return np.where((ends == RUNNING) & (before == TIMEOUT), TIMEOUT, ends).astype(np.int64)
