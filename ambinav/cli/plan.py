"""`ambinav plan`: routes on an ambiguity map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambinav.cli import options
from ambinav.cli.flight import plan_flight, position
from ambinav.cli.forecast_options import ForecastOptions
from ambinav.cli.graph_options import GraphOptions
from ambinav.cli.mission_options import MissionOptions
from ambinav.cli.plan_call import PlanCall
from ambinav.cli.plan_options import (
    BeliefOptions,
    CostOptions,
    LimitOptions,
    ResultOptions,
    SearchOptions,
)
from ambinav.cli.promise_options import PromiseOptions
from ambinav.cli.robot_options import FLIGHT, RobotOptions
from ambinav.cli.running import note, reporting
from ambinav.cli.speed_options import SpeedOptions


def _list_planners(is_given: bool) -> None:
    if not is_given:
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
            plan_flight(map_file, ends, output, search, cost, robot, result, unused, trust, as_json)
            return
        call = PlanCall(
            map_file=map_file, output=output, mission=mission, graph=graph, search=search,
            cost=cost, robot=robot, limits=limits, belief=belief, promise=promise,
            forecast=forecast, speed=speed, result=result, trust=trust, as_json=as_json,
        )  # fmt: skip
        status = call.run(position("--start", start, False), position("--goal", goal, False))
        if status:
            raise typer.Exit(status)
