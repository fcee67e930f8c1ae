"""Planners by name, and checks that a planner suits a problem."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from numbers import Integral
from typing import Any, Final

import numpy as np

from ambinav.plugins import Registry
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav_planners.problem import Problem

SPACES = ("r2", "se2", "dubins", "reeds-shepp")
SYMMETRIC_SPACES = ("r2", "se2", "reeds-shepp")
"""Spaces with equally long paths in both directions, as some of OMPL's planners need."""


UNLIMITED: Final = "neither time nor iterations limits the planner; give one of them."
SEEDS = 2**32 - 1
"""Seeds are below it: OMPL takes 32 bits but no 0, for which it gets this number."""


@dataclass(frozen=True)
class Budget:
    """Limit of a planner's run: seconds or iterations, whichever comes first.

    Attributes:
        seconds: Wall clock, above 0, or inf.
        iterations: What one iteration is, the planner says; None for no limit.
        seed: For OMPL's random numbers; None for other ones every time.
        on_path: Called with the waypoints, shape (N, 3), of a path that will be improved; None: by
            nobody.
    """

    seconds: float = math.inf
    iterations: int | None = None
    seed: int | None = None
    on_path: Callable[[Floats], None] | None = None

    def __post_init__(self) -> None:
        """Refuse an unusable budget."""
        if not (isinstance(self.seconds, int | float | np.number) and self.seconds > 0.0):
            raise InputError(f"seconds is {self.seconds!r}; give a number above 0, e.g. 1.")
        if self.iterations is not None and not (_is_whole(self.iterations) and self.iterations > 0):
            raise InputError(f"iterations is {self.iterations}; give a whole number from 1 on.")
        if self.seed is not None and not (_is_whole(self.seed) and 0 <= self.seed < SEEDS):
            raise InputError(f"seed is {self.seed}; give a whole number from 0 to {SEEDS - 1}.")


@dataclass(frozen=True, eq=False)
class PlannerResult:
    """Result of a planner.

    Attributes:
        poses: Waypoints, float64, shape (N, 3), or None if it found no path.
        curve: Seconds and cost whenever the cost fell, in order.
        iterations: Number of iterations, or None if it does not count them.
        covariances: Predicted covariance at each pose, shape (N, 3, 3), or None.
        finished: Whether the path is final, so that improving it would spoil what it promises.
        seconds: Duration, seconds.
        alternatives: Other routes, as `poses`, that may be cheaper once they are improved.
    """

    poses: Floats | None
    curve: tuple[tuple[float, float], ...] = ()
    iterations: int | None = None
    covariances: Floats | None = None
    finished: bool = False
    seconds: float = 0.0
    alternatives: tuple[Floats, ...] = ()


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral)


Solve = Callable[[Problem, Budget], PlannerResult]


@dataclass(frozen=True)
class Planner:
    """An entry of the registry.

    Attributes:
        name: Name of the planner.
        solve: Finds a path.
        text: One line on how it works.
        iteration: What counts as one iteration, or "" if it does not iterate.
        spaces: Kinds of motion that it plans for.
        uses_ompl: Whether OMPL and its random numbers are in it.
        keeps_limit: Whether it can keep a `BadStretchLimit`.
        minimises_cost: Whether it looks for the least cost, and not for something else.
        make: Makes OMPL's planner, if OMPL itself solves with it, else None.
        one_way: Whether it is right where a motion costs more in one direction than in the other.
        uses_budget: Whether it looks at seconds, iterations or seed of its budget.
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
    uses_budget: bool = True


_OWN = {
    "rrtstar": "ambinav_planners.tree:RRTSTAR",
    "informed-rrtstar": "ambinav_planners.tree:INFORMED_RRTSTAR",
    "sorrtstar": "ambinav_planners.tree:SORRTSTAR",
    "bitstar": "ambinav_planners.tree:BITSTAR",
    "fmt": "ambinav_planners.batch:FMT",
    "bfmt": "ambinav_planners.batch:BFMT",
    "prmstar": "ambinav_planners.roadmap:PRMSTAR",
    "reference": "ambinav_planners.reference:REFERENCE",
    "belief": "ambinav_planners.belief.planners:BELIEF",
    "belief-roadmap": "ambinav_planners.belief.planners:BELIEF_ROADMAP",
}

WITHOUT_OMPL = ("reference", "belief")
"""Our own planners that work without OMPL."""

_NEED_OMPL = frozenset(_OWN) - frozenset(WITHOUT_OMPL)

PLANNERS: Final = Registry("planner", Planner, "ambinav.planners", _OWN)
"""All planners.

Seeded plans run in fresh processes, which know our own planners and those of installed plug-ins;
one that is only registered and sets `uses_ompl` can be seeded in the first plan of a process alone.
"""

_NOT_OPTIMISING = "it stops at the first path that it finds and never looks at the cost"
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
    """Return all planners by name; those that need OMPL only where it is installed."""
    names = PLANNERS.names()
    return {name: PLANNERS.get(name) for name in names if has_ompl() or name not in _NEED_OMPL}


def has_ompl() -> bool:
    """Return whether OMPL is installed, without importing it."""
    return find_spec("ompl") is not None


def planner(name: str) -> Planner:
    """Return the planner with this name.

    Raises:
        InputError: there is none, it is refused, or OMPL is missing; the message says why.
    """
    names = PLANNERS.names()
    if not isinstance(name, str):
        raise InputError(f"planner is {name!r}; give one of {', '.join(sorted(names))}.")
    if name in _NEED_OMPL and not has_ompl():
        raise InputError(
            f'planner {name!r} needs OMPL; run: pip install "ambinav[planners]", or give '
            f"{' or '.join(WITHOUT_OMPL)}."
        )
    reason = REFUSED.get(name.lower().replace("-", "").replace("_", ""))
    if reason is not None and name not in names:
        raise InputError(
            f"planner {name!r} is refused: {reason}; give one of {', '.join(sorted(names))}."
        )
    return PLANNERS.get(name)


def check_suits(chosen: Planner, problem: Problem, budget: Budget) -> None:
    """Refuse a planner that would solve another problem than this one, or would never end.

    Raises:
        InputError: nothing limits it, it does not plan in this space, cannot keep the limit, or
            would be wrong about costs that differ by direction.
    """
    if chosen.uses_ompl and math.isinf(budget.seconds) and budget.iterations is None:
        raise InputError(UNLIMITED)
    space = problem.steering.space
    if space not in chosen.spaces:
        able = ", ".join(chosen.spaces)
        raise InputError(f"planner {chosen.name!r} does not plan in {space}; it knows {able}.")
    if problem.limit is not None and not chosen.keeps_limit:
        able = ", ".join(sorted(p.name for p in planners().values() if p.keeps_limit))
        raise InputError(
            f"planner {chosen.name!r} cannot keep a limit on metres in a row; give one of {able}."
        )
    if problem.one_way is not None and (chosen.name != "reference" or problem.limit is not None):
        remedy = "leave the limit on bad metres in a row out"
        if chosen.name != "reference":
            remedy = "give that planner" if space == "r2" else "give the space r2"
        raise InputError(
            f"one-way lanes are kept by the planner 'reference' in r2 alone; {remedy}, or leave "
            "the lanes out."
        )
    if space == "r2" and problem.service.has_headings and not chosen.one_way:
        able = ", ".join(sorted(p.name for p in planners().values() if p.one_way))
        raise InputError(
            f"planner {chosen.name!r} takes a motion in r2 to cost the same both ways, which it "
            f"does not on a map with headings; give one of {able}, or the space se2."
        )
