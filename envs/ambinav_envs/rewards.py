"""The reward: a weighted sum of named terms, and named sets of weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.config import as_number, nearest
from ambinav.plugins import Registry
from ambinav.runtime.errors import InputError
from ambinav_envs.robot_states import Stepped
from ambinav_envs.simulation.layout import TERMS as TERMS


@dataclass(frozen=True, kw_only=True)
class RewardTerm:
    """An entry of the registry.

    Attributes:
        name: Its name in `reward` and `info`.
        unit: Unit of its values: "m", "s", "1" ...
        meaning: Meaning of the term, before its weight.
        function: Its value in a step, shape (n,), of n robots at once; see
            `robot_states.Stepped`. None: it is one of ours, compiled into the step
            (`simulation.step.judge`).
    """

    name: str
    unit: str
    meaning: str
    function: Callable[[Stepped], NDArray[np.generic]] | None = None


_BUILT_IN = {
    "progress": (
        "m",
        "metres by which the path from the true position to the goal became shorter, at the "
        "prices of `ambiguity_weight`: d - gamma d', a difference of potentials as in Ng, Harada "
        "& Russell (1999), which is not 0 at an episode's end: an end is worth more the nearer to "
        "the goal it is",
    ),
    "arrival": ("1", "1 when the estimated pose is at the goal and the true one is near it"),
    "collision": ("1", "-1 when it touches a wall or a box, from the true pose"),
    "missed": ("1", "-1 when the estimated pose is at the goal and the true one is not"),
    "time": ("s", "minus the seconds of the step"),
    "ambiguity": (
        "m",
        "minus the ambiguity map's layer, integrated over the metres of the step between the true "
        "poses",
    ),
    "fisher": ("m^2", "minus the layer `fisher`, likewise"),
    "error": (
        "m^2",
        "minus the distance of the estimated from the true pose in metres times the metres of the "
        "step; privileged",
    ),
    "lost": (
        "s",
        "minus the seconds of the step while the robot is lost, by estimated and true pose; "
        "privileged",
    ),
    "belief": (
        "nat s",
        "the score of the belief in its action times the seconds of the step, see "
        "`simulation.belief.score`; 0 without `NavigationParameters.belief`",
    ),
}


def _built_in(name: str) -> RewardTerm:
    unit, meaning = _BUILT_IN[name]
    return RewardTerm(name=name, unit=unit, meaning=meaning)


REWARD_TERMS: Final = Registry(
    "reward term", RewardTerm, "ambinav.rewards", {name: partial(_built_in, name) for name in TERMS}
)
"""The terms of the reward: ours, which `simulation.step.judge` computes, and those of plug-ins."""

_TASK = {"progress": 0.3, "arrival": 1.0, "collision": 1.0, "missed": 1.0, "time": 0.03}
OF_TIME: Final = 1.0 / 30.0
"""Weight of `belief` as a share of that of `time`: a second of the surest belief, about 20 nats,
earns two thirds of what it costs, so that no robot is paid for standing."""
PRESETS: dict[str, dict[str, float]] = {
    "shortest": _TASK,
    "ambiguity": {**_TASK, "ambiguity": 0.3},
    "fisher": {**_TASK, "fisher": 1.5},
    "error": {**_TASK, "error": 6.0},
    "belief": {**_TASK, "belief": OF_TIME * _TASK["time"]},
}
"""Weights by name; terms that are left out have the weight 0.

The return of an episode is a few units, as learners expect that do not normalise it. Driving at
0.5 m/s a metre costs 0.06 of `time`, a fifth of its `progress`. So with "ambiguity" a metre at
level 1 costs as much as 5 more metres, which is `AmbiguityService`'s default weight, and the
`ambiguity_weight` with which the route of `progress` is the one that this reward asks for. `fisher`
and `error` weigh about as much as that on the whole: in procedural buildings a metre's `fisher` is
a fifth of its `level`. With "belief" an episode of a sure and right localizer gains about 0.5 by
it.
"""


def weights_of(reward: str | Mapping[str, float]) -> dict[str, float]:
    """Return the weight of each term that has one, and of each of `TERMS`.

    Args:
        reward: Name of a preset, or weights by term.

    Raises:
        InputError: a name is unknown (the nearest is offered), or a weight is no finite number.
    """
    if isinstance(reward, str):
        if reward not in PRESETS:
            raise InputError(
                f"reward: the preset {reward!r} is unknown; {nearest(reward, PRESETS)}."
            )
        reward = PRESETS[reward]
    if not isinstance(reward, Mapping):
        raise InputError(f"reward is {reward!r}; give a preset's name or weights by term.")
    terms = REWARD_TERMS.names()
    for term in reward:
        if term not in terms:
            raise InputError(f"reward: the term {term!r} is unknown; {nearest(str(term), terms)}.")
    weights = {term: as_number(weight, f"reward: {term}") for term, weight in reward.items()}
    return {**dict.fromkeys(TERMS, 0.0), **weights}
