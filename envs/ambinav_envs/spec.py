"""The Gymnasium spec of an environment, with the limit of its episodes."""

from __future__ import annotations

import copy
from typing import Any

from gymnasium.envs.registration import EnvSpec

from ambinav_envs.simulation.simulation import Simulation


class SpecOfSimulation:
    """Puts `max_steps` into `spec.max_episode_steps`, where Gymnasium's wrappers look for it.

    The environment truncates by itself, and names the outcome. If its id had a limit, Gymnasium
    would truncate after that one whatever `max_steps` is given.
    """

    simulation: Simulation
    _spec: EnvSpec | None = None

    def _get_spec(self) -> EnvSpec | None:
        return self._spec

    def _set_spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy.copy(spec)
        if self._spec is not None:
            self._spec.max_episode_steps = self.simulation.parameters.max_steps

    # Gymnasium declares an attribute.
    spec: Any = property(_get_spec, _set_spec)
