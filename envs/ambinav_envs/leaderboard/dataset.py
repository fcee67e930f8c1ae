"""Minari data sets of episodes by planners and policies, for offline learning.

Minari (https://minari.farama.org) is an extra: `pip install "ambinav[minari]"`. A data set has the
episodes of one method in one environment, and its seeds: `reset(seed=...)` of the environment that
it recovers and the recorded actions give the recorded observations and rewards again. A README.md
beside the data is its card, see `dataset_card`.
"""

from __future__ import annotations

import contextlib
import copy
import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import gymnasium as gym
import numpy as np

from ambinav import __version__
from ambinav.config import as_count
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing
from ambinav.runtime.packages import need
from ambinav.runtime.progress import Progress, silent, step_of
from ambinav_envs.buildings.suites import suite
from ambinav_envs.evaluation import UNSEEN, episode_seeds
from ambinav_envs.file_arguments import with_absolute_files
from ambinav_envs.leaderboard.dataset_card import ENDED, INFOS, dataset_card
from ambinav_envs.leaderboard.methods import Method
from ambinav_envs.leaderboard.model_card import README
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.policies.fit import check_fit
from ambinav_envs.policies.policy import Policy, checked_actions
from ambinav_envs.registered import is_wrapped, make_wrapped, simulation_of
from ambinav_envs.registration import register_envs
from ambinav_envs.seeds import as_seed
from ambinav_envs.tasks import NAMESPACE

if TYPE_CHECKING:
    from minari.data_collector import EpisodeBuffer

VERSION: Final = 0
_ROOT: Final = "MINARI_DATASETS_PATH"
_CODE: Final = f"https://github.com/ambinav/ambinav/tree/v{__version__}"
_UNSEEN: Final = {"first_building": UNSEEN, "buildings": 100}
"""Buildings of a suite in which policies of a data set are to be evaluated."""


@dataclass(frozen=True)
class Recorded:
    """A data set that was recorded.

    Attributes:
        id: Id for `minari.load_dataset`.
        episodes: Number of episodes.
        steps: Number of steps of all episodes.
        arrived: Number of episodes that arrived.
    """

    id: str
    episodes: int
    steps: int
    arrived: int


def dataset_id(environment: str, method: str) -> str:
    """Return the id of a data set in Minari's form: ambinav/hall/reference-5-v0."""
    suite = environment.rpartition("/")[2].rpartition("-v")[0].lower()
    name = re.sub(r"[^a-z0-9_]+", "-", method.lower()).strip("-") or "unnamed"
    return f"{NAMESPACE}/{suite}/{name}-v{VERSION}"


def record_datasets(
    methods: Sequence[Method],
    environment: str,
    arguments: Mapping[str, Any],
    episodes: int,
    seed: int,
    folder: Path,
    progress: Progress = silent,
    author: str | None = None,
) -> tuple[Recorded, ...]:
    """Record a data set of each method into a folder; on failure write none.

    Args:
        methods: Methods that drive, all in the same episodes.
        environment: An id of Gymnasium, of a `NavigationEnv` or a wrapper around one.
        arguments: Arguments of the environment, as plain values, since Minari keeps them as JSON;
            they go before what a method brings along. Names of files are kept as absolute ones.
        episodes: Number of episodes of each method.
        seed: Seed of the episodes, see `evaluation.episode_seeds`.
        folder: Made anew; for `MINARI_DATASETS_PATH`.
        progress: Called with the share done.
        author: Author of the data sets, for their metadata and cards.

    Raises:
        InputError: minari is missing, the folder is there, two data sets have the same name, an
            argument cannot be used, or a method does not fit.
    """
    need("a data set", ("minari", "h5py"), "minari")
    arguments = with_absolute_files(arguments, Path())
    if is_wrapped(environment):
        make_wrapped(environment, arguments).close()
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: it is there already; choose another output.")
    episodes, first = as_count(episodes, "episodes"), as_seed(seed) or 0
    names = [dataset_id(environment, method.name) for method in methods]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two data sets are called {name!r}; rename a policy's file.")
    for method in methods:
        if arguments.get("discrete") and method.seeing.get("discrete") is False:
            raise InputError(
                f"discrete is true, but {method.name!r} steers by speed and turn rate; drop it."
            )
    register_envs()
    made = []
    with replacing(folder) as fresh:
        fresh.mkdir()
        with _datasets_in(fresh):
            for k, (name, method) in enumerate(zip(names, methods, strict=True)):
                merged = {**method.seeing, **arguments}
                part = step_of(progress, k, len(methods))
                made.append(
                    _record(name, method, environment, merged, episodes, first, part, author)
                )
    return tuple(made)


@contextlib.contextmanager
def _datasets_in(folder: Path) -> Iterator[None]:
    """Set the folder of Minari's data sets; only an environment variable can set it."""
    before = os.environ.get(_ROOT)
    os.environ[_ROOT] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[_ROOT]
        else:
            os.environ[_ROOT] = before


