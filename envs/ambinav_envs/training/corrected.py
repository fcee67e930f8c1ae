"""Environments whose actions are corrections of a reactive baseline."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import (
    VecEnv,
    VecEnvObs,
    VecEnvStepReturn,
    VecEnvWrapper,
)

from ambinav.runtime.array_types import Floats32
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.corrected import CORRECTION, HOLD, MOTION, Corrector, with_motion


class CorrectedVecEnv(VecEnvWrapper):
    """Robots driven by a baseline, with corrections as actions, see `policies.corrected`.

    A step is `HOLD` time steps, or those until the episode ends. An episode that begins in the
    middle of one is driven without a correction until the next, and without a reward.

    Args:
        envs: The environments of the robots.
        base: One of `policies.corrected.BASES`.
        parameters: Parameters of the environments.
        state: Result of `state`, to continue from there.

    Raises:
        InputError: the baseline does not fit the environments.
    """

    def __init__(
        self,
        envs: VecEnv,
        base: str,
        parameters: NavigationParameters,
        state: tuple[Any, ...] | None = None,
    ) -> None:
        self._corrector = Corrector(base)
        self._corrector.configure(parameters)
        self._corrector.prepare(envs.observation_space, envs.action_space)
        super().__init__(envs, with_motion(envs.observation_space), CORRECTION)
        self._seen: dict[str, Floats32] = {}
        self._starts = np.ones(envs.num_envs, dtype=np.bool_)
        self._corrections = np.zeros((envs.num_envs, 2))
        if state is not None:
            self._seen, self._starts, inner = state
            self._corrector.restore(inner)

    def state(self) -> tuple[Any, ...]:
        """Return all state of the next step except the environments', for pickling."""
        return self._seen, self._starts, self._corrector.state()

    def reset(self) -> VecEnvObs:
        """See `VecEnv`."""
        self._starts = np.ones(self.num_envs, dtype=np.bool_)
        return self._observed(self.venv.reset())

    def step_async(self, actions: NDArray[Any]) -> None:
        """Set the corrections of the next step, shape (N, 2)."""
        self._corrections = np.array(actions, dtype=np.float64)

    def step_wait(self) -> VecEnvStepReturn:
        """See `VecEnv`."""
        rewards = np.zeros(self.num_envs, np.float32)
        ended = np.zeros(self.num_envs, dtype=np.bool_)
        full_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for _ in range(HOLD):
            chosen = np.where(ended[:, None], 0.0, self._corrections)
            before = self._seen[MOTION]
            self.venv.step_async(self._corrector.steer(self._seen, self._starts, chosen))
            observations, reward, dones, infos = self.venv.step_wait()
            rewards += np.where(ended, 0.0, reward)
            for i in np.flatnonzero(~ended):
                full_infos[i] = infos[i]
            for i in np.flatnonzero(dones & ~ended):
                # The motion of the previous step: it has hardly changed since then.
                full_infos[i]["terminal_observation"][MOTION] = before[i]
            self._starts = dones.copy()
            seen = self._observed(observations)
            ended |= dones
        return seen, rewards, ended, full_infos

    def _observed(self, observations: Any) -> VecEnvObs:
        copies = {name: part.copy() for name, part in observations.items()}
        self._seen = dict(self._corrector.see(copies, self._starts))
        return dict(self._seen)
