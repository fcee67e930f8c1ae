"""The interface of planner plug-ins: their record, the registry, and their arguments."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambinav.runtime.exports import exports

if TYPE_CHECKING:
    from ambinav_planners.problem import Problem as Problem
    from ambinav_planners.registry import PLANNERS as PLANNERS
    from ambinav_planners.registry import Budget as Budget
    from ambinav_planners.registry import Planner as Planner
    from ambinav_planners.registry import PlannerResult as PlannerResult
else:
    __all__, __getattr__, __dir__ = exports(__name__)
