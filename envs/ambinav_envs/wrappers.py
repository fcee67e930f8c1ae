"""Wrappers: references to those of Gymnasium, and those that it lacks.

| wanted | single environment (`gymnasium.wrappers`) | batched |
|---|---|---|
| discrete actions | the argument `discrete=True` | the same |
| only some of the observation | `FilterObservation(env, GOAL_ONLY)` | `Filtered`, below |
| one flat row | `FlattenObservation(env)` | `Flat`, below |
| the last n observations | `FrameStackObservation(env, n)` | `FrameStack`, below |
| return and length of episodes | `RecordEpisodeStatistics(env)` | the same of \
`gymnasium.wrappers.vector` |
| a film (extra `video`) | `RecordVideo(env, folder)` | the same there |

Gymnasium's batched `FilterObservation` and `FlattenObservation` give the same, but go from robot to
robot and refuse the autoreset mode "SameStep", which `ambinav_envs.sb3.NavigationVecEnv` needs.
`VecFrameStack` and `VecNormalize` of Stable-Baselines3 work on that one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ambinav.config import as_count, nearest
from ambinav.runtime.array_types import Bools, Floats32
from ambinav.runtime.errors import InputError

GOAL_ONLY: Final = ("goal", "velocity")
"""Parts for a robot that sees only the goal, relative to its estimated pose."""

Observation = dict[str, Floats32]


class _Mapped(VectorWrapper[Any, Any, Any, Any, Any], ABC):
    """Maps every observation, the final ones of episodes included."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._single = numeric_parts(env)
        self.single_observation_space = self._space(self._single)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of every robot, or of those in `options["reset_mask"]`."""
        seen, info = self.env.reset(seed=seed, options=options)
        return self._map(seen), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Drive on for one time step."""
        seen, rewards, terminated, truncated, info = self.env.step(actions)
        if "final_obs" in info:
            final = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(info["_final_obs"]):
                final[i] = self._map(info["final_obs"][i])
            info["final_obs"] = final
        return self._map(seen), rewards, terminated, truncated, info

    @abstractmethod
    def _space(self, single: spaces.Dict) -> spaces.Space[Any]:
        """Return the mapped space of one robot."""

    @abstractmethod
    def _map(self, seen: Observation) -> Any:
        """Map an observation, of one robot or of all."""


class Filtered(_Mapped):
    """Keeps some parts of the observation, for batched environments.

    Args:
        env: A vector environment with an observation of parts by name.
        keys: Which.

    Raises:
        InputError: there are no keys, the observation has no such part, or no parts of numbers.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], keys: Iterable[str] = GOAL_ONLY) -> None:
        self._keys = tuple(keys)
        super().__init__(env)

    def _space(self, single: spaces.Dict) -> spaces.Space[Any]:
        if not self._keys:
            raise InputError(f"keys is empty; give some of {', '.join(single.spaces)}.")
        for key in self._keys:
            if key not in single.spaces:
                raise InputError(
                    f"keys: the observation has no part {key!r}; {nearest(key, single.spaces)}."
                )
        return spaces.Dict({key: single[key] for key in self._keys})

    def _map(self, seen: Observation) -> Observation:
        return {key: seen[key] for key in self._keys}


class Flat(_Mapped):
    """Flattens the observation of each robot to shape (N, size), for batched environments.

    The parts come in the order of the observation space.

    Args:
        env: A vector environment with an observation of parts by name.

    Raises:
        InputError: the observation has no parts of numbers.
    """

    def _space(self, single: spaces.Dict) -> spaces.Space[Any]:
        return spaces.flatten_space(single)

    def _map(self, seen: Observation) -> Floats32:
        parts = [(seen[name], len(part.shape or ())) for name, part in self._single.items()]
        rows = [part.reshape(*part.shape[: part.ndim - axes], -1) for part, axes in parts]
        return np.concatenate(rows, axis=-1)


class FrameStack(VectorWrapper[Any, Any, Any, Any, Any]):
    """Stacks the latest observations of each robot, the newest last.

    A part of shape (N, size) becomes (N, frames, size), as `FrameStackObservation` makes it for one
    environment: an episode begins with its first observation in every place.

    Args:
        env: A vector environment with an observation of parts by name.
        frames: Number of frames.

    Raises:
        InputError: `frames` is no count, or the observation has no parts of numbers.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], frames: int) -> None:
        super().__init__(env)
        self._frames = as_count(frames, "frames")
        single = numeric_parts(env)
        self.single_observation_space = batch_space(single, self._frames)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._stack: Observation = {}
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode of every robot, or of those in `options["reset_mask"]`."""
        seen, info = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        begun = everyone if mask is None or not self._stack else np.asarray(mask, dtype=np.bool_)
        self._fill(seen, begun)
        self._ended = self._ended & ~begun
        return self._copy(), info

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """Drive on for one time step."""
        seen, rewards, terminated, truncated, info = self.env.step(actions)
        done = terminated | truncated
        same_step = self.metadata.get("autoreset_mode") is AutoresetMode.SAME_STEP
        begun = done if same_step else self._ended
        if same_step and "final_obs" in info:
            info["final_obs"] = self._final(info["final_obs"])
        for part in self._stack.values():
            part[:, :-1] = part[:, 1:]
        for name, part in seen.items():
            self._stack[name][:, -1] = part
        self._fill(seen, begun)
        self._ended = np.zeros_like(done) if same_step else done.copy()
        return self._copy(), rewards, terminated, truncated, info

    def _fill(self, seen: Observation, begun: Bools) -> None:
        """Fill the stack with a first observation."""
        for name, part in seen.items():
            if name not in self._stack:
                self._stack[name] = np.zeros((len(part), self._frames, *part.shape[1:]), part.dtype)
            self._stack[name][begun] = part[begun][:, None]

    def _final(self, final: NDArray[Any]) -> NDArray[Any]:
        """Return the final observations with their predecessors."""
        stacked = np.full(len(final), None, dtype=object)
        for i, last in enumerate(final):
            if last is not None:
                stacked[i] = {
                    name: np.concatenate([self._stack[name][i, 1:], part[None]])
                    for name, part in last.items()
                }
        return stacked

    def _copy(self) -> Observation:
        return {name: part.copy() for name, part in self._stack.items()}


def check_same_step(envs: VectorEnv[Any, Any, Any]) -> None:
    """Check that an episode that ends is followed by the next in the same step.

    Raises:
        InputError: the autoreset mode is another.
    """
    mode = envs.metadata.get("autoreset_mode")
    if mode is not AutoresetMode.SAME_STEP:
        raise InputError(
            f"autoreset_mode is {getattr(mode, 'value', mode)!r}; give environments with "
            f"{AutoresetMode.SAME_STEP.value!r}."
        )


def numeric_parts(env: VectorEnv[Any, Any, Any]) -> spaces.Dict:
    """Return one robot's observation space, checked to have numeric parts."""
    single = env.single_observation_space
    if not isinstance(single, spaces.Dict) or not all(
        isinstance(part, spaces.Box) for part in single.values()
    ):
        raise InputError(
            f"the observation is a {type(single).__name__}; give environments with a Dict of Box."
        )
    return single
