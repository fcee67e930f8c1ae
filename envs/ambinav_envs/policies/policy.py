"""Policies, which drive a robot by its observations: their common interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ambinav.config import nearest
from ambinav.plugins import called
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import code_digest
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import ROW, Normalization, Observation
from ambinav_envs.policies.shapes import Plain, action_misfit, described, misfit
from ambinav_envs.spaces import continuous

Actions = NDArray[Any]

# Torch adds up in an order that depends on the number of rows where that is not a multiple of this:
# an action would depend on how many others are computed with it, by a last bit or two. Layers whose
# widths are no multiples of 4, or below 12, do so nonetheless, by where among the rows one stands.
ROWS = 8

SEEING: Final[tuple[str, ...]] = (
    "window", "window_cells", "window_spacing", "ambiguity_weight", "waypoint", "waypoint_distance",
    "ambiguity_seen", "discrete", "declare", "belief", "min_speed",
)  # fmt: skip
"""Arguments of an environment that say what a policy sees and how it acts."""
RULES: Final = ("declare", "belief")
"""Those of them by which an episode ends or is scored: where a policy drives elsewhere than it was
trained, they are those of the task."""
BUILDINGS: Final[tuple[str, ...]] = (
    "id", "suite", "map", "buildings", "first_building", "max_episode_steps",
)  # fmt: skip
"""Arguments beside the fields of `NavigationParameters`."""


def seen_in(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return the observations of a policy and its kind of actions in an environment.

    Args:
        environment: Its arguments; omitted ones have their defaults.

    Returns:
        `SEEING`, the layer, the scanner and the robot, all of them.

    Raises:
        InputError: one of them is of no use.
    """
    names = (*SEEING, "layer", "robot", "scanner")
    arguments = {name: environment[name] for name in names if name in environment}
    parameters = NavigationParameters.of(arguments)
    seen = {name: getattr(parameters, name) for name in SEEING}
    used = {"scanner": parameters.scanner, "robot": parameters.robot}
    return seen | used | {"layer": parameters.cost_layer}


def checked_actions(
    name: str | None,
    actions: object,
    count: int,
    parameters: NavigationParameters,
    active: Bools | None = None,
) -> Floats:
    """Convert actions with `spaces.continuous`; error messages name the policy.

    Raises:
        InputError: they are of no use.
    """
    try:
        return continuous(actions, count, parameters, active)
    except InputError as error:
        raise InputError(str(error) if name is None else f"policy {name}: {error}") from error


class Policy(ABC):
    """Computes actions of N robots from their observations.

    Args:
        name: Its name in reports.
        environment: Arguments of the environment that it was trained in, or wants.
        code: `ambinav.runtime.provenance.code_digest` of the code that trained it; None:
            irrelevant.

    Attributes:
        is_code: True if it was loaded by running its own code, which requires trust.
    """

    is_code = False

    def __init__(self, name: str, environment: dict[str, Any], code: str | None = None) -> None:
        self.name = name
        self.environment = environment
        self.code = code

    @property
    def other_code(self) -> str | None:
        """Text saying that other code trained it; None if it is the same, or does not matter."""
        ours = code_digest()
        if self.code is None or self.code == ours:
            return None
        return (
            f"was trained by other code than this (sources {self.code[:8]}; here {ours[:8]}), and "
            "may fare otherwise than it did then"
        )

    @property
    def seeing(self) -> dict[str, Any]:
        """Arguments of its environment that are among `SEEING`, without `RULES`.

        A task that hides the ambiguity map hides it from all: only a policy trained without it
        says so.
        """
        names = [name for name in SEEING if name in self.environment and name not in RULES]
        seen = {name: self.environment[name] for name in names}
        if seen.get("ambiguity_seen"):
            del seen["ambiguity_seen"]
        return seen

    def configure(self, parameters: NavigationParameters) -> None:  # noqa: B027
        """Set parameters that are not part of the spaces: scanner, robot, time step.

        Called before `prepare`.

        A trained policy has this information in its file, so by default nothing is done.
        """

    @abstractmethod
    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """Prepare for robots in an environment, and drop the memory of earlier ones.

        Raises:
            InputError: the policy does not fit; the message names the difference.
        """

    @abstractmethod
    def act(self, observations: Observation, starts: Bools) -> Actions:
        """Return the action of each robot.

        Args:
            observations: Parts by name, float32, shape (N, size); keep no reference, the next
                step may write there. Rows of robots without an episode contain previous or possible
                observations, and their actions are ignored.
            starts: Robots whose episode has just begun, bool, shape (N,).

        Returns:
            Shape (N, columns), or (N,) if actions are discrete.
        """


