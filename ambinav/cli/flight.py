"""`ambinav plan --space r3`: routes of flying robots through a volume."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer

from ambinav.cli.checks import (
    check_picture,
    check_replaced,
    check_suffix,
    conflict,
    naming_options,
    option_name,
)
from ambinav.cli.limits import above_zero
from ambinav.cli.plan_options import AUTO, CostOptions, ResultOptions, SearchOptions
from ambinav.cli.printing import show, table
from ambinav.cli.robot_options import RobotOptions
from ambinav.cli.running import check_file
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav_planners import Certificate, FlightRoute

ALLOWED: Final = frozenset(
    {"planner", "time", "iterations", "seed", "improve", "weight", "layer", "robot_radius",
     "half_height", "space", "picture", "certify"}
)  # fmt: skip
"""Options of `ambinav plan` that apply in space."""


def position(name: str, text: str, in_space: bool) -> tuple[float, ...]:
    """Return the coordinates of --start or --goal.

    Raises:
        InputError: they are not two finite numbers, or in space three.
    """
    count, axes = (3, "X Y Z") if in_space else (2, "X Y")
    try:
        numbers = tuple(float(part) for part in text.split())
    except ValueError:
        numbers = ()
    remedy = f"give {name} {axes} in metres"
    if len(numbers) == count:
        if all(map(math.isfinite, numbers)):
            return numbers
        raise InputError(f"{name}: {text!r} is not finite; {remedy}.")
    if len(numbers) in (2, 3):
        remedy += ", as for --space r3" if in_space else "; three are for --space r3"
    raise InputError(f"{name}: {text!r} is not {count} numbers; {remedy}.")


def plan_flight(
    map_file: str,
    ends: tuple[tuple[float, ...], tuple[float, ...]],
    output: Path,
    search: SearchOptions,
    cost: CostOptions,
    robot: RobotOptions,
    result: ResultOptions,
    plane_options: tuple[Any, ...],
    trust: bool,
    as_json: bool,
) -> None:
    """Plan a route through space, write it, draw it and print its figures.

    Args:
        map_file: A volume.
        ends: x, y, z of start and goal, metres.
        output: File of the route.
        search: Planner, time and seed.
        cost: Layer and weight.
        robot: Size of the sphere or cylinder.
        result: Picture.
        plane_options: Groups of options none of which applies in space.
        trust: Does not apply either.
        as_json: Print JSON.

    Raises:
        InputError: an option does not apply in space, or something cannot be used.
    """
    groups = (search, cost, robot, result, *plane_options)
    refused = [
        option_name(field.name)
        for group in groups
        for field in fields(group)
        if field.name not in ALLOWED and getattr(group, field.name) != field.default
    ]
    for option in (*refused, *(["--trust"] if trust else [])):
        conflict(option, True, "is for robots on the floor, not for --space r3")
    search.check()
    cost.check(search)
    above_zero("0.2").check(robot.robot_radius, "--robot-radius")
    from ambinav_planners.flight_route import SUFFIXES

    check_suffix(output, "--output", SUFFIXES)
    check_file(output)
    check_replaced(output)
    check_picture(result.picture)
    from ambinav.maps.ambiguity_volume import AmbiguityVolume
    from ambinav.service.volume_service import VolumeService
    from ambinav_planners import FlightPlanner, certify

    volume = AmbiguityVolume.open(map_file)
    # Of the four the cheapest routes in 5 s, in an office, a flat and a house.
    name = "informed-rrtstar" if search.planner == AUTO else search.planner
    with naming_options(
        "layer",
        "weight",
        "half_height",
        "planner",
        "start",
        "goal",
        "seed",
        radius="--robot-radius",
    ):
        service = VolumeService(volume, cost.layer, cost.weight)
        planner = FlightPlanner(service, radius=robot.robot_radius, half_height=robot.half_height)
        route = planner.plan(*ends, **{**search.arguments, "planner_name": name})
    if result.picture is not None:
        route.draw(result.picture)
    route.save(output)
    _show(
        route, certify(planner, route) if result.certify else None, output, result.picture, as_json
    )


def _show(
    route: FlightRoute, proof: Certificate | None, output: Path, picture: Path | None, as_json: bool
) -> None:
    """Print the figures of a route as a table or as JSON."""
    name, figures = f"weight {route.service.weight:g}", route.figures
    if proof is not None:
        figures |= {"bound": proof.bound, "gap": proof.gap}
    places = {"output": str(output)} | ({} if picture is None else {"picture": str(picture)})
    if as_json:
        typer.echo(json.dumps({**places, "routes": {name: figures}}, indent=2))
        return
    columns = "route", "length", "cost", "mean level", "z from", "to"
    row = (
        name, f"{route.length:.2f} m", f"{route.cost:.2f} m", f"{route.mean_level:.3f}",
        f"{figures['lowest_m']:.2f}", f"{figures['highest_m']:.2f} m",
    )  # fmt: skip
    show(table(columns, [row], left=("route",)))
    typer.echo(f"\nlayer: {route.service.layer}; planner: {route.planner}")
    if proof is not None:
        show(proof.sentence)
    typer.echo(f"route: {output}")
    if picture is not None:
        typer.echo(f"picture: {picture}")
