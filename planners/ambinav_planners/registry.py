"""Planners by name, and why others are refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.plugins import Registry
from ambinav_planners.problem import Problem

SPACES = ("r2", "se2", "dubins", "reeds-shepp")
SYMMETRIC_SPACES = ("r2", "se2", "reeds-shepp")
"""Those in which the way back is as long as the way there, as some of OMPL's planners need."""


@dataclass(frozen=True)
class Budget:
    """When a planner stops: after so many seconds or iterations, whichever comes first.

    Attributes:
        seconds: Wall clock, above 0, or inf.
        iterations: What one iteration is, the planner says; None for no limit.
        seed: For OMPL's random numbers; None for other ones every time.
    """

    seconds: float = math.inf
    iterations: int | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        """Refuse a budget that nothing can be done with."""
        if not self.seconds > 0.0:
            raise InputError(f"time is {self.seconds:g} s; give a number above 0, e.g. 1.")
        if self.iterations is not None and not (_is_whole(self.iterations) and self.iterations > 0):
            raise InputError(f"iterations is {self.iterations}; give a whole number from 1 on.")
        if self.seed is not None and not (_is_whole(self.seed) and 0 < self.seed < 2**32):
            raise InputError(f"seed is {self.seed}; give a whole number from 1 to 4294967295.")


@dataclass(frozen=True, eq=False)
class Found:
    """What a planner found.

    Attributes:
        poses: Way points, float64, shape (N, 3), or None if it found no way.
        curve: Seconds and cost whenever the cost fell, in order.
        iterations: How many it made, or None if it does not count.
        covariances: Predicted covariance at each pose, shape (N, 3, 3), or None.
        finished: Whether the way is final, so that improving it would spoil what it promises.
        seconds: What it took.
        alternatives: Other routes, as `poses`, that may be cheaper once they are improved.
    """

    poses: NDArray[np.float64] | None
    curve: tuple[tuple[float, float], ...] = ()
    iterations: int | None = None
    covariances: NDArray[np.float64] | None = None
    finished: bool = False
    seconds: float = 0.0
    alternatives: tuple[NDArray[np.float64], ...] = ()


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral)


Solve = Callable[[Problem, Budget], Found]


@dataclass(frozen=True)
class Planner:
    """An entry of the registry.

    Attributes:
        name: What users call it.
        solve: Finds a way.
        text: One line on how it works.
        iteration: What counts as one iteration, or "" if it does not iterate.
        spaces: Kinds of motion that it plans for.
        uses_ompl: Whether OMPL and its random numbers are in it.
        keeps_limit: Whether it can keep a `BadStretchLimit`.
        minimises_cost: Whether it looks for the least cost, and not for something else.
        make: Makes OMPL's planner, if OMPL itself solves with it, else None.
        one_way: Whether it is right where a motion costs more in one direction than in the other.
    """

    name: str
    solve: Solve
    text: str
    iteration: str = ""
    spaces: tuple[str, ...] = SPACES
    uses_ompl: bool = True
    keeps_limit: bool = False
    one_way: bool = True
    minimises_cost: bool = True
    make: Callable[[Any], Any] | None = None


PLANNERS: Final = Registry(
    "planner",
    Planner,
    "ambinav.planners",
    {
        "rrtstar": "ambinav_planners.tree:RRTSTAR",
        "informed-rrtstar": "ambinav_planners.tree:INFORMED_RRTSTAR",
        "sorrtstar": "ambinav_planners.tree:SORRTSTAR",
        "bitstar": "ambinav_planners.tree:BITSTAR",
        "fmt": "ambinav_planners.batch:FMT",
        "bfmt": "ambinav_planners.batch:BFMT",
        "prmstar": "ambinav_planners.roadmap:PRMSTAR",
        "reference": "ambinav_planners.search.reference:REFERENCE",
        "belief": "ambinav_planners.belief.planners:BELIEF",
        "belief-roadmap": "ambinav_planners.belief.planners:BELIEF_ROADMAP",
    },
)
"""All planners.

Seeded plans run in fresh processes, which know our own planners and those of installed plug-ins;
one that is only registered and sets `uses_ompl` can be seeded in the first plan of a process alone.
"""

_NOT_OPTIMISING = "it stops at the first way that it finds and never looks at the cost"
REFUSED = {
    "aorrtc": "OMPL's AORRTC never calls the objective, so it would ignore the ambiguity",
    "prm": "OMPL's PRM deadlocks with an objective written in Python",
    "rrt": _NOT_OPTIMISING,
    "rrtconnect": _NOT_OPTIMISING,
    "kpiece1": _NOT_OPTIMISING,
    "bkpiece1": _NOT_OPTIMISING,
    "lbkpiece1": _NOT_OPTIMISING,
}
"""OMPL's other geometric planners, by their name in lower case, and why they are not offered."""


def planners() -> dict[str, Planner]:
    """All planners by name."""
    return {name: PLANNERS.get(name) for name in PLANNERS.names()}


def planner(name: str) -> Planner:
    """The planner of a name.

    Raises:
        InputError: there is none, or it is refused; the message says why.
    """
    known = PLANNERS.names()
    reason = REFUSED.get(name.lower().replace("-", "").replace("_", ""))
    if reason is not None and name not in known:
        raise InputError(
            f"planner {name!r} is refused: {reason}; give one of {', '.join(sorted(known))}."
        )
    return PLANNERS.get(name)


def check_suits(chosen: Planner, problem: Problem, budget: Budget) -> None:
    """Refuse a planner that would solve another problem than this one, or would never end.

    Raises:
        InputError: nothing limits it, it does not plan in this space, cannot keep the limit, or
            would be wrong about costs that differ by direction.
    """
    if chosen.uses_ompl and math.isinf(budget.seconds) and budget.iterations is None:
        raise InputError("neither time nor iterations limits the planner; give one of them.")
    space = problem.steering.space
    if space not in chosen.spaces:
        able = ", ".join(chosen.spaces)
        raise InputError(f"planner {chosen.name!r} does not plan in {space}; it knows {able}.")
    if problem.limit is not None and not chosen.keeps_limit:
        able = ", ".join(sorted(p.name for p in planners().values() if p.keeps_limit))
        raise InputError(
            f"planner {chosen.name!r} cannot keep a limit on metres in a row; give one of {able}."
        )
    if space == "r2" and problem.service.has_headings and not chosen.one_way:
        able = ", ".join(sorted(p.name for p in planners().values() if p.one_way))
        raise InputError(
            f"planner {chosen.name!r} takes a motion in r2 to cost the same both ways, which it "
            f"does not on a map with headings; give one of {able}, or the space se2."
        )
