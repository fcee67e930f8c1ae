"""OMPL plug-in of ambinav: planners that weigh a route's length against its ambiguity.

The names below are loaded when they are first used: what needs no OMPL is there without it.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ambinav_planners.benchmark import write_benchmark
    from ambinav_planners.fronts import pareto
    from ambinav_planners.goal import PoseGoal
    from ambinav_planners.objective import AmbiguityObjective
    from ambinav_planners.planning import NotFoundError, RoutePlanner, plan
    from ambinav_planners.registry import Planner, planners
    from ambinav_planners.roadmap import Roadmap
    from ambinav_planners.search.reachability import NoPathError
    from ambinav_planners.validator import FootprintMotionValidator, FootprintStateValidity

__all__ = [
    "AmbiguityObjective",
    "FootprintMotionValidator",
    "FootprintStateValidity",
    "NoPathError",
    "NotFoundError",
    "Planner",
    "PoseGoal",
    "Roadmap",
    "RoutePlanner",
    "pareto",
    "plan",
    "planners",
    "write_benchmark",
]

_HOME = {
    "AmbiguityObjective": "objective",
    "FootprintMotionValidator": "validator",
    "FootprintStateValidity": "validator",
    "NoPathError": "search.reachability",
    "NotFoundError": "planning",
    "Planner": "registry",
    "PoseGoal": "goal",
    "Roadmap": "roadmap",
    "RoutePlanner": "planning",
    "pareto": "fronts",
    "plan": "planning",
    "planners": "registry",
    "write_benchmark": "benchmark",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its module on first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "ompl":
            raise
        reason = f'{name} needs OMPL; run: pip install "ambinav[planners]".'
        raise ImportError(reason, name=error.name) from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
