"""Adapter from the batched environment to a Stable-Baselines3 VecEnv."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv, VectorWrapper
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvStepReturn

from ambinav.config import as_count
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.errors import InputError
from ambinav_envs.registered import is_wrapped, make_wrapped, simulation_of
from ambinav_envs.seeds import as_seed
from ambinav_envs.wrappers import check_same_step

Infos = list[dict[str, Any]]


def make_sb3(
    id: str = "ambinav/Navigation-v1",
    num_envs: int = 8,
    *,
    seed: int | None = None,
    all_info: bool = False,
    **arguments: Any,
) -> NavigationVecEnv:
    """Make environments for Stable-Baselines3, all in one kernel.

    An environment that somebody wrapped and registered is made `num_envs` times instead, and
    stepped one after the other.

    Args:
        id: Id of a task, or of a wrapper around one.
        num_envs: Number of environments.
        seed: Environment i starts from seed + i.
        all_info: See `NavigationVecEnv`.
        **arguments: Of `ambinav_envs.navigation.NavigationEnv`.

    Raises:
        InputError: nobody has registered the id, or an argument cannot be used.
    """
    if "autoreset_mode" in arguments:
        raise InputError("autoreset_mode is what Stable-Baselines3 needs; leave it out.")
    first = as_seed(seed)
    envs: VectorEnv[Any, Any, Any]
    if is_wrapped(id):
        made_alike = [partial(make_wrapped, id, arguments)] * as_count(num_envs, "num_envs")
        envs = SyncVectorEnv(made_alike, autoreset_mode=AutoresetMode.SAME_STEP)
        simulations = [simulation_of(env) for env in envs.envs]
        for simulation in simulations:
            # Maps are held once.
            simulation.source = simulations[0].source
    else:
        envs = gym.make_vec(
            id,
            num_envs=num_envs,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP.value,
            **arguments,
        )
    made = NavigationVecEnv(envs, all_info=all_info)
    if first is not None:
        made.seed(first)
    return made


class NavigationVecEnv(VecEnv):
    """A `VecEnv` over a `NavigationVectorEnv`, or over Gymnasium's vector wrappers around one.

    The info of a step that ends an episode contains everything, and, as in Stable-Baselines3,
    `terminal_observation` and `TimeLimit.truncated`, so `VecMonitor(made, info_keywords=("outcome",
    "is_success"))` works. `reset_infos` has the infos of the latest resets. All environments are
    one object: attributes and methods are common to all.

    Args:
        envs: With the autoreset mode "SameStep".
        all_info: True: steps within an episode also have the full info; otherwise only `cost` and
            `lost`, which is faster.

    Raises:
        InputError: the autoreset mode is another.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any], *, all_info: bool = False) -> None:
        check_same_step(envs)
        self.envs = envs
        self.all_info = all_info
        self._actions: NDArray[Any] | None = None
        self._begun = False
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = {**envs.metadata, "render_modes": self.metadata["render_modes"]}

    def reset(self) -> Any:
        """Begin an episode in every environment, with the seeds and options that were set last."""
        seeds, options = list(self._seeds), list(self._options)
        # Environments with the same options begin together.
        groups: dict[str, tuple[dict[str, Any], list[int]]] = {}
        for i, env_options in enumerate(options):
            groups.setdefault(repr(env_options), (env_options, []))[1].append(i)
        if len(groups) > 1 and not self._begun and isinstance(self.envs, SyncVectorEnv):
            # It has no observation of those that a mask leaves out before they have begun.
            self.envs.reset(seed=seeds)
        self._begun = True
        for env_options, rows in groups.values():
            mask = np.zeros(self.num_envs, dtype=np.bool_)
            mask[rows] = True
            chosen: Any = [seed if mask[i] else None for i, seed in enumerate(seeds)]
            extra = {} if mask.all() else {"reset_mask": mask}
            seen, info = self.envs.reset(seed=chosen, options={**env_options, **extra})
            for i, entry in zip(rows, infos_of(info, rows), strict=True):
                self.reset_infos[i] = entry
        self._reset_seeds()
        self._reset_options()
        return seen

    def step_async(self, actions: NDArray[Any]) -> None:
        """Set the actions of the next step, shape (N, columns), or (N,) if they are discrete."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Make the step."""
        seen, rewards, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        rows = range(self.num_envs)
        last = info.pop("final_info", None)
        final = info.pop("final_obs", None)
        if self.all_info:
            infos = infos_of(info, rows)
        else:
            costs, lost = info["cost"].tolist(), info["lost"].tolist()
            infos = [{"cost": c, "lost": o} for c, o in zip(costs, lost, strict=True)]
        cut = (truncated & ~terminated).tolist()
        for entry, value in zip(infos, cut, strict=True):
            entry["TimeLimit.truncated"] = value
        ended = np.flatnonzero(done).tolist()
        if ended:
            for i, entry, begun in zip(
                ended, infos_of(last, ended), infos_of(info, ended), strict=True
            ):
                # Entries added by wrappers belong to the ended episode.
                added = {key: value for key, value in begun.items() if key not in entry}
                infos[i] = {
                    **added, **entry,
                    "TimeLimit.truncated": cut[i], "terminal_observation": final[i],
                }  # fmt: skip
                self.reset_infos[i] = begun
        return seen, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_images(self) -> Sequence[Bytes | None]:
        """Return the picture of each robot, with the render mode "rgb_array"."""
        frames: Any = self.envs.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the environments' common attribute, once for each requested environment.

        Raises:
            AttributeError: there is none.
        """
        name = attr_name
        if name in ("observation_space", "action_space"):
            name = f"single_{name}"
        value = getattr(self.envs, name) if hasattr(self.envs, name) else _inner(self.envs, name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of all environments.

        Raises:
            InputError: only some are meant.
        """
        self._all(attr_name, indices)
        setattr(self.envs.unwrapped, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call a method of the batch once; return its result once for each requested environment.

        Of `render`, which gives a picture for each, each gets its own.

        Raises:
            AttributeError: there is none.
        """
        if method_name == "get_wrapper_attr":
            return self.get_attr(method_args[0], indices)
        result = _inner(self.envs, method_name)(*method_args, **method_kwargs)
        rows = self._get_indices(indices)
        if method_name == "render" and result is not None:
            return [result[i] for i in rows]
        return [result for _ in rows]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return whether the environments have this wrapper."""
        layer: VectorEnv[Any, Any, Any] = self.envs
        is_wrapped = False
        while isinstance(layer, VectorWrapper):
            is_wrapped |= inspect.isclass(wrapper_class) and isinstance(layer, wrapper_class)
            layer = layer.env
        return [is_wrapped for _ in self._get_indices(indices)]

    def _all(self, name: str, indices: VecEnvIndices) -> None:
        if len(set(self._get_indices(indices))) != self.num_envs:
            raise InputError(
                f"{name} cannot be set for {indices!r} alone, the environments are one object; "
                "leave out indices."
            )


def infos_of(info: dict[str, Any], rows: Iterable[int]) -> Infos:
    """Convert a vector environment's info to one dict of plain values for each of some rows.

    Args:
        info: Arrays, dicts of such, and their masks (`_key`).
        rows: Which.
    """
    chosen = np.fromiter(rows, dtype=np.intp)
    infos: Infos = [{} for _ in chosen]
    for key, value in info.items():
        if key.startswith("_"):
            continue
        if isinstance(value, dict):
            parts: Iterable[Any] = infos_of(value, chosen.tolist())
        elif value.ndim == 1:
            parts = value[chosen].tolist()
        else:
            parts = value[chosen]
        present = info.get(f"_{key}")
        is_present = [True] * len(infos) if present is None else present[chosen].tolist()
        for entry, part, has in zip(infos, parts, is_present, strict=True):
            if has:
                entry[key] = part
    return infos


def _inner(envs: VectorEnv[Any, Any, Any], name: str) -> Any:
    """Return an attribute of the outermost wrapper that has it, or of the environments."""
    layer = envs
    while isinstance(layer, VectorWrapper):
        if name in vars(layer) or name in vars(type(layer)):
            return getattr(layer, name)
        layer = layer.env
    return getattr(layer, name)
