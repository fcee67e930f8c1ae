"""The navigation environment: one robot that drives to a goal with a localizer in the loop."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.error import ResetNeeded

from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Bytes
from ambinav_envs.infos import info_of_one
from ambinav_envs.rendering import MODES, metadata_for, renderer_for
from ambinav_envs.scenario import scenario
from ambinav_envs.seeds import as_seed
from ambinav_envs.simulation.layout import REWARD, RUNNING, TIMEOUT
from ambinav_envs.simulation.outcome import Outcome
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.spaces import action_space, continuous, observation_space
from ambinav_envs.spec import SpecOfSimulation

Observation = dict[str, Any]
"""Rows of float32 by name, see `spaces.observation_space`."""


class NavigationEnv(SpecOfSimulation, gym.Env[Observation, Any]):
    """A robot with a range scanner drives to a goal in a building by its own estimate of its pose.

    ## Description

    The robot does not observe its true pose: a localizer in the loop estimates the pose and its
    covariance. Where the scanner gives too little information, as in a bare corridor or in the
    middle of a wide hall, the estimate drifts, and a robot that trusts it misses the goal or hits a
    wall. An ambiguity map of the building shows these places; the reward may include it.

    The robot is a disc that drives on exact arcs among exact walls, with limited acceleration. Its
    wheels follow the commands as far as its limits, `gain_std` and `actuation_std` permit. Odometry
    measures the wheels exactly; over the floor the robot moves with the errors of `OdometryNoise`
    and with `slip`, so that nothing which it commands or measures is its true motion. Lengths are
    metres, angles radians counter-clockwise, one step is `dt` = 0.2 seconds.

    ## Action Space

    `Box(-1, 1, (2,), float32)`; values beyond the limits are clipped.

    | Num | Action    | Min                       | 0             | Max                      |
    |-----|-----------|---------------------------|---------------|--------------------------|
    | 0   | speed     | -1: `min_speed` (0 m/s)   | the middle    | 1: `max_speed` (0.5 m/s) |
    | 1   | turn rate | -1: to the right, 2 rad/s | straight on   | 1: to the left, 2 rad/s  |

    With `declare=("arrived",)` there is a third number: above 0.5 the robot says that it is at its
    goal. That counts once it is repeated for `declare_seconds` (0.5 s) without a break, and ends
    the episode: the estimate is not looked at. With `declare=("arrived", "lost")` there is a fourth
    one: above 0.5 the robot says that it is lost. It then stands for `help_seconds` (15 s), and is
    given an estimate as at the start.

    With `belief=True`, as in the ids `-Belief`, nine more numbers give the agent's own estimate of
    the pose with its covariance: see `ambinav_envs.beliefs`. It is about the pose at which the
    robot has observed, and the reward's term `belief` is its logarithmic score.
    Declarations and beliefs beyond [-1, 1] are refused.

    With `discrete=True` it is `Discrete(9)`, the rows of `ambinav_envs.spaces.ACTIONS`: 3 k + j is
    to stand (k = 0), half speed (1) or full speed (2), turning left (j = 0), straight on (1) or
    turning right (2), at half the turn rate; one for each declaration follows.

    ## Observation Space

    A `Dict` of rows of float32, always finite:

    | Key           | Num     | Observation                                   | Min | Max |
    |---------------|---------|-----------------------------------------------|-----|-----|
    | `scan`        | 0 to 59 | reading / range of 4 m; 1 no echo, 0 too near | 0   | 1   |
    | `goal`        | 0       | distance of the goal, in units of 10 m        | 0   | 10  |
    |               | 1, 2    | cosine and sine of its bearing                | -1  | 1   |
    | `velocity`    | 0       | speed of the wheels / highest speed           | -1  | 1   |
    |               | 1       | their turn rate / highest turn rate           | -1  | 1   |
    | `uncertainty` | 0, 1    | deviation along the weak axis and across (m)  | 0   | 2   |
    |               | 2, 3    | cosine, sine of that axis' double angle       | -1  | 1   |
    |               | 4       | deviation of the heading (rad)                | 0   | 2   |
    | `window`      | 0-255   | ambiguity around it, 16 x 16 cells of 0.4 m   | 0   | 1   |
    |               | 256-511 | the same cells: 1 free, 0 not                 | 0   | 1   |
    | `waypoint`    | 0 to 2  | as `goal`: a point 0.9 to 1.6 m ahead there   |     |     |
    | `remaining`   | 0       | share of the episode's steps that is left     | 0   | 1   |

    Goal, window and waypoint are relative to the *estimated* pose, with `pose_latency` to an older
    one. The window's rows go from ahead to behind, each from left to right. `window` is left out
    with `window=False`, `waypoint` with `waypoint=False`: it is ahead on the shortest route, or
    with `ambiguity_weight` on the cheapest one where a metre costs 1 + ambiguity_weight *
    ambiguity. Only the window's first half reads the ambiguity map, and the waypoint if
    `ambiguity_weight` is above 0. With `ambiguity_seen=False` that half is 0 in free cells and 1 in
    others, as known from the walls, and such a waypoint is refused.
    `gymnasium.wrappers.FilterObservation` and `FlattenObservation` select parts of it and flatten
    it; see `ambinav_envs.wrappers`.

    ## Rewards

    The sum of terms times weights; `info["terms"]` holds the terms, `info["reward_terms"]` the
    same times their weights. `reward` is a preset or a dict of weights by term. Each term reads the
    true pose, the estimated one, or both: a lost robot may be rewarded for something that it cannot
    observe.

    | Term        | Meaning                                         | Pose | ambiguity, by default |
    |-------------|-------------------------------------------------|------|-----------------------|
    | `progress`  | metres by which the path to the goal is shorter | true | 0.3                   |
    | `arrival`   | 1 on truly arriving                             | both | 1                     |
    | `collision` | -1 on touching a wall or a box                  | true | 1                     |
    | `missed`    | -1 on stopping where the goal is not            | both | 1                     |
    | `time`      | minus seconds                                   |      | 0.03                  |
    | `ambiguity` | minus the map's layer `level` on the path (m)   | true | 0.3                   |
    | `fisher`    | minus its layer `fisher` along the path         | true | 0                     |
    | `error`     | minus error (m) times metres driven; privileged | both | 0                     |
    | `lost`      | minus seconds while lost; privileged            | both | 0                     |
    | `belief`    | score of the belief (nats) times seconds        | true | 0                     |

    The presets `shortest`, `fisher`, `error` and `belief` replace `ambiguity: 0.3` by 0,
    `fisher: 1.5`, `error: 6` and `belief: 0.001`. In addition to the reward, `info["cost"]` is 1 in
    a step that ends in a collision plus 1 in a step in which the robot is lost, as in
    Safety-Gymnasium (`cost_collision`, `cost_lost`). A robot is lost if its error was above 0.5 m
    or 30 degrees for over a second.

    ## Starting State

    A building of the suite, one of its goals (32 to 256, the same for everyone, since the costs to
    go to them are computed once) and a start anywhere are drawn: the shortest path between them is
    `shortest` to `longest` long (2 to 15 m), the heading is random. The robot stands still; the
    error of its first estimate is drawn with the deviations `start_std` (5 cm, 5 cm, 0.02 rad),
    which the localizer knows. `reset(options={"start": (x, y, theta), "goal": (x, y), "building":
    key})` fixes any of them. `reset(seed=...)` makes the same episode, and the same ones after it.

    With `walls_std` and `furniture_std` the world deviates from the map; starts and goals are free
    and connected in both. `start_unknown`, `kidnapped`, `closed_door` and `slip` add disturbances
    that are unknown to the map, the odometry and the localizer; with `start_aliases` the localizer
    also starts where the scan is the same as at the robot's start; see `NavigationParameters`.

    ## Episode End

    1. Termination, "arrived": the estimate is within 0.3 m of the goal and the truth within 0.5 m;
       with `goal_std` an estimate with a larger deviation does not count as arrived. Where the
       robot declares its arrival that takes the place of the estimate.
    2. Termination, "missed": the estimate is at the goal, or that is declared, and the true pose is
       not.
    3. Termination, "collided": the robot touches a wall or an unmapped box.
    4. Termination, "lost": the robot is lost, with `end_when_lost=True` only.
    5. Truncation, "timeout": after `max_steps` (300).

    `info["outcome"]` then gives the reason, `info["is_success"]` is true on arrival.

    ## Arguments

    ```python
    >>> import gymnasium as gym
    >>> import ambinav_envs
    >>> gym.make("ambinav/Office-v1", reward="shortest", people=2)
    <OrderEnforcing<PassiveEnvChecker<NavigationEnv<ambinav/Office-v1>>>>
    >>> gym.make_vec("ambinav/Office-v1", num_envs=64).num_envs
    64

    ```

    | Argument            | Default        | Description                                          |
    |---------------------|----------------|------------------------------------------------------|
    | `suite`             | "procedural"   | hall, corridor, office, warehouse, loop, procedural  |
    | `map`               | `None`         | an environment file, or an environment, instead; or  |
    |                     |                | {"file": "a.yaml", "space": {"extrude": 2.5}}        |
    | `buildings`         | `None`         | how many of the suite are drawn from; `None`: any,   |
    |                     |                | a new one each episode; the ids of the suites say 64 |
    | `first_building`    | `None`         | number of the first of them; None: the task's, or 0  |
    | `render_mode`       | `None`         | "human" or "rgb_array"                               |
    | `render_view`       | "auto"         | "whole" building, "follow" the robot; auto: by size  |
    | `max_episode_steps` | `None`         | as `max_steps`; `gym.make` does not pass it on       |
    | `discrete`          | `False`        | nine actions instead of continuous ones              |
    | `declare`           | ()             | what an action may declare: "arrived", "lost"        |
    | `belief`            | `False`        | an action gives the robot's own belief; the ids      |
    |                     |                | `-Belief` say `True`                                 |
    | `localizer`         | "ekf"          | "ekf", "mcl", "perfect" or "odometry"; the ids'      |
    |                     |                | twins `-TruePose` say "perfect": no error at all     |
    | `ambiguity_seen`    | `True`         | the observation reads the ambiguity map; the ids'    |
    |                     |                | twins `-NoMap` say `False`                           |
    | `odometry_scale`    | 1.0            | how many times worse odometry is than modelled       |
    | `people`            | 0              | how many walk about, or `People`                     |
    | `obstacles`         | 0              | how many boxes stand about that the map lacks        |
    | `reward`            | "ambiguity"    | preset, or weights by term                           |
    | `difficulty`        | 0              | 0 to 3: how unlike its map and its models the world  |
    |                     |                | is, by what `difficulty.LEVELS` says of others       |
    | `task`              | `None`         | name of a task, whose arguments and functions count  |

    Every other field of `ambinav_envs.parameters.NavigationParameters` is an argument too. Invalid
    values raise `ambinav.runtime.errors.InputError`.

    `gym.make` keeps `max_episode_steps` for Gymnasium's own `TimeLimit`, which truncates without an
    `info["outcome"]`: give it `max_steps` instead. `gym.make_vec` passes it on to the environment.

    `env.unwrapped.simulation` gives access to the true state, for analysis.

    ## Version History

    * v3, the last two `TwinRooms` alone: a false declaration costs twice as much, time half, and
      there is twice as much of it; the odometry of the last is as modelled. Looks did not pay.
    * v2, `TwinRooms` alone: the paths from all hypotheses to the goal have a length from `shortest`
      to `longest`. That from the true start alone had, so that the first observation often told
      which of them it was.
    * v1: errors are in the motion, and `velocity` is that of the wheels. It was the true one, whose
      sum knew the position better than the localizer. `remaining` is observed, `declare` and
      `belief` are arguments. Speeds rise from -1 to 1, a step is 0.2 s, and rewards are smaller.
    * v0: first version. Before the first release: a waypoint is observed by default, an action of
      zeros stops the robot, and `missed` is a term of the reward.
    """

    metadata: dict[str, Any] = metadata_for(0.2)

    def __init__(
        self,
        suite: str | None = None,
        *,
        map: str | Path | Mapping[str, Any] | Environment | None = None,
        buildings: int | None = None,
        first_building: int | None = None,
        render_mode: str | None = None,
        render_view: str = "auto",
        max_episode_steps: int | None = None,
        **options: Any,
    ) -> None:
        source, parameters = scenario(
            suite, map, buildings, first_building, max_episode_steps, options
        )
        self.simulation = Simulation(source, parameters, 1)
        self.observation_space = observation_space(parameters)
        self.action_space = action_space(parameters)
        self.metadata = metadata_for(parameters.dt)
        self.render_mode = render_mode
        self._renderer = renderer_for(self.simulation, render_mode, render_view)
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Start the random numbers anew from this.
            options: `start` (x, y, theta), `goal` (x, y) and `building` (number or key); what is
                left out is drawn.

        Raises:
            InputError: the seed or an option is invalid; then there is no current episode.
        """
        self._running = False
        super().reset(seed=as_seed(seed))
        out = self.simulation.outcome()
        self.simulation.reset([0], [self.np_random], options, out)
        self._running = True
        self._show()
        return _first(out), info_of_one(self.simulation, out, False)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive on for one time step.

        Args:
            action: Speed, turn rate and declarations, clipped to [-1, 1]; or the number of one of
                `spaces.ACTIONS`, or of a declaration.

        Raises:
            InputError: the action has another shape, or is not finite.
            ResetNeeded: there is no current episode.
        """
        chosen = continuous(action, None, self.simulation.parameters)
        if not self._running:
            raise ResetNeeded("no episode is going on; call reset first.")
        out = self.simulation.outcome()
        self.simulation.step(chosen, None, out)
        outcome = int(self.simulation.state["outcome"][0])
        terminated, truncated = outcome not in (RUNNING, TIMEOUT), outcome == TIMEOUT
        done = outcome != RUNNING
        self._running = not done
        self._show()
        info = info_of_one(self.simulation, out, done)
        return _first(out), float(out.figures[0, REWARD]), terminated, truncated, info

    def render(self) -> Bytes | None:
        """Return the picture, shape (640, 960, 3), in the mode "rgb_array".

        With "human" every step and reset shows it by itself; then and without a mode: None.

        Raises:
            ResetNeeded: there is no episode yet.
        """
        if self._renderer is None:
            gym.logger.warn(
                "render was called without a render mode; give one to make, such as "
                f'gym.make("ambinav/Navigation-v1", render_mode="{MODES[1]}").'
            )
            return None
        if self.render_mode == "human":
            self._renderer.show(self.metadata["render_fps"])
            return None
        return self._renderer.frame()

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()

    def _show(self) -> None:
        """Record the new state, and show it if the mode is for a window."""
        if self._renderer is not None:
            self._renderer.note()
            if self.render_mode == "human":
                self.render()


def _first(out: Outcome) -> Observation:
    return {name: part[0] for name, part in out.observation.items()}
