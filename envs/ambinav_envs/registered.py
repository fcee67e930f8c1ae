"""Environments by their Gymnasium id, also those that somebody has wrapped and registered."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from typing import Any

import gymnasium as gym

from ambinav.plugins import reason
from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.registration import is_plain, spec_of, with_task
from ambinav_envs.simulation.layout import FIGURES, OUTCOMES, TIMEOUT
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.spaces import action_space, observation_space

_LIMITS = ("first_building", "max_episode_steps")
_INFO = (*FIGURES, "lost", "was_lost")


def is_wrapped(name: str) -> bool:
    """Return whether an id is more than `NavigationEnv` with arguments.

    Raises:
        InputError: nobody has registered it.
    """
    return not is_plain(spec_of(name))


def arguments_of_id(name: str, changes: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the arguments of `NavigationEnv` that an id stands for.

    Args:
        name: The id; "module:id" imports the module first.
        changes: Arguments that are given besides, and replace those of the id.

    Raises:
        InputError: nobody has registered it, or see `make_wrapped`.
    """
    spec, changes = spec_of(name), dict(changes or {})
    if is_plain(spec):
        return with_task({**spec.kwargs, **changes})
    env = make_wrapped(name, changes)
    simulation = simulation_of(env)
    env.close()
    source, parameters = simulation.source, simulation.parameters
    place: dict[str, Any] = {"suite": source.name, "buildings": source.count}
    if source.environment is not None:
        place = {"map": source.environment}
    values = {item.name: getattr(parameters, item.name) for item in fields(NavigationParameters)}
    plain = {key: value for key, value in changes.items() if key not in _LIMITS}
    return {**place, "first_building": source.first, **values, **plain}


def make_wrapped(name: str, arguments: Mapping[str, Any]) -> gym.Env[Any, Any]:
    """Make an environment of a wrapped id, and check that it is one of ours with our spaces.

    What goes wrong in its episodes raises `InputError` too.

    Raises:
        InputError: it cannot be made of these arguments, there is no `NavigationEnv` in it, or it
            has other spaces than that.
    """
    try:
        with warnings.catch_warnings():
            # Gymnasium's advice to who wrote it, who gets it from `gymnasium.make`.
            warnings.simplefilter("ignore", UserWarning)
            env: gym.Env[Any, Any] = gym.make(name, **arguments)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    except Exception as error:
        # It is somebody else's code, which may fail in any way.
        keys = ", ".join(arguments) or "no arguments"
        raise InputError(
            f"{name}: it cannot be made with {keys} ({reason(error)}); let what it is registered "
            "with take them and hand them to NavigationEnv."
        ) from error
    inner = env.unwrapped
    if not isinstance(inner, NavigationEnv):
        raise InputError(
            f"{name}: it is {type(inner).__name__}, in which there is no NavigationEnv; give an id "
            "whose environment is one, or a wrapper around one."
        )
    parameters = inner.simulation.parameters
    for noun, registered, ours in (
        ("observation_space", env.observation_space, observation_space(parameters)),
        ("action_space", env.action_space, action_space(parameters)),
    ):
        if registered != ours:
            raise InputError(
                f"{name}: {noun} ({_text(registered)}) has other parts, shapes or limits than that "
                f"of NavigationEnv ({_text(ours)}); leave out the wrapper that changes it."
            )
    return _Guarded(env, name)


class _Guarded(gym.Wrapper[Any, Any, Any, Any]):
    """Outermost wrapper, which says what goes wrong in those within, and in which environment."""

    def __init__(self, env: gym.Env[Any, Any], name: str) -> None:
        super().__init__(env)
        self._name = name

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Raises:
            InputError: it fails.
        """
        with self._naming("reset"):
            seen, info = self.env.reset(**options)
        return seen, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make a step.

        Raises:
            InputError: it fails, makes another number of steps within, or hides their info.
        """
        state = simulation_of(self.env).state
        before = int(state["steps"][0])
        with self._naming("step"):
            seen, reward, ended, cut, info = self.env.step(action)
            steps = int(state["steps"][0]) - before
            if steps != 1:
                raise InputError(
                    f"one step of it makes {steps} of NavigationEnv, each of which counts in the "
                    "figures; leave out the wrapper that repeats actions, and give a longer dt."
                )
            lacking = [key for key in _INFO if key not in info]
            if lacking:
                raise InputError(
                    f"the info of a step lacks {', '.join(lacking)}; let the wrapper return that "
                    "of NavigationEnv with what it adds."
                )
            if (ended or cut) and "outcome" not in info:
                # A wrapper has ended it, such as Gymnasium's TimeLimit.
                info = {**info, "outcome": OUTCOMES[TIMEOUT], "is_success": False}
            return seen, float(reward), ended, cut, info

    @contextmanager
    def _naming(self, method: str) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise InputError(f"{self._name}: {error}") from error
        except Exception as error:
            raise InputError(
                f"{self._name}: {method} failed ({reason(error)}); fix what is registered."
            ) from error


def _text(space: gym.Space[Any]) -> str:
    """Describe a space without its limits, which may be hundreds of numbers."""
    if isinstance(space, gym.spaces.Dict):
        return ", ".join(f"{key} {part.shape}" for key, part in space.items())
    return f"{type(space).__name__} {space.shape}"


def simulation_of(env: gym.Env[Any, Any]) -> Simulation:
    """Return the simulation in an environment that is or wraps a `NavigationEnv`."""
    inner = env.unwrapped
    assert isinstance(inner, NavigationEnv)
    return inner.simulation
