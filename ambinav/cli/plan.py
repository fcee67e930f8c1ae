"""`ambinav plan`: routes over an ambiguity map."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.planned import Asked, draw_no_way, plan_front, show_routes, write_routes
from ambinav.cli.running import above_zero, check_file, check_writable, not_negative, reporting
from ambinav.errors import InputError

if TYPE_CHECKING:
    from ambinav_planners.belief.place_search import BeliefModel

PICTURES = (".png", ".pdf", ".svg")

Point = tuple[float, float]

UNHEARD = {
    "--max-std": "is for the planners belief and belief-roadmap",
    "--start-std": "is for the planners belief and belief-roadmap",
    "--odometry-scale": "is for the planners belief and belief-roadmap",
    "--clearance-weight": "is no part of what the belief planners minimise",
    "--weights": "is for --pareto",
    "--headings": "is for spaces other than r2, where the robot faces along its way",
    "--radius": "is for a disc, and --footprint gives another outline",
    "--turning-radius": "is for the spaces dubins and reeds-shepp",
    "--shortest": "is what --pareto begins with",
    "--picture": "is what --pareto draws by itself",
}
"""Why an option means nothing beside the others."""


def _list_planners(wanted: bool) -> None:
    if not wanted:
        return
    with reporting():
        _need_ompl()
        from ambinav_planners import planners

        for name, entry in sorted(planners().items()):
            typer.echo(f"{name:18} {entry.text} [{', '.join(entry.spaces)}]")
    raise typer.Exit


def _need_ompl() -> None:
    """Say what to install if OMPL is missing.

    Raises:
        InputError: it is.
    """
    from importlib.util import find_spec

    if find_spec("ompl") is None:
        raise InputError('planning needs OMPL; run: pip install "ambinav[planners]"')


def plan(
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="MAP.zarr",
            help="An ambiguity map made by `ambinav map`.",
            show_default=False,
        ),
    ],
    start: Annotated[
        Point, typer.Option("--start", metavar="X Y", help="Metres.", show_default=False)
    ],
    goal: Annotated[
        Point, typer.Option("--goal", metavar="X Y", help="Metres.", show_default=False)
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE|DIR",
            help="The route: .csv, .geojson or .json (like nav_msgs/Path); with --pareto a folder.",
            show_default=False,
        ),
    ],
    planner: Annotated[
        str | None,
        typer.Option(
            "--planner",
            "-p",
            metavar="NAME",
            help="See --list-planners.",
            show_default="reference for a disc in r2, prmstar otherwise and with --iterations",
        ),
    ] = None,
    weight: Annotated[
        float,
        typer.Option("--weight", "-w", help="How many extra metres a metre at level 1 is worth."),
    ] = 5.0,
    time: Annotated[
        float, typer.Option("--time", "-t", metavar="S", help="Time for planning, seconds.")
    ] = 1.0,
    iterations: Annotated[
        int | None,
        typer.Option(
            "--iterations",
            metavar="N",
            help="Stop the planner after so many of its iterations, whatever the time.",
            show_default="no limit",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", help="From 1 on.", show_default="another every time"),
    ] = None,
    layer: Annotated[
        str | None,
        typer.Option(
            "--layer",
            metavar="NAME",
            help="The layer that costs.",
            show_default="as suits the map's scanner: position where its sensors differ, or level",
        ),
    ] = None,
    space: Annotated[
        str,
        typer.Option("--space", metavar="NAME", help="r2, se2, dubins or reeds-shepp."),
    ] = "r2",
    turning_radius: Annotated[
        float,
        typer.Option("--turning-radius", metavar="M", help="For dubins and reeds-shepp, metres."),
    ] = 0.0,
    headings: Annotated[
        Point | None,
        typer.Option(
            "--headings",
            metavar="A B",
            help="At start and goal, degrees counter-clockwise from the map's x axis, for spaces "
            "other than r2.",
            show_default="0 0",
        ),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option("--radius", metavar="M", help="Of a round robot, metres.", show_default="0.2"),
    ] = None,
    footprint: Annotated[
        str | None,
        typer.Option(
            "--footprint",
            metavar="POINTS",
            help='Corners of another outline, robot\'s frame, metres: "0.3,0.2 -0.3,0.2 ...".',
            show_default="a disc",
        ),
    ] = None,
    clearance_weight: Annotated[
        float,
        typer.Option("--clearance-weight", help="Extra metres that a metre along a wall is worth."),
    ] = 0.0,
    comfort: Annotated[
        float, typer.Option("--comfort", metavar="M", help="Walls cost nothing from here on.")
    ] = 0.5,
    avoid_open: Annotated[
        bool, typer.Option("--avoid-open", help="Never enter the open zone.")
    ] = False,
    max_bad_metres: Annotated[
        float | None,
        typer.Option(
            "--max-bad-metres",
            metavar="M",
            help="At most so many metres in a row above --bad-level.",
            show_default="no limit",
        ),
    ] = None,
    bad_level: Annotated[float, typer.Option("--bad-level", help="See --max-bad-metres.")] = 0.5,
    max_std: Annotated[
        float | None,
        typer.Option(
            "--max-std",
            metavar="M",
            help="For belief planners: the largest standard deviation of the position, metres.",
            show_default="no limit",
        ),
    ] = None,
    start_std: Annotated[
        float | None,
        typer.Option(
            "--start-std",
            metavar="M",
            help="For belief planners: the deviation of x and of y at the start, metres.",
            show_default="0.1",
        ),
    ] = None,
    odometry_scale: Annotated[
        float | None,
        typer.Option(
            "--odometry-scale",
            help="For belief planners: the deviations of the odometry's errors by those of AMCL's "
            "default alphas, as `odometry: scale` of a comparison.",
            show_default="0.25",
        ),
    ] = None,
    improve: Annotated[
        bool, typer.Option(help="Shortcut and smooth the route; never raises its cost.")
    ] = True,
    shortest: Annotated[
        bool, typer.Option("--shortest", help="Plan the shortest route as well and show both.")
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture",
            metavar="FILE",
            help="Draw the route on the floor map: .png, .pdf or .svg.",
            show_default="none",
        ),
    ] = None,
    pareto: Annotated[
        bool,
        typer.Option(
            "--pareto", help="Routes for many weights; writes a table, routes and pictures."
        ),
    ] = False,
    weights: Annotated[
        str | None,
        typer.Option(
            "--weights", metavar="LIST", help="For --pareto.", show_default="0 0.5 1 2 3 5 8 12 20"
        ),
    ] = None,
    as_json: options.AsJson = False,
    list_planners: Annotated[
        bool,
        typer.Option(
            "--list-planners",
            callback=_list_planners,
            is_eager=True,
            help="Show the planners and exit.",
        ),
    ] = False,
) -> None:
    """Plan a route that goes around places of bad localization where that is worth the way.

    Example: `ambinav plan office.zarr --start 2 3 --goal 20 8 -o route.csv --picture route.png`
    """
    with reporting():
        _need_ompl()
        if not (math.isinf(time) and time > 0.0 and iterations is not None):
            above_zero(time, "--time", "1", "seconds")
        if space in ("dubins", "reeds-shepp"):
            above_zero(turning_radius, "--turning-radius", "0.5")
        _check_together(
            {
                "--max-std": max_std is None or (planner or "").startswith("belief"),
                "--start-std": start_std is None or (planner or "").startswith("belief"),
                "--odometry-scale": odometry_scale is None or (planner or "").startswith("belief"),
                "--clearance-weight": clearance_weight == 0.0
                or not (planner or "").startswith("belief"),
                "--weights": weights is None or pareto,
                "--headings": headings is None or space != "r2",
                "--radius": radius is None or footprint is None,
                "--turning-radius": turning_radius == 0.0 or space in ("dubins", "reeds-shepp"),
                "--shortest": not (shortest and pareto),
                "--picture": picture is None or not pareto,
            }
        )
        not_negative(weight, "--weight", "5", "a number")
        if start_std is not None:
            not_negative(start_std, "--start-std", "0.1", "metres")
        if odometry_scale is not None:
            not_negative(odometry_scale, "--odometry-scale", "0.25", "a number")
        above_zero(comfort, "--comfort", "0.5")
        not_negative(clearance_weight, "--clearance-weight", "1", "a number")
        if pareto:
            check_writable(output)
        else:
            from ambinav.export.registry import formats

            _check_suffix(output, "--output", tuple(f".{name}" for name in formats("route")))
            check_file(output)
        if picture is not None:
            _check_suffix(picture, "--picture", PICTURES)
            check_file(picture)
        from ambinav.drive.noise import OdometryNoise
        from ambinav.geometry.footprint import Footprint
        from ambinav.maps.ambiguity_map import AmbiguityMap
        from ambinav.service.service import AmbiguityService
        from ambinav_planners import NoWayError, RoutePlanner
        from ambinav_planners.planning import DEFAULT_RADIUS

        service = AmbiguityService(
            AmbiguityMap.open(map_file),
            layer,
            weight,
            clearance_weight=clearance_weight,
            comfort=comfort,
        )
        robot = RoutePlanner(
            service,
            footprint=(
                Footprint.disc(DEFAULT_RADIUS if radius is None else radius)
                if footprint is None
                else Footprint.polygon(_corners(footprint))
            ),
            space=space,
            turning_radius=turning_radius,
            avoid_open=avoid_open,
            max_bad_metres=max_bad_metres,
            bad_level=bad_level,
            belief=_belief(start_std, max_std),
            odometry=None if odometry_scale is None else OdometryNoise(scale=odometry_scale),
        )
        first, last = (0.0, 0.0) if headings is None else map(math.radians, headings)
        here, there = (*start, first), (*goal, last)
        asked = Asked(planner, time, iterations, seed, improve)
        try:
            if pareto:
                plan_front(robot, here, there, asked, weights, output, as_json)
            else:
                routes = {f"weight {weight:g}": asked.plan(robot, here, there, weight)}
                if shortest:
                    routes["shortest"] = asked.plan(robot, here, there, 0.0)
                write_routes(robot, routes, output, picture)
                show_routes(routes, asked, as_json, output, picture)
        except NoWayError as error:
            where = picture or output.with_name(f"{output.stem}-no-way.png")
            draw_no_way(robot, error, here, there, where)
            raise InputError(f"{error} The parts are drawn in {where}.") from None


def _belief(start_std: float | None, max_std: float | None) -> BeliefModel:
    """What belief planners suppose of the robot, as far as options tell."""
    from ambinav_planners.belief.place_search import BeliefModel

    model = BeliefModel(max_std=math.inf if max_std is None else max_std)
    if start_std is None:
        return model
    return replace(model, start_std=(start_std, start_std, model.start_std[2]))


def _check_together(fits: dict[str, bool]) -> None:
    """Refuse options that would be left unheard.

    Raises:
        InputError: there is one.
    """
    for option, fit in fits.items():
        if not fit:
            raise InputError(f"{option} {UNHEARD[option]}; leave it out.")


def _check_suffix(path: Path, name: str, suffixes: tuple[str, ...]) -> None:
    """Check what a file's name ends in.

    Raises:
        InputError: it ends in something else.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(
            f"{name}: {path} ends in {path.suffix or 'nothing'!r}; give a file that ends in "
            f"{', '.join(suffixes)}."
        )


def _corners(text: str) -> list[tuple[float, float]]:
    """Corners of a footprint from "x,y x,y x,y".

    Raises:
        InputError: a corner is not two numbers.
    """
    corners = []
    for part in text.split():
        try:
            x, y = (float(number) for number in part.split(","))
        except ValueError:
            raise InputError(
                f"--footprint: {part!r} is not a corner; give x,y in metres, and blanks between "
                'corners, e.g. "0.3,0.2 -0.3,0.2 -0.3,-0.2 0.3,-0.2".'
            ) from None
        corners.append((x, y))
    return corners
