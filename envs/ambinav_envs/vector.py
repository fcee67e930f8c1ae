"""The navigation environment for many robots: the same numbers, one kernel for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ambinav.config import as_count
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.runtime.errors import InputError
from ambinav_envs.infos import ends, info_of_all, part_of
from ambinav_envs.navigation import Observation
from ambinav_envs.rendering import metadata_for, renderer_for
from ambinav_envs.scenario import scenario
from ambinav_envs.seeds import as_seeds
from ambinav_envs.simulation.layout import REWARD
from ambinav_envs.simulation.outcome import Outcome
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.spaces import action_space, continuous, observation_space
from ambinav_envs.spec import SpecOfSimulation

Step = tuple[Observation, Floats, Bools, Bools, dict[str, Any]]

# Warn if this many robots each wait for a new building.
MANY = 16


class NavigationVectorEnv(SpecOfSimulation, VectorEnv[Observation, Any, NDArray[Any]]):
    """N robots, each in an episode of its own: `NavigationEnv` N times, in one kernel.

    Seeded with s, robot i has the same episodes, bit for bit, as a `NavigationEnv` seeded with
    s + i. Observations and rewards are C-contiguous; no array is modified by later steps.

    Args:
        num_envs: N.
        suite: As for `NavigationEnv`, as all that follows but the mode.
        map: See there.
        buildings: See there.
        first_building: See there.
        render_mode: See there; "human" shows the first robot.
        render_view: See there.
        max_episode_steps: See there.
        autoreset_mode: When an episode that has ended is followed by the next: at the next step
            ("NextStep"), whose action is then ignored; in the same step ("SameStep"), with the
            last observation and info in `final_obs` and `final_info`; or by calling `reset` with
            `options={"reset_mask": ...}` ("Disabled").
        **options: See there.

    Attributes:
        simulation: The simulation behind the environments.
        autoreset_mode: See there; the attribute that TorchRL reads.

    Raises:
        InputError: an argument cannot be used.

    Warns:
        UserWarning: many robots have a new building in every episode, which is slow.
    """

    def __init__(
        self,
        num_envs: int = 1,
        suite: str | None = None,
        *,
        map: str | Path | Mapping[str, Any] | Environment | None = None,
        buildings: int | None = None,
        first_building: int | None = None,
        render_mode: str | None = None,
        render_view: str = "auto",
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        source, parameters = scenario(
            suite, map, buildings, first_building, max_episode_steps, options
        )
        self.num_envs = as_count(num_envs, "num_envs")
        if source.count is None and self.num_envs >= MANY:
            gym.logger.warn(
                f"each episode of {self.num_envs} robots has a new building, and its map takes a "
                "tenth of a second and more; give a number of them, such as buildings=64, where "
                "speed counts."
            )
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = metadata_for(parameters.dt) | {"autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.simulation = Simulation(source, parameters, self.num_envs)
        self._renderer = renderer_for(self.simulation, render_mode, render_view)
        self.single_observation_space = observation_space(parameters)
        self.single_action_space = action_space(parameters)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._started = np.zeros(self.num_envs, dtype=np.bool_)
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode of every robot.

        Args:
            seed: The random numbers of robot i, if its episode begins, start anew from seed + i,
                or from the i-th of them; None: they go on.
            options: As for `NavigationEnv.reset`, for all robots; and `reset_mask`, bool, shape
                (N,): robots whose episodes begin; all others continue.

        Raises:
            InputError: a seed or an option cannot be used; if it is an option, robots whose
                episodes were to begin have none then.
        """
        if not isinstance(options, Mapping | None):
            raise InputError(f"reset: options is {options!r}; give a mapping.")
        options = dict(options or {})
        chosen = self._mask(options.pop("reset_mask", None))
        self._seed(seed, chosen)
        out = self.simulation.outcome()
        if not chosen.all():
            self.simulation.observe(out)
        self._begin(np.flatnonzero(chosen).tolist(), options, out)
        self._ended[chosen] = False
        self._show()
        info = info_of_all(self.simulation, out, np.zeros(self.num_envs, dtype=np.bool_))
        return out.observation, info if chosen.all() else part_of(info, chosen)

    def step(self, actions: Any) -> Step:
        """Drive on for one time step; see `NavigationEnv.step`.

        Args:
            actions: Shape (N, columns), or (N,) if they are discrete.

        Raises:
            InputError: the actions have another shape, or are not finite; or a next episode
                cannot begin, and that robot has none then.
            ResetNeeded: a robot has no episode.
        """
        active = ~self._ended if self._ended.any() else None
        chosen = continuous(actions, self.num_envs, self.simulation.parameters, active)
        if not self._started.all():
            raise ResetNeeded(
                f"robot {int(self._started.argmin())} has no episode; call reset first."
            )
        out = self.simulation.outcome()
        if self.autoreset_mode is AutoresetMode.DISABLED and active is not None:
            raise ResetNeeded(
                f"the episode of robot {int(self._ended.argmax())} has ended; call reset with "
                "options={'reset_mask': ...} first."
            )
        self.simulation.step(chosen, active, out)
        anew = np.flatnonzero(self._ended).tolist()
        terminated, truncated = ends(self.simulation, active)
        done = terminated | truncated
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        if not same_step:
            self._ended = done.copy()
        if anew:
            self._begin(anew, None, out)
        rewards = out.figures[:, REWARD].copy()
        if same_step and done.any():
            info = self._follow(out, done)
        else:
            info = info_of_all(self.simulation, out, done)
        self._show()
        return out.observation, rewards, terminated, truncated, info

    def render(self) -> tuple[Bytes, ...] | None:
        """Return each robot's picture, shape (640, 960, 3); see `NavigationEnv.render`."""
        if self._renderer is None:
            gym.logger.warn("render was called without a render mode; give one to make_vec.")
            return None
        if self.render_mode == "human":
            self._renderer.show(self.metadata["render_fps"])
            return None
        return tuple(self._renderer.frame(i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Random generator of each robot."""
        self._seed(None)
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Latest seed of each robot."""
        self._seed(None)
        return tuple(self._seeds)

    def _show(self) -> None:
        """Record the new state, and show it if the mode is for a window."""
        if self._renderer is not None:
            self._renderer.note()
            if self.render_mode == "human":
                self.render()

    def _begin(self, rows: list[int], options: dict[str, Any] | None, out: Outcome) -> None:
        """Begin episodes of some robots; if that is refused, they have none."""
        self._started[rows] = False
        self.simulation.reset(rows, self._generators, options, out)
        self._started[rows] = True

    def _follow(self, out: Outcome, done: Bools) -> dict[str, Any]:
        """Begin the next episodes in the same step; return the info with the final observations."""
        last = part_of(info_of_all(self.simulation, out, done), done)
        final = np.full(self.num_envs, None, dtype=object)
        rows = np.flatnonzero(done).tolist()
        for i in rows:
            parts = out.observation.items()
            final[i] = {name: part[i].copy() for name, part in parts}
        self._begin(rows, None, out)
        no_robots = np.zeros(self.num_envs, dtype=np.bool_)
        return info_of_all(self.simulation, out, no_robots) | {
            "final_obs": final,
            "_final_obs": done.copy(),
            "final_info": last,
            "_final_info": done.copy(),
        }

    def _seed(self, seed: int | Sequence[int | None] | None, chosen: Bools | None = None) -> None:
        """Seed the random numbers again, or for the first time."""
        seeds = as_seeds(seed, self.num_envs)
        if not self._generators:
            made = [seeding.np_random(value) for value in seeds]
            self._generators, self._seeds = [m[0] for m in made], [m[1] for m in made]
            return
        for i, value in enumerate(seeds):
            if value is not None and (chosen is None or chosen[i]):
                self._generators[i], self._seeds[i] = seeding.np_random(value)

    def _mask(self, mask: Any) -> Bools:
        """Return whose episodes begin."""
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        try:
            chosen = np.asarray(mask)
            fault = f"{chosen.dtype} of the shape {chosen.shape}"
        except (TypeError, ValueError):
            chosen, fault = np.empty(0), "of rows of different lengths"
        if chosen.shape != (self.num_envs,) or chosen.dtype != np.bool_ or not chosen.any():
            raise InputError(
                f"reset_mask is {fault}; give {self.num_envs} booleans, at least one of them true."
            )
        return chosen


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError as error:
        raise InputError(
            f"autoreset_mode is {mode!r}; choose from "
            + ", ".join(member.value for member in AutoresetMode)
            + "."
        ) from error
