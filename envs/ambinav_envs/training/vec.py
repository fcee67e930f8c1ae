"""The training environments, wrapped for Stable-Baselines3."""

from __future__ import annotations

from typing import Any, Final

from gymnasium.vector import SyncVectorEnv
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

from ambinav_envs.registered import simulation_of
from ambinav_envs.sb3 import NavigationVecEnv, make_sb3
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.training.config import Training
from ambinav_envs.training.corrected import CorrectedVecEnv

REPORTED: Final = ("outcome", "was_lost", "exposure", "travelled", "shortest")
"""Entries of the info at an episode's end beside return and length."""


class TrainingEnvs:
    """Environments, a monitor around them, and the normalisation if there is one.

    Args:
        config: Configuration of the training.
        state: Result of `state`, to continue from there; None: the configuration's seed.

    Attributes:
        monitor: Tells the figures of episodes that end.
        normalize: Normalisation of observations and rewards; None where neither is normalised.
    """

    def __init__(self, config: Training, state: dict[str, Any] | None = None) -> None:
        if state is None:
            arguments = {**config.environment}
            name = arguments.pop("id")
            envs = make_sb3(name, config.envs, seed=config.seed, **arguments)
        else:
            envs = NavigationVecEnv(state["envs"])
        self._envs = envs
        self._corrected: CorrectedVecEnv | None = None
        if config.base is not None:
            before = None if state is None else state["corrected"]
            parameters = self.simulation.parameters
            self._corrected = CorrectedVecEnv(envs, config.base, parameters, before)
        inner = envs if self._corrected is None else self._corrected
        self.monitor = VecMonitor(inner, info_keywords=REPORTED)
        self.normalize: VecNormalize | None = None
        norm = config.normalize
        if norm.observations or norm.reward:
            gamma = config.hyperparameters["gamma"]
            self.normalize = VecNormalize(
                self.monitor, norm_obs=norm.observations, norm_reward=norm.reward, gamma=gamma
            )
        if state is not None:
            self.monitor.episode_returns, self.monitor.episode_lengths = state["episodes"]
            if self.normalize is not None:
                vars(self.normalize).update(state["moments"])

    @property
    def outer(self) -> VecEnv:
        """Outermost environment, which the algorithm uses."""
        return self.monitor if self.normalize is None else self.normalize

    @property
    def simulations(self) -> tuple[Simulation, ...]:
        """The simulation behind the environments; of wrapped ones that of each."""
        inner: Any = self._envs.envs.unwrapped
        if isinstance(inner, SyncVectorEnv):
            return tuple(map(simulation_of, inner.envs))
        return (inner.simulation,)

    @property
    def simulation(self) -> Simulation:
        """The first of them."""
        return self.simulations[0]

    def state(self) -> dict[str, Any]:
        """Return all state of the next step; pickle it before that step."""
        monitor, moments = self.monitor, {}
        if self.normalize is not None:
            names = ("ret_rms", "returns", *(("obs_rms",) if self.normalize.norm_obs else ()))
            moments = {name: getattr(self.normalize, name) for name in names}
        return {
            "envs": self._envs.envs,
            "episodes": (monitor.episode_returns, monitor.episode_lengths),
            "moments": moments,
            "corrected": None if self._corrected is None else self._corrected.state(),
        }

    def close(self) -> None:
        """Close the environments."""
        self.outer.close()
