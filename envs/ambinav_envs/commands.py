"""Conversion between actions and speeds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bools, Floats
from ambinav_envs.beliefs import filter_belief
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.belief import NUMBERS
from ambinav_envs.simulation.layout import MOTIONS
from ambinav_envs.simulation.observe import FAR

NOTHING_KNOWN = np.repeat((0.0, 1.0, 0.0), 3)
"""A belief with the largest deviations."""


def as_commands(actions: Floats, parameters: NavigationParameters) -> Floats:
    """Convert actions to speed (m/s) and turn rate (rad/s), shape (N, 2).

    Args:
        actions: Shape (N, columns), see `spaces.continuous`; what is beyond [-1, 1] is cut off.
        parameters: Parameters of the environment.
    """
    shares = np.clip(actions, -1.0, 1.0)
    least, most, share = parameters.min_speed, parameters.robot.max_speed, shares[:, 0]
    speed = least + 0.5 * (share + 1.0) * (most - least)
    return np.stack([speed, shares[:, 1] * parameters.robot.max_turn_rate], axis=1)


def as_actions(
    commands: Floats,
    parameters: NavigationParameters,
    arrived: Bools | None = None,
    lost: Bools | None = None,
    belief: Floats | None = None,
) -> Floats:
    """Convert speeds (m/s) and turn rates (rad/s) to continuous actions, shape (N, columns).

    Speeds that no action asks for give actions beyond [-1, 1].

    Args:
        commands: Shape (N, 2).
        parameters: Parameters of the environment.
        arrived: Who declares to be at the goal, shape (N,); None: nobody.
        lost: Who declares to be lost, likewise. What the environment does not let a robot declare
            is left out.
        belief: Numbers of the belief, shape (N, 9), where the environment asks for one; see
            `beliefs.belief_numbers`. None: at the estimate, with the largest deviations.
    """
    least, most, speed = parameters.min_speed, parameters.robot.max_speed, commands[:, 0]
    share = 2.0 * (speed - least) / (most - least) - 1.0
    actions = np.full((len(commands), parameters.columns), -1.0)
    actions[:, 0], actions[:, 1] = share, commands[:, 1] / parameters.robot.max_turn_rate
    for name, who in (("arrived", arrived), ("lost", lost)):
        if who is not None and name in parameters.declare:
            actions[who, MOTIONS + parameters.declare.index(name)] = 1.0
    if parameters.belief:
        actions[:, -NUMBERS:] = NOTHING_KNOWN if belief is None else belief
    return actions


def by_filter(
    commands: Floats,
    observations: Mapping[str, NDArray[np.floating]],
    parameters: NavigationParameters,
) -> Floats:
    """Convert speeds to actions of a robot that trusts its localizer, shape (N, columns).

    It stands and declares its arrival where it is `at_goal`, and where a belief is asked for it
    gives the localizer's.

    Args:
        commands: Speeds (m/s) and turn rates (rad/s), shape (N, 2).
        observations: Parts of the observation by name, shape (N, size).
        parameters: Parameters of the environment.
    """
    belief = filter_belief(observations) if parameters.belief else None
    arrived = at_goal(observations, parameters)
    halted = np.where(arrived[:, None], 0.0, commands)
    return as_actions(halted, parameters, arrived, belief=belief)


def at_goal(
    observations: Mapping[str, NDArray[np.floating]], parameters: NavigationParameters
) -> Bools:
    """Return which robots are at the goal by their estimate, shape (N,).

    The rule by which robots stop that declare nothing: it is within `goal_radius`, and its
    deviation along any axis is at most `goal_std`.

    Args:
        observations: Parts of the observation by name, shape (N, size); `goal` and, with a
            `goal_std`, `uncertainty` are read where an arrival can be declared, and none else.
        parameters: Parameters of the environment.
    """
    if "arrived" not in parameters.declare:
        return np.zeros(len(next(iter(observations.values()))), dtype=np.bool_)
    is_there = FAR * observations["goal"][:, 0] <= parameters.goal_radius
    if parameters.goal_std is not None:
        is_there &= observations["uncertainty"][:, 0] <= parameters.goal_std
    return np.asarray(is_there, dtype=np.bool_)
