"""Options of `ambinav plan` on stops on the way, and several goals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli.checks import Point, conflict, points_of
from ambinav.cli.plan_options import ResultOptions, SearchOptions
from ambinav.cli.promise_options import PromiseOptions
from ambinav.cli.robot_options import Pose, RobotOptions

if TYPE_CHECKING:
    from ambinav_planners import MissionRoute, RoutePlanner


@dataclass(frozen=True, kw_only=True)
class MissionOptions:
    """Options on stops and goals.

    Attributes:
        via (POINTS): Stops on the way, metres: "20,3 9,21"; repeatable. [default: none]
        any_order: Visit the stops in the order that costs least.
        or_goal (POINTS): Other goals, as --via: the route leads to the one that costs least.
            [default: none]
    """

    PANEL: ClassVar[str] = "Stops and goals"

    via: Annotated[list[str] | None, typer.Option("--via")] = None
    any_order: bool = False
    or_goal: Annotated[list[str] | None, typer.Option("--or-goal")] = None

    @property
    def is_given(self) -> bool:
        """True if there are stops, or other goals."""
        return bool(self.via or self.or_goal)

    @property
    def stops(self) -> list[Point]:
        """Stops in the order given."""
        return _points(self.via, "--via")

    @property
    def other_goals(self) -> list[Point]:
        """Goals beside --goal."""
        return _points(self.or_goal, "--or-goal")

    def check(self, robot: RobotOptions, promise: PromiseOptions, result: ResultOptions) -> None:
        """Check the places, and refuse options that plan from one start to one goal.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        conflict("--any-order", self.any_order and len(self.stops) < 2, "is for two stops or more")
        for option, points in (("--via", self.stops), ("--or-goal", self.other_goals)):
            for reason, holds in (
                ("has no headings, and those matter in other spaces than r2", robot.space != "r2"),
                ("is for a single route, and --pareto shows many", result.pareto),
                ("is not for --max-lost, which plans from a start to a goal", promise.plans),
                ("is not for --certify, whose proof is of one start and goal", result.certify),
            ):
                conflict(option, bool(points) and holds, reason)

    def plan(
        self, robot: RoutePlanner, start: Pose, goal: Pose, search: SearchOptions, weight: float
    ) -> MissionRoute:
        """Plan the mission."""
        from ambinav_planners import Mission, plan_mission

        mission = Mission(
            start, (goal, *self.other_goals), tuple(self.stops), any_order=self.any_order
        )
        return plan_mission(robot, mission, weight=weight, **search.arguments)


def _points(texts: list[str] | None, option: str) -> list[Point]:
    return points_of(" ".join(texts), option, '"20,3 9,21"') if texts else []


def mission_lines(visited: MissionRoute, stops: list[Point]) -> list[str]:
    """Return the printed lines of a mission: stops with their metres, and the goal.

    Args:
        visited: The mission's route.
        stops: Its stops in the order of the visit, by which pictures number them too.
    """
    route = visited.route
    lines = [
        f"stop {k} at ({x:.10g}, {y:.10g}) m: after {metres:.1f} m, {stamp:.1f} s"
        for k, ((x, y), metres, stamp) in enumerate(
            zip(stops, visited.arrivals, _stamps(visited), strict=True), start=1
        )
    ]
    (x, y, _), seconds = route.goal, route.duration or 0.0
    lines.append(f"goal at ({x:.10g}, {y:.10g}) m: after {route.length:.1f} m, {seconds:.1f} s")
    if visited.gap > 0.0:
        lines.append(f"no order costs less by more than {100.0 * visited.gap:.1f} %")
    return lines


def mission_figures(visited: MissionRoute) -> dict[str, Any]:
    """Return what JSON says of a mission: indices count from 0, metres and seconds of the stops."""
    return {
        "order": list(visited.order),
        "arrivals": list(visited.arrivals),
        "stamps": _stamps(visited),
        "goal": visited.goal,
        "gap": visited.gap,
    }


def _stamps(visited: MissionRoute) -> list[float]:
    """Return the seconds at which the robot sets off from each stop, in the order of `order`."""
    from ambinav.routes.evaluate import joints

    stamps = visited.route.stamps
    return [] if stamps is None else stamps[joints(visited.legs)].tolist()
