"""Processing of routes by `ambinav plan`: planning, writing, drawing and printing."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ambinav.cli.limits import not_negative
from ambinav.cli.printing import show, table
from ambinav.forecasting.document import RELIABILITY, plain_bin
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.cli.plan_options import SearchOptions
    from ambinav.cli.speed_options import SpeedOptions
    from ambinav.forecasting.ensemble import Ensemble
    from ambinav.forecasting.forecast import Forecaster
    from ambinav.forecasting.localizer_class import LocalizerClass
    from ambinav.forecasting.reliability import ReliabilityBin
    from ambinav.routes.pareto import ParetoFront
    from ambinav.routes.route import Route
    from ambinav_planners.planning import RoutePlanner
    from ambinav_planners.search.reachability import NoPathError

Pose = tuple[float, float, float]

# Routes that stay this near to each other, metres, are drawn as one in the picture of a front.
SAME_ROUTE = 0.5


@dataclass(frozen=True, eq=False)
class LostFigures:
    """Shares of robots that get lost, by the name of the route.

    Attributes:
        localizer: Class of localizer.
        odometry: Name of the odometry.
        forecast: Forecast share of each.
        driven: Drives; empty if none were asked for.
        reliability: Lost robots on routes forecast like each; empty: not asked for.
    """

    localizer: LocalizerClass
    odometry: str
    forecast: Mapping[str, float]
    driven: Mapping[str, Ensemble]
    reliability: Mapping[str, ReliabilityBin | None] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        routes: Mapping[str, Route],
        forecaster: Forecaster,
        odometry: str,
        driven: Mapping[str, Ensemble],
    ) -> LostFigures:
        """Forecast routes."""
        shares = forecaster.lost_probabilities(list(routes.values())).tolist()
        forecast = dict(zip(routes, shares, strict=True))
        reliability = {name: forecaster.reliability(p) for name, p in forecast.items()}
        return cls(forecaster.localizer, odometry, forecast, driven, reliability)

    def contradiction(self, name: str) -> str:
        """Describe how the drives of a route contradict its forecast; empty: they do not."""
        share, interval = self.forecast[name], self.driven[name].probability
        # As printed: 4.72 % does not contradict 3.3 to 4.7 %.
        if round(interval.low, 3) <= round(share, 3) <= round(interval.high, 3):
            return ""
        return f" That contradicts the forecast of {100.0 * share:.1f} %; rely on the drives."

    def plain(self, name: str) -> dict[str, Any]:
        """Return the figures of a route as plain data."""
        figures: dict[str, Any] = {
            "lost_probability": self.forecast[name],
            RELIABILITY: plain_bin(self.reliability.get(name)),
        }
        if name in self.driven:
            driven = self.driven[name]
            figures["driven"] = {
                "runs": len(driven),
                "lost": int(driven.lost.sum()),
                "lost_low": driven.probability.low,
                "lost_high": driven.probability.high,
                "threshold": driven.threshold,
                "side": driven.side,
            }
        return figures


def write_routes(
    robot: RoutePlanner,
    routes: Mapping[str, Route],
    output: Path,
    picture: Path | None,
    stops: Sequence[tuple[float, float]] = (),
) -> None:
    """Write the first route, and all of them into the picture, with the stops in their order."""
    from ambinav.routes.files import save_route

    if picture is not None:
        from ambinav.plotting.canvas import save_figure
        from ambinav.plotting.routes import plot_routes

        save_figure(plot_routes(robot.service.map, routes, stops=stops), picture)
    save_route(next(iter(routes.values())), output)


def draw_no_path(robot: RoutePlanner, error: NoPathError, picture: Path) -> None:
    """Draw the part of the floor that is connected to the start, and the part of the goal."""
    from ambinav.plotting.canvas import save_figure
    from ambinav.plotting.components import plot_components

    figure = plot_components(
        robot.service.map, error.labels, error.start, error.goal, error.start_label,
        error.goal_label, narrowest=error.narrowest,
    )  # fmt: skip
    save_figure(figure, picture)


def show_routes(
    routes: Mapping[str, Route],
    search: SearchOptions,
    as_json: bool,
    output: Path,
    picture: Path | None,
    lost: LostFigures | None,
    each: Mapping[str, dict[str, float]],
    further: Mapping[str, Any] | None = None,
    lines: Sequence[str] = (),
) -> None:
    """Print the routes' figures as a table or as JSON.

    Args:
        routes: The routes by name.
        search: Planner and its limits.
        as_json: Print JSON.
        output: File of the first route.
        picture: Picture of all of them; None: there is none.
        lost: How many robots get lost; None: that was not asked for.
        each: Further figures of routes, for JSON.
        further: Further members of the JSON: a mission's stops, a route graph.
        lines: The same in words, for the table.
    """
    if as_json:
        document: dict[str, Any] = {"output": str(output)}
        if picture is not None:
            document["picture"] = str(picture)
        if lost is not None:
            document |= {"localizer": lost.localizer.name, "odometry": lost.odometry}
        document |= further or {}
        document["routes"] = {
            name: _figures(route) | ({} if lost is None else lost.plain(name)) | each.get(name, {})
            for name, route in routes.items()
        }
        typer.echo(json.dumps(document, indent=2))
        return
    _print_table(routes, None if lost is None else lost.forecast)
    for line in lines:
        typer.echo(line)
    if lost is not None:
        for name, driven in lost.driven.items():
            typer.echo(f"{name}: {driven.sentence}{lost.contradiction(name)}")
        typer.echo(f"localizer: {lost.localizer.title}; odometry: {lost.odometry}")
    for route in routes.values():
        if route.seed is not None and (route.iterations or 0) < (search.iterations or 0):
            typer.echo(
                f"\nThe time ended after {route.iterations} of {search.iterations} iterations: "
                "with this seed the route may differ next time."
            )
            break
    _print_layer(routes)
    typer.echo(f"route: {output}")
    if picture is not None:
        typer.echo(f"picture: {picture}")


def plan_front(
    robot: RoutePlanner,
    start: Pose,
    goal: Pose,
    search: SearchOptions,
    weights: str | None,
    output: Path,
    as_json: bool,
    forecaster: Forecaster | None,
    speed: SpeedOptions,
) -> None:
    """Plan a route for every weight; write pareto.csv, pareto.json, routes and two pictures.

    With a forecaster each has the share of robots forecast to get lost.

    Raises:
        InputError: the weights are no numbers, the folder holds something else, or what planning
            refuses.
    """
    from ambinav.plotting.canvas import save_figure
    from ambinav.plotting.pareto import plot_pareto
    from ambinav.plotting.routes import plot_routes
    from ambinav.routes.files import save_route
    from ambinav.routes.pareto import FOLDER, ParetoFront
    from ambinav.runtime.files import replacing
    from ambinav_planners.fronts import WEIGHTS, pareto

    chosen = WEIGHTS if weights is None else _weights(weights)
    FOLDER.check(output)
    front = pareto(robot, start, goal, weights=chosen, **search.arguments)
    routes, creep = speed.timed(
        {_name(point.weight): point.route for point in front.points}, robot, forecaster
    )
    pairs = zip(front.points, routes.values(), strict=True)
    front = ParetoFront(tuple(replace(point, route=route) for point, route in pairs))
    lost = None
    if forecaster is not None:
        shares = forecaster.lost_probabilities(list(routes.values())).tolist()
        front, lost = front.with_lost(shares), dict(zip(routes, shares, strict=True))
    with replacing(output) as folder:
        folder.mkdir()
        front.save(folder / "pareto.csv")
        front.save(folder / "pareto.json")
        for point in front.points:
            save_route(point.route, folder / f"route-{point.weight:.12g}.csv")
        save_figure(plot_pareto(front), folder / "pareto.png")
        save_figure(plot_routes(robot.service.map, _distinct_routes(front)), folder / "routes.png")
    if as_json:
        rows = front.rows()
        if forecaster is not None:
            for row in rows:
                row[RELIABILITY] = plain_bin(forecaster.reliability(row["lost_probability"]))
        typer.echo(json.dumps({"output": str(output), "points": rows}, indent=2))
        return
    _print_table(routes, lost)
    for line in speed.lines(creep):
        typer.echo(line)
    _print_layer(routes)
    typer.echo(f"front: {output}")


def _distinct_routes(front: ParetoFront) -> dict[str, Route]:
    """Return routes of the front by weight, without near-duplicates of a lower weight."""
    import shapely

    distinct: dict[str, Route] = {}
    lines: list[shapely.LineString] = []
    for point in front.points:
        route = point.route
        line = shapely.LineString(route.steering.dense(route.poses, SAME_ROUTE / 2)[0][:, :2])
        if all(shapely.hausdorff_distance(line, kept_line) > SAME_ROUTE for kept_line in lines):
            distinct[_name(point.weight)] = route
            lines.append(line)
    return distinct


def _name(weight: float) -> str:
    return f"weight {weight:.12g}"


def _weights(text: str) -> list[float]:
    try:
        # As files and routes are named by them.
        weights = [float(f"{float(part):.12g}") for part in text.replace(",", " ").split()]
    except ValueError:
        raise InputError(
            f"--weights: {text!r} is not a list of numbers; give e.g. '0 1 5'."
        ) from None
    for weight in weights:
        not_negative("5", "numbers").check(weight, "--weights")
    return list(dict.fromkeys(weights))


def _figures(route: Route) -> dict[str, Any]:
    from ambinav.routes.record import figures

    return figures(route).model_dump(mode="json")


def _print_layer(routes: Mapping[str, Route]) -> None:
    """Print the layer that costs and exposures refer to."""
    typer.echo(f"\nlayer: {next(iter(routes.values())).layer}")


def _print_table(routes: Mapping[str, Route], lost: Mapping[str, float] | None = None) -> None:
    from ambinav.routes.bad_floor import IN_BRACKETS, BadFloor, unexplored_note

    floors = {name: BadFloor.of(route) for name, route in routes.items()}
    rows = (
        (
            name,
            f"{route.length:.2f} m",
            f"{route.cost:.2f} m",
            f"{route.exposure:.2f} m",
            floors[name].corridor_text(),
            floors[name].open_text(),
            *(() if lost is None else (f"{100.0 * lost[name]:.1f} %",)),
            f"{route.duration or 0.0:.1f} s",
        )
        for name, route in routes.items()
    )
    forecast = () if lost is None else ("forecast",)
    columns = "route", "length", "cost", "exposure", "corridor", "open", *forecast, "time"
    notes = [unexplored_note(floor, name) for name, floor in floors.items()]
    legend = f"corridor, open: metres; {IN_BRACKETS}"
    show(table(columns, rows, left=("route",)), legend, *filter(None, notes))