class ModelPolicy(Policy):
    """A model of Stable-Baselines3, deterministic; it keeps the state of a recurrent model.

    Args:
        model: Anything with its `predict`, `observation_space` and `action_space`.
        normalization: Normalisation of what it sees.
        name: Its name in reports.
        environment: See `Policy`.
        code: The same.
    """

    def __init__(
        self,
        model: Any,
        normalization: Normalization | None = None,
        *,
        name: str = "policy",
        environment: dict[str, Any] | None = None,
        code: str | None = None,
    ) -> None:
        super().__init__(name, environment or {}, code)
        self.model = model
        self.normalization = normalization
        self._model_space: Plain = described(model.observation_space)
        self._order: tuple[str, ...] = ()
        self._state: Any = None

    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """See `Policy`."""
        why = misfit(self._model_space, observation_space) or action_misfit(
            described(self.model.action_space), action_space
        )
        if why is not None:
            raise InputError(f"policy {self.name!r} does not fit the environment: {why}.")
        single = {ROW: observation_space}
        parts = observation_space.spaces if isinstance(observation_space, spaces.Dict) else single
        self._order = tuple(self._model_space.get("parts", parts))
        self._state = None

    def act(self, observations: Observation, starts: Bools) -> Actions:
        """See `Policy`."""
        seen = {name: observations[name] for name in self._order}
        if "parts" not in self._model_space:
            seen = {ROW: np.concatenate(list(seen.values()), axis=1)}
        if self.normalization is not None:
            seen = self.normalization(seen)
        count = len(starts)
        seen = {name: _padded(part) for name, part in seen.items()}
        model_input: Any = seen if "parts" in self._model_space else seen[ROW]
        with _one_thread():
            actions, self._state = self.model.predict(
                model_input, state=self._state, episode_start=_padded(starts), deterministic=True
            )
        return np.asarray(actions)[:count]


def _padded(rows: NDArray[Any]) -> NDArray[Any]:
    """Return an array with rows of zeros added, up to a multiple of `ROWS`."""
    missing = -len(rows) % ROWS
    if not missing:
        return rows
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]), rows.dtype)])


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit torch to one thread: for such small networks two are no faster.

    And where another program has the second core, they wait for each other, busily, for minutes.
    """
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class CallablePolicy(Policy):
    """A policy given as user code.

    Args:
        make: Called with the spaces of a single environment, gives something with `act`; it may
            say in an attribute `environment` what arguments it wants the environment made with.
        source: The value by which the user named it.

    Raises:
        InputError: that attribute is no mapping, or has an unknown key.
    """

    is_code = True

    def __init__(self, make: Callable[..., Any], source: str) -> None:
        environment = getattr(make, "environment", {})
        if not isinstance(environment, Mapping):
            raise InputError(
                f"policy {source}: its environment is a {type(environment).__name__}; give a "
                "mapping of arguments."
            )
        allowed = (*(item.name for item in fields(NavigationParameters)), *BUILDINGS)
        for key in environment:
            if key not in allowed:
                raise InputError(
                    f"policy {source}: its environment has the key {key!r}, which is unknown; "
                    f"{nearest(str(key), allowed)}."
                )
        super().__init__(source, dict(environment))
        self.make = make
        self._made: Any = None

    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """See `Policy`."""
        self._made = called(self.make, self.name, observation_space, action_space)
        if not callable(getattr(self._made, "act", None)):
            raise InputError(
                f"policy {self.name} gave a {type(self._made).__name__} without act(observations, "
                "starts); return something that has it."
            )

    def act(self, observations: Observation, starts: Bools) -> Actions:
        """Return the callable's actions unchecked, see `Policy`; `checked_actions` checks them."""
        actions: Actions = called(self._made.act, self.name, observations, starts)
        return actions
