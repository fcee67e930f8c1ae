"""`ambinav plan`: routes on an ambiguity map."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.flight import plan_flight, position
from ambinav.cli.forecast_options import ForecastOptions
from ambinav.cli.graph_options import GraphOptions
from ambinav.cli.mission_options import MissionOptions, mission_figures, mission_lines
from ambinav.cli.plan_options import (
    FLIGHT,
    BeliefOptions,
    CostOptions,
    LimitOptions,
    ResultOptions,
    RobotOptions,
    SearchOptions,
)
from ambinav.cli.planned import LostFigures, draw_no_path, plan_front, show_routes, write_routes
from ambinav.cli.promise_options import PromiseOptions
from ambinav.cli.running import note, reporting
from ambinav.cli.speed_options import SpeedOptions
from ambinav.forecasting.document import ODOMETRY
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from ambinav.forecasting.ensemble import Ensemble
    from ambinav.forecasting.forecast import Forecaster


def _list_planners(wanted: bool) -> None:
    if not wanted:
        return
    with reporting():
        from ambinav_planners.registry import has_ompl, planners

        for name, entry in sorted(planners().items()):
            typer.echo(f"{name:18} {entry.text} [{', '.join(entry.spaces)}]")
        if not has_ompl():
            note('further planners need OMPL; run: pip install "ambinav[planners]".')
    raise typer.Exit


@options.documented
def plan(
    map_file: options.StoredMap,
    start: str,
    goal: str,
    output: Annotated[Path, typer.Option("--output", "-o")],
    mission: MissionOptions,
    graph: GraphOptions,
    search: SearchOptions,
    cost: CostOptions,
    robot: RobotOptions,
    limits: LimitOptions,
    belief: BeliefOptions,
    promise: PromiseOptions,
    forecast: ForecastOptions,
    speed: SpeedOptions,
    result: ResultOptions,
    trust: options.Trust = False,
    as_json: options.AsJson = False,
    list_planners: Annotated[
        bool, typer.Option("--list-planners", callback=_list_planners, is_eager=True)
    ] = False,
) -> None:
    """Plan a route that avoids places of bad localization where the detour is worth it.

    Example: `ambinav plan office.zarr --start 2 3 --goal 20 8 -o route.csv --picture route.png`

    For a flying robot, in a volume of `ambinav map --heights`: `ambinav plan building.zarr --space
    r3 --start 2 3 0.6 --goal 20 8 1.8 -o route.csv`

    Parameters:
        start (X Y [Z]): Position in the map frame, metres; with Z for --space r3.
        goal (X Y [Z]): Position in the map frame, metres; with Z for --space r3.
        output (FILE|DIR): Route file: .csv, .geojson or .json (like nav_msgs/Path); with --pareto a
            folder.
        list_planners: Show the planners and exit.
    """
    with reporting():
        if robot.space == FLIGHT:
            ends = position("--start", start, True), position("--goal", goal, True)
            unused = (mission, graph, limits, belief, promise, forecast, speed)
            plan_flight(map_file, ends, output, search, cost, robot, result, unused, as_json)
            return
        ends = position("--start", start, False), position("--goal", goal, False)
        search.check()
        cost.check(search)
        robot.check()
        belief.check(search, forecast.odometry)
        promise.check(search, cost, result)
        mission.check(robot, promise, result)
        graph.check(search, robot, promise, result, limits, output)
        forecast.check()
        speed.check(search, cost, promise, result)
        result.check(output)
        from ambinav.maps.ambiguity_map import AmbiguityMap
        from ambinav.routes.evaluate import joints
        from ambinav_planners import NoPathError, RoutePlanner, certify

        amap = AmbiguityMap.open(map_file)
        body = robot.arguments()
        services = [cost.service(amap)]
        if speed.least_time:
            services = speed.services(amap, body["footprint"].outer, forecast)
        settings = {
            **body,
            **limits.arguments(),
            **belief.arguments(forecast.odometry),
            **graph.arguments(),
        }
        planners = [RoutePlanner(service, **settings) for service in services]
        planner = planners[0]
        forecaster_of: Callable[..., Forecaster] = partial(
            forecast.forecaster, amap, **belief.of_forecast()
        )
        here, there = robot.ends(*ends)
        weight = planner.service.weight
        try:
            forecaster = None
            if promise.max_lost is not None or (
                result.pareto and (forecast.wanted or speed.wanted)
            ):
                forecaster = forecaster_of()
                promise.check_trust(forecaster.localizer, trust)
            if result.pareto:
                plan_front(
                    planner, here, there, search, result.weights, output, as_json, forecaster,
                    speed,
                )  # fmt: skip
                return
            driven: dict[str, Ensemble] = {}
            halts: dict[str, list[int]] = {}
            visited = None
            if promise.max_lost is not None and forecaster is not None:
                name = f"at most {100.0 * promise.max_lost:g} % lost"
                route, driven[name] = promise.plan(planner, here, there, forecaster, search)
            else:
                name = "least time" if speed.least_time else f"weight {weight:g}"
                plans = [mission.plan(one, here, there, search, weight) for one in planners]
                visited = plans[0]
                if speed.least_time:
                    forecaster = forecaster_of([one.route for one in plans])
                    fastest = speed.fastest(plans, planner, forecaster)
                    planner, visited, forecaster = planners[fastest], plans[fastest], None
                route, halts[name] = visited.route, joints(visited.legs)
            routes = {name: route}
            direct = planner
            if result.shortest:
                if cost.adds_metres:
                    direct = RoutePlanner(cost.of_length.service(amap), **settings)
                shortest = mission.plan(direct, here, there, search, 0.0)
                routes["shortest"], halts["shortest"] = shortest.route, joints(shortest.legs)
        except NoPathError as error:
            where = result.picture or output.with_name(f"{output.stem}-no-path.png")
            draw_no_path(planner, error, where)
            raise InputError(f"{error} The parts are drawn in {where}.") from None
        lost = None
        if forecaster is None and (forecast.wanted or promise.wanted or speed.wanted):
            forecaster = forecaster_of(list(routes.values()))
            promise.check_trust(forecaster.localizer, trust)
        if forecaster is not None:
            if promise.wanted:
                others = {key: other for key, other in routes.items() if key not in driven}
                driven |= promise.drive(planner, others, forecaster, search.seed)
            odometry = belief.odometry_text(forecast.odometry or ODOMETRY)
            lost = LostFigures.of(routes, forecaster, odometry, driven)
        routes, creep = speed.timed(routes, planner, forecaster, halts)
        stops = mission.stops
        figures, lines = graph.finish(planner.priced_graph)
        lines = [*speed.lines(creep), *lines]
        each: dict[str, dict[str, float]] = {
            key: {"creep_m": metres} for key, metres in creep.items()
        }
        for key, seconds in speed.minimised(routes, planner.service).items():
            each[key]["minimised_s"] = seconds
            lines.append(
                f"{key}: planned for {seconds:.1f} s by the errors that localization comes to at "
                "its places; the times above have those along the route, ramps and turns"
            )
        if result.certify:
            for key, planned in routes.items():
                proof = certify(direct if key == "shortest" else planner, planned)
                each.setdefault(key, {}).update(bound=proof.bound, gap=proof.gap)
                lines.append(f"{key}: {proof.sentence}")
        if visited is not None and mission.wanted:
            visited = replace(visited, route=routes[name])
            figures["mission"] = mission_figures(visited)
            stops = [stops[k] for k in visited.order]
            lines = [*mission_lines(visited, stops), *lines]
        write_routes(planner, routes, output, result.picture, stops)
        show_routes(routes, search, as_json, output, result.picture, lost, each, figures, lines)
        if promise.wanted:
            raise typer.Exit(promise.status(driven[name]))
