"""A batched environment that writes into arrays of the caller, and steps while the caller works."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bools, Floats32
from ambinav.runtime.errors import InputError
from ambinav_envs.wrappers import check_same_step, numeric_parts

BUFFERS: Final = ("observations", "rewards", "terminals", "truncations")

Received = tuple[Floats32, Floats32, Bools, Bools, list[dict[str, Any]]]


class BufferedEnv:
    """N robots whose steps go into four arrays that stay the same, with no loop over the robots.

    The contract is that of PufferLib's native environments: `reset` and `step` write into the
    arrays and return them; an episode that has ended is followed by the next in the same step; the
    observation is one row of numbers a robot, its parts in the order of the observation space. As
    in EnvPool a step has two halves: `send` begins it on another thread, and `recv` waits for it;
    in between the arrays are the environment's.

    The last observation of an episode is not kept, so that a truncated episode cannot be
    bootstrapped from it; `gymnasium.make_vec` gives it in `final_obs`.

    Args:
        envs: Environments of the autoreset mode "SameStep", whose observation has parts by name.
        buffers: Arrays to write into, by the names of the attributes; None: new ones.

    Attributes:
        num_agents: N.
        single_observation_space: Box of shape (size,), float32.
        single_action_space: As in `envs`.
        observations: Shape (N, size), float32.
        rewards: Shape (N,), float32.
        terminals: Bool, shape (N,): whose episode has ended by what it did.
        truncations: Bool, shape (N,): whose episode ran out of steps.

    Raises:
        InputError: the environments or the arrays are of another kind.
    """

    def __init__(
        self, envs: VectorEnv[Any, Any, Any], buffers: Mapping[str, NDArray[Any]] | None = None
    ) -> None:
        check_same_step(envs)
        self.envs = envs
        self.num_agents: int = envs.num_envs
        self.single_action_space = envs.single_action_space
        single = numeric_parts(envs)
        flat = spaces.flatten_space(single)
        assert isinstance(flat, spaces.Box)
        self.single_observation_space = flat
        shapes = {"observations": (self.num_agents, *flat.shape)}
        made = {name: _made(name, shapes.get(name, (self.num_agents,))) for name in BUFFERS}
        arrays = made if buffers is None else _checked(buffers, made)
        self.observations: Floats32 = arrays["observations"]
        self.rewards: Floats32 = arrays["rewards"]
        self.terminals: Bools = arrays["terminals"]
        self.truncations: Bools = arrays["truncations"]
        sizes = [spaces.flatdim(part) for part in single.spaces.values()]
        ends = np.cumsum(sizes).tolist()
        self._columns = {
            name: slice(end - size, end)
            for name, size, end in zip(single.spaces, sizes, ends, strict=True)
        }
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="ambinav-step")
        self._under_way: Future[Received] | None = None

    def reset(self, seed: int | None = None) -> tuple[Floats32, list[dict[str, Any]]]:
        """Begin an episode of every robot, that of robot i from seed + i; return the observations.

        Raises:
            InputError: the seed cannot be used, or a step is under way.
        """
        self._idle()
        seen, _ = self.envs.reset(seed=seed)
        self._write(seen)
        self.rewards[:], self.terminals[:], self.truncations[:] = 0.0, False, False
        return self.observations, []

    def step(self, actions: NDArray[Any]) -> Received:
        """Drive on for one time step.

        Args:
            actions: Shape (N, columns), or (N,) if they are discrete.

        Returns:
            The four arrays, and a list: empty, or in a step that ends episodes one dictionary with
            their number (`episodes`) and the share of arrivals among them (`is_success`).

        Raises:
            InputError: the actions cannot be used, or a step is under way.
            ResetNeeded: a robot has no episode.
        """
        self._idle()
        return self._step(actions)

    def send(self, actions: NDArray[Any]) -> None:
        """Begin a step, see `step`; what it raises is raised by `recv`. The actions are copied.

        Raises:
            InputError: a step is under way.
        """
        self._idle()
        self._under_way = self._thread.submit(self._step, np.array(actions))

    def recv(self) -> Received:
        """Wait for the step that `send` has begun; see `step`.

        Raises:
            ResetNeeded: none is under way.
        """
        if self._under_way is None:
            raise ResetNeeded("no step is under way; call send first.")
        under_way, self._under_way = self._under_way, None
        return under_way.result()

    def close(self) -> None:
        """Wait for a step that is under way, and close the environments."""
        self._thread.shutdown()
        self.envs.close()

    def _step(self, actions: NDArray[Any]) -> Received:
        seen, rewards, terminated, truncated, info = self.envs.step(actions)
        self._write(seen)
        self.rewards[:], self.terminals[:], self.truncations[:] = rewards, terminated, truncated
        ended = self.terminals | self.truncations
        infos: list[dict[str, Any]] = []
        if ended.any():
            success = info["final_info"]["is_success"][ended]
            infos = [{"episodes": int(ended.sum()), "is_success": float(success.mean())}]
        return self.observations, self.rewards, self.terminals, self.truncations, infos

    def _write(self, seen: Mapping[str, NDArray[Any]]) -> None:
        """Copy the parts of an observation into their columns."""
        for name, columns in self._columns.items():
            self.observations[:, columns] = seen[name].reshape(self.num_agents, -1)

    def _idle(self) -> None:
        if self._under_way is not None:
            raise InputError("a step is under way; call recv first.")


def _made(name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    return np.zeros(shape, np.float32 if name in ("observations", "rewards") else np.bool_)


def _checked(
    buffers: Mapping[str, NDArray[Any]], alike: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return the arrays that have the shape and type of `alike`, or refuse them."""
    for name, made in alike.items():
        given = buffers.get(name)
        if not isinstance(given, np.ndarray):
            raise InputError(f"buffers: {name} is {given!r}; give an array of {made.dtype}.")
        if given.shape != made.shape or given.dtype != made.dtype or not given.flags.writeable:
            kind = f"{given.dtype} of the shape {given.shape}"
            raise InputError(
                f"buffers: {name} is {kind}{'' if given.flags.writeable else ', read-only'}; give "
                f"writable {made.dtype} of the shape {made.shape}."
            )
    return {name: buffers[name] for name in alike}
