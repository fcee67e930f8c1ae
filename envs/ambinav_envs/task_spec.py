"""The record of a task, and what its functions get."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.runtime.array_types import Ints
from ambinav.runtime.errors import InputError
from ambinav_envs.robot_states import Stepped

if TYPE_CHECKING:
    # It loads numba, which `import ambinav_envs` does without.
    from ambinav.geometry.environment import Environment

ID: Final = re.compile(r"[\w.-]+/[\w.-]+-v\d+")
"""Form of a task's name: namespace, name and version."""


class DrawContext(NamedTuple):
    """Argument of `TaskSpec.draw`.

    Attributes:
        environment: The building, in the map frame, metres.
        rng: Source of randomness of this episode.
        fits: Tells whether a robot's centre can be at x, y with room to spare.
        shortest: Least length of the shortest path from start to goal, metres.
        longest: Greatest length of it.
    """

    environment: Environment
    rng: np.random.Generator
    fits: Callable[[float, float], bool]
    shortest: float
    longest: float


Ends = tuple[ArrayLike | None, ArrayLike | None]
"""Start (x, y, theta) and goal (x, y); None: it is drawn as in every task."""


@dataclass(frozen=True, kw_only=True)
class TaskSpec:
    """An entry of the registry: an environment with its arguments, known by a Gymnasium id.

    Attributes:
        name: Its id, such as "ambinav/Hall-v1"; also the name of its entry point.
        about: What is asked of the robot, for readers.
        arguments: Arguments of `NavigationEnv`: `suite` or `map`, how many `buildings`, and any
            field of `NavigationParameters`. Who makes the environment may give others.
        draw: Start and goal of an episode; None: as `shortest` and `longest` say. It is not called
            where `reset` is given one of them.
        judge: The ends of n robots' episodes after a step, `EpisodeEnd` by number, shape (n,). It
            gets their state and the ends by the rules of all tasks, and returns these or others.
            Rewards for arriving and for missing the goal follow; None: these rules alone.

    Raises:
        InputError: the name is not an id with a namespace and a version.
    """

    name: str
    about: str
    arguments: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    draw: Callable[[DrawContext], Ends] | None = None
    judge: Callable[[Stepped, Ints], NDArray[np.integer[Any]]] | None = None

    def __post_init__(self) -> None:
        """Check the name."""
        if not ID.fullmatch(self.name):
            raise InputError(
                f"task {self.name!r}: the name is not an id; give namespace, name and version, "
                "such as mine/Doorway-v0."
            )
