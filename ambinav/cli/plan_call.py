"""The steps of `ambinav plan` for a robot on the floor, from its options to printed routes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambinav.cli.checks import naming_options
from ambinav.cli.forecast_options import ForecastOptions
from ambinav.cli.graph_options import GraphOptions
from ambinav.cli.mission_options import MissionOptions, mission_figures, mission_lines
from ambinav.cli.plan_options import (
    BeliefOptions,
    CostOptions,
    LimitOptions,
    ResultOptions,
    SearchOptions,
)
from ambinav.cli.planned import LostFigures, draw_no_path, plan_front, show_routes, write_routes
from ambinav.cli.promise_options import PromiseOptions
from ambinav.cli.robot_options import Pose, RobotOptions
from ambinav.cli.speed_options import SpeedOptions
from ambinav.forecasting.document import ODOMETRY
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.forecasting.ensemble import Ensemble
    from ambinav.forecasting.forecast import Forecaster
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.routes.route import Route
    from ambinav_planners import MissionRoute, RoutePlanner

Place = tuple[float, ...]

SHORTEST = "shortest"
"""Name of the route of the least length, beside the wanted one."""


@dataclass(kw_only=True)
class _Planned:
    """Planned routes, the wanted one first.

    Attributes:
        planner: Planner of the wanted route.
        direct: Planner of the shortest one.
        routes: The routes by name.
        halts: Indices of the poses at which the robot stops, by name.
        driven: Drives, by name.
        mission: The mission that the wanted route is of; None: it is planned for a promise.
        forecaster: Forecaster that it was planned with, if any.
    """

    planner: RoutePlanner
    direct: RoutePlanner
    routes: dict[str, Route] = field(default_factory=dict)
    halts: dict[str, list[int]] = field(default_factory=dict)
    driven: dict[str, Ensemble] = field(default_factory=dict)
    mission: MissionRoute | None = None
    forecaster: Forecaster | None = None

    @property
    def route_name(self) -> str:
        """Name of the route that is asked for."""
        return next(iter(self.routes))

    def add(self, name: str, mission: MissionRoute) -> None:
        """Add the route of a mission."""
        from ambinav.routes.evaluate import joints

        self.routes[name], self.halts[name] = mission.route, joints(mission.legs)


@dataclass(frozen=True, kw_only=True)
class PlanCall:
    """A call of `ambinav plan`; its options are described at their classes."""

    map_file: str
    output: Path
    mission: MissionOptions
    graph: GraphOptions
    search: SearchOptions
    cost: CostOptions
    robot: RobotOptions
    limits: LimitOptions
    belief: BeliefOptions
    promise: PromiseOptions
    forecast: ForecastOptions
    speed: SpeedOptions
    result: ResultOptions
    trust: bool
    as_json: bool

    def run(self, start: Place, goal: Place) -> int:
        """Plan, write and print the routes.

        Args:
            start: x and y in the map frame, metres.
            goal: The same.

        Returns:
            The exit status of the command.

        Raises:
            InputError: an option is of no use, or there is no route.
        """
        self._check()
        with naming_options(
            "layer", "weight", "weights", "footprint", "turning_radius", "start", "goal", "seed",
            via=lambda k: f"--via: stop {k + 1}",
            goals=lambda k: f"--or-goal: goal {k}" if k else "--goal",
        ):  # fmt: skip
            return self._run(start, goal)

    def _run(self, start: Place, goal: Place) -> int:
        from ambinav.maps.ambiguity_map import AmbiguityMap
        from ambinav_planners import NoPathError

        amap = AmbiguityMap.open(self.map_file)
        planners = self._planners(amap)
        ends = self.robot.ends(start, goal)
        try:
            if self.result.pareto:
                forecaster = self._forecaster(amap) if self._is_forecast else None
                plan_front(
                    planners[0], *ends, self.search, self.result.weights, self.output,
                    self.as_json, forecaster, self.speed,
                )  # fmt: skip
                return 0
            planned = self._plan(amap, planners, *ends)
        except NoPathError as error:
            where = self.result.picture or self.output.with_name(f"{self.output.stem}-no-path.png")
            draw_no_path(planners[0], error, where)
            message = str(error).replace("avoid_open, keep_out", "--avoid-open, --keep-out")
            raise InputError(f"{message} The parts are drawn in {where}.") from None
        lost = self._forecast_lost(amap, planned)
        self._report(planned, lost)
        if not self.promise.measures_share:
            return 0
        return self.promise.status(planned.driven[planned.route_name])

    @property
    def _is_forecast(self) -> bool:
        """True if errors of the localizer or the share of lost robots are asked for."""
        return self.forecast.is_given or self.promise.measures_share or self.speed.bounds_speed

    def _check(self) -> None:
        """Refuse options that are of no use or contradict each other.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        search, cost, promise, result = self.search, self.cost, self.promise, self.result
        search.check()
        search.check_budget(promise.measures_share)
        cost.check(search)
        self.robot.check()
        self.belief.check(search, self.forecast.odometry)
        promise.check(search, cost, result)
        self.limits.check(search)
        self.mission.check(self.robot, promise, result)
        self.graph.check(search, self.robot, promise, result, self.limits, self.output)
        self.forecast.check()
        self.speed.check(search, cost, promise, result, self.limits)
        result.check(cost, self.output)
        if self._is_forecast and self.belief.start_std == 0.0:
            raise InputError("--start-std: 0 has no forecast; give more, such as 0.001.")

    def _planners(self, amap: AmbiguityMap) -> list[RoutePlanner]:
        """Return a planner for the cost; for the least time several, one of which is faster."""
        from ambinav_planners import RoutePlanner

        if not self.speed.least_time:
            return [RoutePlanner(self.cost.service(amap), **self._settings(amap))]
        settings = self._settings(amap)
        services = self.speed.services(amap, settings["footprint"].outer, self.forecast)
        return [RoutePlanner(service, **settings) for service in services]

    def _settings(self, amap: AmbiguityMap) -> dict[str, Any]:
        """Return settings of the planners but for their costs; some are read from files."""
        return {
            **self.robot.arguments(),
            **self.limits.arguments(amap),
            **self.belief.arguments(self.forecast.odometry),
            **self.graph.arguments(),
        }

    def _forecaster(self, amap: AmbiguityMap, routes: Sequence[Route] = ()) -> Forecaster:
        """Return the forecaster of the localizer on some routes, if it may be driven."""
        around = (list(routes),) if routes else ()
        forecaster = self.forecast.forecaster(amap, *around, **self.belief.of_forecast(self.search))
        self.promise.check_trust(forecaster.localizer, self.trust)
        return forecaster

    def _plan(
        self, amap: AmbiguityMap, planners: Sequence[RoutePlanner], start: Pose, goal: Pose
    ) -> _Planned:
        """Plan the wanted route, and the shortest one if it is asked for."""
        planned = _Planned(planner=planners[0], direct=planners[0])
        weight = planned.planner.service.weight
        if self.promise.max_lost is not None:
            name = f"at most {100.0 * self.promise.max_lost:g} % lost"
            planned.forecaster = self._forecaster(amap)
            planned.routes[name], planned.driven[name] = self.promise.plan(
                planned.planner, start, goal, planned.forecaster, self.search
            )
        else:
            missions = [
                self.mission.plan(planner, start, goal, self.search, weight) for planner in planners
            ]
            name, chosen = f"weight {weight:g}", 0
            if self.speed.least_time:
                forecaster = self._forecaster(amap, [mission.route for mission in missions])
                name = "least time"
                chosen = self.speed.fastest(missions, planned.planner, forecaster)
                planned.planner = planned.direct = planners[chosen]
            planned.mission = missions[chosen]
            planned.add(name, planned.mission)
        if self.result.shortest:
            if self.cost.adds_metres:
                from ambinav_planners import RoutePlanner

                planned.direct = RoutePlanner(
                    self.cost.of_length.service(amap), **self._settings(amap)
                )
            planned.add(SHORTEST, self.mission.plan(planned.direct, start, goal, self.search, 0.0))
        return planned

    def _forecast_lost(self, amap: AmbiguityMap, planned: _Planned) -> LostFigures | None:
        """Forecast and drive the routes, if that is asked for."""
        if not self._is_forecast:
            return None
        if planned.forecaster is None:
            planned.forecaster = self._forecaster(amap, list(planned.routes.values()))
        if self.promise.measures_share:
            undriven = {
                name: route for name, route in planned.routes.items() if name not in planned.driven
            }
            planned.driven |= self.promise.drive(
                planned.planner, undriven, planned.forecaster, self.search.seed
            )
        odometry = self.belief.odometry_text(self.forecast.odometry or ODOMETRY)
        return LostFigures.of(planned.routes, planned.forecaster, odometry, planned.driven)

    def _report(self, planned: _Planned, lost: LostFigures | None) -> None:
        """Stamp, write, draw and print the routes."""
        planner = planned.planner
        routes, creep = self.speed.timed(planned.routes, planner, planned.forecaster, planned.halts)
        figures, lines = self.graph.finish(planner.priced_graph)
        lines = [*self.speed.lines(creep), *lines]
        each: dict[str, dict[str, float]] = {name: {} for name in routes}
        for name, metres in creep.items():
            each[name]["creep_m"] = metres
        for name, seconds in self.speed.minimised(routes, planner.service).items():
            each[name]["minimised_s"] = seconds
            lines.append(
                f"{name}: planned for {seconds:.1f} s, by the error that localization settles to "
                "at each place; the times above use the error along the route, with ramps and turns"
            )
        if self.limits.max_bad_metres is not None:
            from ambinav_planners.search.limit import longest_bad

            level = self.limits.bad_level
            for name, route in routes.items():
                longest = longest_bad(route.poses, planner.service, route.steering, level)
                each[name]["longest_above_level_m"] = longest
                lines.append(f"{name}: at most {longest:.2f} m in a row are above level {level:g}")
        if self.result.certify:
            from ambinav_planners import certify

            for name, route in routes.items():
                proof = certify(planned.direct if name == SHORTEST else planner, route)
                each[name].update(bound=proof.bound, gap=proof.gap)
                lines.append(f"{name}: {proof.sentence}")
        stops = self.mission.stops
        if planned.mission is not None and self.mission.is_given:
            visited = replace(planned.mission, route=routes[planned.route_name])
            figures["mission"] = mission_figures(visited)
            stops = [stops[k] for k in visited.order]
            lines = [*mission_lines(visited, stops), *lines]
        picture = self.result.picture
        write_routes(planner, routes, self.output, picture, stops)
        show_routes(
            routes, self.search, self.as_json, self.output, picture, lost, each, figures, lines
        )
