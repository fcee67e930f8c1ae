"""The `info` of a step, for one robot as plain values and for many as arrays with masks."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambinav.runtime.array_types import Bools, Floats
from ambinav_envs.simulation.layout import (
    ARRIVED,
    ESTIMATE,
    FIGURES,
    FIRST_FIGURE,
    ODOMETRY,
    OUTCOMES,
    RUNNING,
    TERMS,
    TIMEOUT,
    TRUE_POSE,
    VALUES,
    WEIGHTED,
)
from ambinav_envs.simulation.outcome import Outcome
from ambinav_envs.simulation.simulation import Simulation

Info = dict[str, Any]

_NAMES = np.array(OUTCOMES, dtype=object)
_TERM_MASKS = tuple(f"_{term}" for term in TERMS)
_POSES = (("true_pose", TRUE_POSE), ("estimate", ESTIMATE), ("odometry", ODOMETRY))
# Entries that every step and reset have.
_MASKS = tuple(
    f"_{key}"
    for key in (
        "terms", "reward_terms", *FIGURES, "lost", "was_lost", "true_pose", "estimate", "odometry",
    )
)  # fmt: skip


def ends(simulation: Simulation, active: Bools | None) -> tuple[Bools, Bools]:
    """Return which episodes terminated and which were truncated, shape (N,) each."""
    outcome = simulation.state["outcome"]
    terminated, truncated = (outcome != RUNNING) & (outcome != TIMEOUT), outcome == TIMEOUT
    if active is not None:
        terminated &= active
        truncated &= active
    return terminated, truncated


def info_of_all(simulation: Simulation, out: Outcome, done: Bools) -> Info:
    """Return arrays with one entry a robot, each with its mask (`_key`), as Gymnasium expects.

    | key | meaning |
    |---|---|
    | terms | each term of the reward as it is, by name |
    | reward_terms | the same times their weights: they sum to the reward |
    | cost_collision, cost_lost, cost | 1 in a step that ends in a collision, or in which the \
robot is lost; their sum |
    | error | distance of the estimate from the truth, metres |
    | exposure, travelled | so far, metres |
    | shortest | length of the shortest path from start to goal, metres |
    | lost, was_lost | now; ever in the episode |
    | true_pose, estimate, odometry | x, y, theta |
    | outcome, is_success | in the last step only |

    Args:
        simulation: After a step or a reset.
        out: Result of the step or reset.
        done: Robots whose episode has just ended, bool, shape (N,).
    """
    state, figures = simulation.state, out.figures.T
    everyone = np.ones(simulation.count, dtype=np.bool_)
    info: Info = {
        "terms": _named(figures[VALUES:], out.plugged.terms, everyone),
        "reward_terms": _named(figures[WEIGHTED:], out.plugged.weighted, everyone),
        **dict(zip(FIGURES, figures[FIRST_FIGURE:], strict=False)),
        "lost": state["lost"].copy(),
        "was_lost": state["was_lost"].copy(),
        **{name: out.figures[:, first : first + 3] for name, first in _POSES},
    }
    info |= dict.fromkeys(_MASKS, everyone)
    if done.any():
        outcome = state["outcome"]
        names = np.full(simulation.count, None, dtype=object)
        names[done] = _NAMES[outcome[done]]
        info |= {"outcome": names, "_outcome": done.copy()}
        info |= {"is_success": (outcome == ARRIVED) & done, "_is_success": done.copy()}
    return info


def info_of_one(simulation: Simulation, out: Outcome, done: bool) -> Info:
    """Return `info_of_all` of the only robot as plain values, with poses of shape (3,)."""
    state, figures = simulation.state[0], out.figures[0].tolist()
    info: Info = {
        "terms": dict(zip(TERMS, figures[VALUES:], strict=False)) | _first(out.plugged.terms),
        "reward_terms": dict(zip(TERMS, figures[WEIGHTED:], strict=False))
        | _first(out.plugged.weighted),
        **dict(zip(FIGURES, figures[FIRST_FIGURE:], strict=False)),
        "lost": bool(state["lost"]),
        "was_lost": bool(state["was_lost"]),
        **{name: out.figures[0, first : first + 3] for name, first in _POSES},
    }
    if done:
        info["outcome"] = OUTCOMES[int(state["outcome"])]
        info["is_success"] = bool(state["outcome"] == ARRIVED)
    return info


def part_of(info: Info, mask: Bools) -> Info:
    """Return a copy of an info for some robots only; others get zeros (None, False)."""
    part: Info = {}
    for key, value in info.items():
        if isinstance(value, dict):
            part[key] = part_of(value, mask)
        elif key.startswith("_"):
            part[key] = value & mask
        else:
            fresh = np.zeros_like(value)
            if value.dtype == object:
                fresh[:] = None
            fresh[mask] = value[mask]
            part[key] = fresh
    return part


def _named(rows: Floats, plugged: dict[str, Floats], everyone: Bools) -> Info:
    terms: Info = dict(zip(TERMS, rows, strict=False)) | plugged
    return terms | dict.fromkeys((*_TERM_MASKS, *(f"_{term}" for term in plugged)), everyone)


def _first(plugged: dict[str, Floats]) -> dict[str, float]:
    return {name: float(values[0]) for name, values in plugged.items()}
