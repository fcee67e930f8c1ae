"""Policies that correct a reactive baseline: a network turns its target and limits its speed.

What a robot does is still decided by VFH+, which stops before walls. The network says where else
than at the waypoint it is to steer, and how fast it may drive. A correction of 0 is VFH+ at its
pace, see `reactive.pace`.
"""

from __future__ import annotations

import math
from typing import Any, Final, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bools, Floats
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import Policy
from ambinav_envs.policies.reactive.pace import Pace
from ambinav_envs.policies.reactive.policy import ReactivePolicy

BASES: Final = ("vfh",)
"""The baselines that can be corrected; the route is that of the environment."""
SWING: Final = math.radians(60.0)
"""The target is turned by up to this."""
MOTION: Final = "motion"
"""Part of the observation that the correction sees besides: mean speed and turn rate of late, and
the share of the episode's steps that is gone."""
LATE: Final = 3.0
"""Seconds over which motion is averaged, by which a network without memory notices it is stuck."""
HOLD: Final = 5
"""Time steps for which a correction holds: the effect of a single step is lost in the noise."""
CORRECTION: Final = spaces.Box(-1.0, 1.0, (2,), np.float32)
"""Turn of the target, positive to the left, by `SWING`; and what the pace is multiplied with, from
1 / `FASTER` at -1 to `FASTER` at 1."""
FASTER: Final = 4.0


def with_motion(observation_space: spaces.Space[Any]) -> spaces.Space[Any]:
    """Return the observation space of a correction: the environment's parts, and `MOTION`."""
    if not isinstance(observation_space, spaces.Dict):
        return observation_space
    motion = spaces.Box(-1.0, 1.0, (3,), np.float32)
    return spaces.Dict({**observation_space.spaces, MOTION: motion})


class Corrector:
    """A baseline for N robots whose target and speed are corrected from outside.

    Args:
        base: One of `BASES`.
    """

    def __init__(self, base: str) -> None:
        self.base = ReactivePolicy(base)
        self.configure(NavigationParameters())

    def configure(self, parameters: NavigationParameters) -> None:
        """See `Policy`."""
        self.base.configure(parameters)
        # Weight of one step in the running mean.
        self._share, self._pace = min(parameters.dt / LATE, 1.0), Pace(parameters)
        self._mean = np.zeros((0, 2), np.float32)

    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """See `Policy`; the spaces are those of the environment."""
        self.base.prepare(observation_space, action_space)
        self._mean = np.zeros((0, 2), np.float32)

    def see(self, observations: Observation, starts: Bools) -> Observation:
        """Return the observation for the next correction: the parts, and `MOTION`.

        Call it once a step.
        """
        self._pace.step(starts)
        velocity = np.clip(np.nan_to_num(observations["velocity"]), -1.0, 1.0)
        if len(self._mean) != len(velocity):
            self._mean = np.zeros((len(velocity), 2), np.float32)
        self._mean = self._mean + np.float32(self._share) * (velocity - self._mean)
        self._mean[starts] = 0.0
        motion = np.concatenate([self._mean, self._pace.gone[:, None]], axis=1)
        return {**observations, MOTION: motion}

    def steer(self, observations: Observation, starts: Bools, corrections: Floats) -> Floats:
        """Return the environment's actions, shape (N, columns), given corrections, shape (N, 2)."""
        chosen = np.clip(corrections.astype(np.float64), -1.0, 1.0)
        limit = np.minimum(self._pace.share(observations["goal"]) * FASTER ** chosen[:, 1], 1.0)
        return self.base.steer(observations, starts, SWING * chosen[:, 0], limit)

    def state(self) -> tuple[Any, ...]:
        """Return everything that the next step depends on, for pickling; `restore` takes it."""
        return (self._mean, self._pace, *self.base.state())

    def restore(self, state: tuple[Any, ...]) -> None:
        """Continue from a state."""
        self._mean, self._pace, *base_state = state
        self.base.restore(tuple(base_state))


class Network(Protocol):
    """A network that returns corrections: a `ModelPolicy`."""

    name: str
    environment: dict[str, Any]
    code: str | None

    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """See `Policy`."""

    def act(self, observations: Observation, starts: Bools) -> NDArray[Any]:
        """Return corrections, shape (N, 2)."""


class CorrectedPolicy(Policy):
    """A baseline corrected by a network, with a new correction every `HOLD` steps.

    Args:
        network: Gives the corrections; its environment is what the robots are to see.
        base: One of `BASES`.
    """

    def __init__(self, network: Network, base: str) -> None:
        super().__init__(network.name, network.environment, network.code)
        self.network = network
        self._corrector = Corrector(base)
        self._step = np.zeros(0, np.int64)
        self._action = np.zeros((0, 2))

    def configure(self, parameters: NavigationParameters) -> None:
        """See `Policy`."""
        self._corrector.configure(parameters)

    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """See `Policy`."""
        self._corrector.prepare(observation_space, action_space)
        self.network.prepare(with_motion(observation_space), CORRECTION)
        self._step = np.zeros(0, np.int64)

    def act(self, observations: Observation, starts: Bools) -> Floats:
        """See `Policy`."""
        seen = self._corrector.see(observations, starts)
        if len(self._step) != len(starts):
            self._step, self._action = np.zeros(len(starts), np.int64), np.zeros((len(starts), 2))
        self._step[starts] = 0
        due = self._step % HOLD == 0
        if due.any():
            self._action[due] = np.nan_to_num(self.network.act(seen, starts))[due]
        self._step += 1
        return self._corrector.steer(observations, starts, self._action)
