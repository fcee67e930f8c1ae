"""The state cost in an OMPL program: RRT* weighs metres against ambiguity."""

from ompl import base as ob
from ompl import geometric as og

import ambinav as an
from ambinav_planners import AmbiguityObjective


def plan(service: an.AmbiguityService, environment: an.Environment) -> list[tuple[float, float]]:
    setup = og.SimpleSetup(ob.RealVectorStateSpace(2))
    bounds = ob.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, environment.bounds[axis])
        bounds.setHigh(axis, environment.bounds[axis + 2])
    setup.getStateSpace().setBounds(bounds)
    setup.setStateValidityChecker(lambda s: bool(environment.is_free(s[0], s[1], radius=0.2)))
    si = setup.getSpaceInformation()
    start, goal = si.allocState(), si.allocState()
    start[0], start[1], goal[0], goal[1] = *an.DEMO_START, *an.DEMO_GOAL
    setup.setStartAndGoalStates(start, goal)
    setup.setOptimizationObjective(AmbiguityObjective(si, service))  # the line that counts
    setup.setPlanner(og.RRTstar(si))
    setup.solve(5.0)
    path = og.PathGeometric(setup.getSolutionPath())
    return [(state[0], state[1]) for state in path.getStates()]


building = an.load_environment(an.DEMO_BUILDING)
scanner = an.RangeScanner.from_preset("turtlebot3-lds")
amap = an.build_map(building, scanner, spacing=0.2)
waypoints = plan(an.AmbiguityService(amap, layer="level", weight=5.0), building)
print(f"{len(waypoints)} waypoints to {waypoints[-1]}")
