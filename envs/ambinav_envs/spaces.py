"""Spaces of observations and actions, and conversion of actions for the simulation."""

from __future__ import annotations

import reprlib
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav_envs.observations import OBSERVATIONS
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.layout import MOTIONS, View

ACTIONS: Floats = np.array(
    [(speed, turn) for speed in (0.0, 0.5, 1.0) for turn in (0.5, 0.0, -0.5)]
)
"""The nine discrete actions as shares of the highest speed and turn rate: stand, half, full speed,
turning left, straight on and turning right at half the turn rate each; shape (9, 2). One for each
declaration follows, at which the robot stands."""


def observation_space(parameters: NavigationParameters) -> spaces.Dict:
    """Return the observation space, each part a row of float32.

    | part | size | meaning |
    |---|---|---|
    | scan | beams | reading / maximum range; 0 too near, 1 no echo |
    | goal | 3 | distance in 10 m, cosine and sine of the bearing, from the estimated pose |
    | velocity | 2 | speed and turn rate of the wheels, as odometry measures them, in units of the \
highest |
    | uncertainty | 5 | deviation along the localizer's weak axis and across it (m), cosine and \
sine of the double angle of that axis in the robot's frame, deviation of the heading (rad) |
    | window | 2 K^2 | around the estimated pose, K rows from ahead to behind, each from left to \
right: ambiguity (1 where not free), then what is free (1) and what is not (0) |
    | waypoint | 3 | as goal: a point ahead on the route (`ambiguity_weight`), from the estimate |
    | remaining | 1 | share of the episode's steps that is left |
    | hypotheses | 4 K | share, and the goal as seen from the mean, of the K heaviest clusters |

    The parts that plug-ins bring (`NavigationParameters.observations`) come after them.
    """
    parts = (*map(OBSERVATIONS.get, View._fields), *parameters.plugged_parts)
    boxes: dict[str, spaces.Space[Any]] = {}
    for part in parts:
        with OBSERVATIONS.calling(part.name):
            if part.size(parameters) > 0:
                boxes[part.name] = spaces.Box(*part.bounds(parameters), dtype=np.float32)
    return spaces.Dict(boxes)


def action_space(parameters: NavigationParameters) -> spaces.Space[Any]:
    """Return the action space.

    It is speed (-1 the lowest, 1 the highest), turn rate, one number for each of
    `NavigationParameters.declare`, which is declared above 0.5, and with
    `NavigationParameters.belief` the nine of `beliefs`; or one of `ACTIONS` or of the declarations.

    See `commands.as_commands` for what they are in metres and radians per second.
    """
    if parameters.discrete:
        return spaces.Discrete(len(ACTIONS) + len(parameters.declare))
    return spaces.Box(-1.0, 1.0, (parameters.columns,), np.float32)


def columns_of(parameters: NavigationParameters) -> tuple[int, ...]:
    """Return the columns of each part of a `View`, none for parts that are off."""
    return tuple(OBSERVATIONS.get(name).size(parameters) for name in View._fields)


def continuous(
    actions: object,
    count: int | None,
    parameters: NavigationParameters,
    active: Bools | None = None,
) -> Floats:
    """Convert actions to float64, shape (count, columns); motions are clipped to [-1, 1] later.

    Args:
        actions: As the agent gives them, shape (count, columns), or (count,) if they are discrete.
        count: How many robots; None for one whose action comes without that axis.
        parameters: Parameters of the environment: what an action is.
        active: Whose are looked at, bool, shape (count,), those of the others may be any numbers;
            None: all.

    Raises:
        InputError: the shape is another, a number is not finite, a declaration or belief is
            outside of [-1, 1], or there is no such action; of many the first bad one is named.
    """
    try:
        array = np.asarray(actions)
    except (TypeError, ValueError) as error:
        raise InputError(f"action is {_short(actions)}; give numbers.") from error
    if array.dtype.kind not in "fiub":
        raise InputError(f"action is {_short(actions)}; give numbers.")
    discrete, columns = parameters.discrete, parameters.columns
    shape = (() if count is None else (count,)) + (() if discrete else (columns,))
    if array.shape != shape:
        raise InputError(
            f"action has the shape {array.shape}; give {shape}: "
            + ("the number of an action." if discrete else _columns(parameters))
        )
    if discrete:
        numbers = array.reshape(-1)
        table = _discrete_actions(parameters)
        good: Bools = (numbers >= 0) & (numbers < len(table))
        if array.dtype.kind not in "iu":
            good = np.zeros(numbers.shape, dtype=np.bool_)
        if not good.all():
            _refuse(numbers, good, count, active, f"a whole number from 0 to {len(table) - 1}")
            numbers = np.where(good, numbers, 0)
        return np.asarray(table[numbers.astype(np.int64)], dtype=np.float64)
    # In C order whatever they are: for any other the kernel would be compiled again.
    chosen = np.array(array, dtype=np.float64, order="C").reshape(-1, columns)
    finite = np.isfinite(chosen)
    if not finite.all():
        _refuse(chosen, np.asarray(finite.all(axis=1)), count, active, "finite numbers, -1 to 1")
    is_valid = np.abs(chosen[:, MOTIONS:]) <= 1.0
    if not is_valid.all():
        remedy = "declarations and belief from -1 to 1"
        _refuse(chosen, np.asarray(is_valid.all(axis=1)), count, active, remedy)
    return chosen


def _discrete_actions(parameters: NavigationParameters) -> Floats:
    """Return the discrete actions as continuous ones, shape (A, columns)."""
    declarations = len(parameters.declare)
    table = np.zeros((len(ACTIONS) + declarations, parameters.columns))
    table[: len(ACTIONS), :MOTIONS] = ACTIONS
    table[len(ACTIONS) :, MOTIONS:] = np.eye(declarations)
    least, most = parameters.min_speed, parameters.robot.max_speed
    table[:, 0] = 2.0 * (table[:, 0] * most - least) / (most - least) - 1.0
    return table


def _columns(parameters: NavigationParameters) -> str:
    """Return the numbers of an action in words."""
    belief = ["nine numbers of the belief"] if parameters.belief else []
    *first, last = ["speed", "turn rate", *(f"{name!r}" for name in parameters.declare), *belief]
    return f"{', '.join(first)} and {last}."


def _refuse(
    rows: NDArray[Any], good: Bools, count: int | None, active: Bools | None, remedy: str
) -> None:
    """Raise if one of the selected actions is invalid, and name it."""
    bad = ~good if active is None else ~good & active
    if bad.any():
        i = int(bad.argmax())
        whose = "" if count is None else f" of robot {i}"
        raise InputError(f"action{whose} is {rows[i].tolist()}; give {remedy}.")


def _short(value: object) -> str:
    """Format a value in one short line."""
    text = " ".join(reprlib.repr(value).split())
    return text if len(text) <= 80 else f"{text[:80]} ..."
