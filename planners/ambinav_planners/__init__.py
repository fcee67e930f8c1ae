"""OMPL plug-in of ambinav: planners that weigh a route's length against its ambiguity.

The names below are loaded when they are first used: what needs no OMPL is there without it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambinav.runtime.exports import exports

if TYPE_CHECKING:
    from ambinav_planners.benchmark import write_benchmark as write_benchmark
    from ambinav_planners.certificate import Certificate as Certificate
    from ambinav_planners.certificate import certify as certify
    from ambinav_planners.flight import FlightObjective as FlightObjective
    from ambinav_planners.flight import FlightPlanner as FlightPlanner
    from ambinav_planners.flight_file import load_flight as load_flight
    from ambinav_planners.flight_route import FlightRoute as FlightRoute
    from ambinav_planners.fronts import pareto as pareto
    from ambinav_planners.goal import PoseGoal as PoseGoal
    from ambinav_planners.missions import Mission as Mission
    from ambinav_planners.missions import MissionRoute as MissionRoute
    from ambinav_planners.missions import plan_mission as plan_mission
    from ambinav_planners.objective import AmbiguityObjective as AmbiguityObjective
    from ambinav_planners.one_way import OneWayLanes as OneWayLanes
    from ambinav_planners.planning import NotFoundError as NotFoundError
    from ambinav_planners.planning import RoutePlanner as RoutePlanner
    from ambinav_planners.planning import plan as plan
    from ambinav_planners.problem import make_checker as make_checker
    from ambinav_planners.promise import Promise as Promise
    from ambinav_planners.promise import PromiseError as PromiseError
    from ambinav_planners.promise import route_within as route_within
    from ambinav_planners.registry import planners as planners
    from ambinav_planners.replanning import Replan as Replan
    from ambinav_planners.replanning import Replanner as Replanner
    from ambinav_planners.roadmap import Roadmap as Roadmap
    from ambinav_planners.route_graph import RouteGraph as RouteGraph
    from ambinav_planners.search.reachability import NoPathError as NoPathError
    from ambinav_planners.validator import FootprintMotionValidator as FootprintMotionValidator
    from ambinav_planners.validator import FootprintStateValidity as FootprintStateValidity
else:
    __all__, __getattr__, __dir__ = exports(__name__, {"ompl": "planners"})
