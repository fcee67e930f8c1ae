"""A planner: straight on from the start to the goal, where nothing is in between."""

from ambinav_planners.plugin import Planner, PlannerResult


def solve(problem, budget):
    """A route of two poses, or none."""
    poses = problem.steering.oriented(problem.ends)
    free = problem.checker.motions_free(poses[:1], poses[1:]).all()
    return PlannerResult(poses if free else None, finished=True)


PLANNER = Planner("straight", solve, "straight on, or not at all", spaces=("r2",), uses_ompl=False)
