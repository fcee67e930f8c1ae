"""OMPL setup for a problem: space, validity, objective, random numbers, and the path found."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Floats
from ambinav_planners.goal import PoseGoal
from ambinav_planners.objective import AmbiguityObjective
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget
from ambinav_planners.spaces import make_space, new_state, pose_reader
from ambinav_planners.validator import FootprintMotionValidator, FootprintStateValidity

# How near to the goal a path must end, metres: the goal itself, OMPL samples it.
GOAL_TOLERANCE = 1e-6
# Motions are checked by the validator; this only bounds what else OMPL might want to sample.
CHECK_STEP = 0.05


@dataclass(frozen=True, eq=False)
class Setup:
    """OMPL's simple setup for a problem, with our objective and validator."""

    simple: og.SimpleSetup
    si: ob.SpaceInformation
    objective: AmbiguityObjective
    steering: Steering


def prepare(problem: Problem, validator: type[ob.MotionValidator] | None = None) -> Setup:
    """Set OMPL up.

    Args:
        problem: The planning problem.
        validator: Another motion validator than the footprint's, made from the space information.
    """
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    space = make_space(problem.steering, problem.bounds)
    simple = og.SimpleSetup(space)
    si = simple.getSpaceInformation()
    simple.setStateValidityChecker(FootprintStateValidity(si, problem.checker))
    si.setStateValidityCheckingResolution(CHECK_STEP / space.getMaximumExtent())
    si.setMotionValidator(
        FootprintMotionValidator(si, problem.checker, both=False)
        if validator is None
        else validator(si)
    )
    si.setup()
    objective = AmbiguityObjective(si, problem.service, steering=problem.steering)
    simple.setOptimizationObjective(objective)
    heading = problem.steering.space != "r2"
    start, goal = (new_state(si, pose, heading) for pose in (problem.start, problem.goal))
    simple.setStartAndGoalStates(start, goal, GOAL_TOLERANCE)
    if problem.steering.space == "se2":  # whose distance counts the yaw, as the cost does not
        simple.setGoal(PoseGoal(si, goal, GOAL_TOLERANCE))
    return Setup(simple, si, objective, problem.steering)


def found_poses(setup: Setup) -> Floats | None:
    """Return OMPL's path as poses, shape (N, 3), or None without an exact solution."""
    if not setup.simple.haveExactSolutionPath():
        return None
    # Copy at once: the path that OMPL returns becomes invalid at the next change of the setup.
    path = og.PathGeometric(setup.simple.getSolutionPath())
    read = pose_reader(setup.steering.space != "r2")
    poses = np.array([read(state) for state in path.getStates()], dtype=np.float64)
    if len(poses) == 1:  # a start within the tolerance of the goal
        poses = np.concatenate([poses, poses])
    return setup.steering.oriented(poses)


@dataclass(eq=False)
class Watch:
    """Stops a planner at its budget, and records each fall of its best cost.

    It is called between OMPL's iterations, in Python, which also is where Ctrl-C gets through.
    """

    budget: Budget
    started: float = field(default_factory=time.perf_counter)
    curve: list[tuple[float, float]] = field(default_factory=list)

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.started

    @property
    def over(self) -> bool:
        """True if the time is over."""
        return self.elapsed >= self.budget.seconds

    def note(self, cost: float) -> None:
        """Record a cost if it is the best so far."""
        if math.isfinite(cost) and (not self.curve or cost < self.curve[-1][1]):
            self.curve.append((self.elapsed, cost))

    def condition(
        self, best: Callable[[], Any], iterations: Callable[[], int]
    ) -> ob.PlannerTerminationCondition:
        """Create a termination condition for a planner that reports best cost and iterations."""
        max_iterations = math.inf if self.budget.iterations is None else self.budget.iterations

        def stop() -> bool:
            self.note(best().value())
            return bool(iterations() >= max_iterations or self.over)

        return ob.PlannerTerminationCondition(stop)