def _record(
    name: str,
    method: Method,
    environment: str,
    arguments: Mapping[str, Any],
    episodes: int,
    seed: int,
    progress: Progress,
    author: str | None,
) -> Recorded:
    """Record the data set of one method, and write its card."""
    from minari import create_dataset_from_buffers

    env = gym.make(environment, **arguments)
    try:
        _check_plain(env)
        driver, driven = _Driver(method, env), []
        for k, number in enumerate(episode_seeds(seed, 0, episodes)):
            driven.append(driver.drive(k, int(number)))
            progress((k + 1) / episodes)
        metadata = {
            "algorithm_name": method.text,
            "description": f"{method.text} in {environment}, {episodes} episodes, seed {seed}.",
            "code_permalink": _CODE,
            "requirements": [f"ambinav[envs]=={__version__}"],
        }
        if author is not None:
            metadata["author"] = author
        source, evaluation = simulation_of(env).source, copy.deepcopy(env.spec)
        assert evaluation is not None
        if source.environment is None:
            evaluation.kwargs |= _UNSEEN
        buffers, ends = [buffer for buffer, _ in driven], [end for _, end in driven]
        with warnings.catch_warnings():
            # The author and the address: those who publish it know them.
            warnings.simplefilter("ignore", UserWarning)
            stored = create_dataset_from_buffers(
                name, buffers, env, eval_env=evaluation, data_format="hdf5", **metadata
            )
        stored.storage.update_episode_metadata(ends)
        drawn = source.environment is None and all(
            draw.__module__.startswith("ambinav_envs.") for draw in suite(source.name).functions()
        )
        card = dataset_card(name, metadata, env, evaluation, buffers, ends, drawn)
        (stored.storage.data_path.parent / README).write_text(card, encoding="utf-8")
    finally:
        env.close()
    arrived = sum(end["outcome"] == "arrived" for end in ends)
    return Recorded(name, episodes, int(stored.total_steps), arrived)


def _check_plain(env: gym.Env[Any, Any]) -> None:
    assert env.spec is not None
    try:
        env.spec.to_json()
    except (TypeError, ValueError) as error:
        raise InputError(
            f"an argument of the environment is not a plain value ({error}); Minari keeps it as "
            "JSON, so give numbers, texts and names of files."
        ) from None


class _Driver:
    """A method in a single environment; `evaluation.evaluate_in` uses a batched one.

    Raises:
        InputError: it is a policy that does not fit.
    """

    def __init__(self, method: Method, env: gym.Env[Any, Any]) -> None:
        inner = env.unwrapped
        assert isinstance(inner, NavigationEnv)
        self._env, self._simulation = env, inner.simulation
        parameters = self._simulation.parameters
        self._driver, self._name = method.make(parameters), method.name
        if isinstance(self._driver, Policy):
            check_fit(self._driver, parameters, force=False)
            self._driver.configure(parameters)
            self._driver.prepare(env.observation_space, env.action_space)

    def drive(self, number: int, seed: int) -> tuple[EpisodeBuffer, dict[str, Any]]:
        """Run one episode; return it, and how it ended."""
        # Its `DataCollector` and `add_step_data` gather the same, but need JAX.
        from minari.data_collector import EpisodeBuffer

        seen, info = self._env.reset(seed=seed)
        driver, starts = self._driver, np.array([True])
        if not isinstance(driver, Policy):
            driver.begin(self._simulation, [0])
        observations, infos, actions, rewards = [seen], [info], [], []
        overs: list[bool] = []
        cuts: list[bool] = []
        while not (overs and (overs[-1] or cuts[-1])):
            rows = {name: part[None] for name, part in seen.items()}
            if isinstance(driver, Policy):
                action = driver.act(rows, starts)
            else:
                action = driver.act(rows, starts, self._simulation)
            actions.append(self._action(action))
            seen, reward, terminated, cut, info = self._env.step(actions[-1])
            observations.append(seen)
            infos.append(info)
            rewards.append(float(reward))
            overs.append(terminated)
            cuts.append(cut)
            starts = np.array([False])
        buffer = EpisodeBuffer(
            id=number,
            seed=seed,
            observations={name: [entry[name] for entry in observations] for name in seen},
            actions=actions,
            rewards=rewards,
            terminations=overs,
            truncations=cuts,
            infos={name: np.array([entry[name] for entry in infos]) for name in INFOS},
        )
        # A wrapper may have truncated it, such as Gymnasium's TimeLimit.
        last = {"outcome": "timeout", "is_success": False, **info}
        return buffer, {name: last[name] for name in ENDED}

    def _action(self, output: Any) -> Any:
        """Convert the action to the space's type, so that the record equals what was done.

        Raises:
            InputError: it is of no use.
        """
        space = self._env.action_space
        chosen = checked_actions(self._name, output, 1, simulation_of(self._env).parameters)[0]
        if isinstance(space, gym.spaces.Box):
            return np.clip(chosen.astype(space.dtype), space.low, space.high)
        return np.int64(np.asarray(output)[0])
