"""Descriptions of the parameters of a map or a comparison: unit and one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from ambinav.reports.pages import cell

MAP: Final = {
    "spacing": ("m", "Distance between cell centres."),
    "radius": ("m", "How far off the poses are that a pose's scan is compared with."),
    "map_std": ("m", "Standard deviation of a wall's position; adds to the sensor's."),
    "tau": ("beams", "How many beams carry one independent piece of evidence."),
    "sigma_theta": ("rad", "How well the heading is known beforehand."),
    "outlier_share": ("", "Share of the beams that meet what is not on the map."),
    "low": ("", "A relative ambiguity radius up to this is small."),
    "high": ("", "A relative ambiguity radius from this on is large."),
    "robot_radius": ("m", "Of the robot's body: poses at which it collides are left out."),
    "headings": ("", "Number of headings of the map; none where the heading does not matter."),
    "beams_used": ("", "Beams of a scan that took part."),
    "beams": ("", "Beams of a scan."),
    "free_poses": ("", "Cells in which a robot can stand."),
    "off_centre": ("m", "How far the beams were moved to the robot's centre."),
    "layer": ("", "Layer that costs and exposure read; default: the map's own choice."),
    "layers": ("", "Layers that were added to the map."),
    "cost_layer": ("", "Layer that costs and rewards read where nobody names one."),
}  # fmt: skip
"""Parameters of a map: unit and sentence by name."""

_TABLES: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "space": {
        "extrude": ("m", "Height of the walls of a plan, between a floor and a ceiling."),
        "in_space": ("", "Whether the building has the heights of its file."),
        "robot_height": ("m", "Of the robot; what is lower than that stands in its way."),
        "floor": ("m", "z of the floor of a mesh."),
        "up": ("", "Which axis of a mesh is up."),
    },
    "map": MAP,
    "robot": {
        "radius": ("m", "Of the disc that the robot covers."),
        "max_speed": ("m/s", "Forwards as well as backwards."),
        "max_turn_rate": ("rad/s", "Fastest turn."),
        "acceleration": ("m/s²", "Of gaining speed and of braking."),
        "turn_acceleration": ("rad/s²", "Of beginning and ending a turn."),
    },
    "planning": {
        "space": ("", "How the robot moves: r2 holonomic, se2, dubins or reeds-shepp."),
        "turning_radius": ("m", "Of a car; for dubins and reeds-shepp only."),
        "planner": ("", "Planner of the routes that name none."),
        "iterations": ("", "Of the planner; without a limit of time, so that routes repeat."),
        "seed": ("", "Of the planner's randomness."),
        "margin": ("m", "Kept off walls in addition to the robot's radius."),
    },
    "routes": {"": ("", "The routes that were compared, with their planners and weights.")},
    "pairs": {"": ("m, °", "Starts and goals.")},
    "drive": {
        "runs": ("", "How often each route was driven."),
        "seed": ("", "Run k of every route has the same seed."),
        "open_loop": ("", "Whether the robot was kept on its route, whatever it believed."),
        "rate": ("1/s", "Steps of the simulation a second."),
        "start_std": ("m", "Standard deviations of x and y of the first estimate."),
        "start_heading_std_deg": ("°", "Standard deviation of its heading."),
        "max_time": ("s", "A run ends then; default: three times what the route needs, and 10 s."),
    },
    "odometry": {
        "alpha1": ("", "Error of turns by turning, as in AMCL."),
        "alpha2": ("1/m²", "Error of turns by driving."),
        "alpha3": ("", "Error of the distance by driving."),
        "alpha4": ("m²", "Error of the distance by turning."),
        "scale": ("", "The robot's errors as a multiple of what the alphas say."),
        "distance": ("m", "Travelled between updates to which the alphas refer."),
        "angle": ("rad", "The same for turns on the spot."),
        "bias_distance": ("", "Share by which every distance is reported too long."),
        "bias_turn": ("rad/m", "Drift of the heading to the left."),
    },
    "people": {
        "count": ("", "People who walk about and block beams."),
        "radius": ("m", "Of the disc that a person covers."),
        "speed": ("m/s", "Of a person."),
    },
    "obstacles": {
        "count": ("", "Boxes that stand in the building but not in the map."),
        "sizes": ("m", "Least and greatest edge of a box."),
        "seed": ("", "Of their places."),
        "margin": ("m", "Between a box and the robot on any of the pair's routes."),
    },
    "localizer": {"": ("", "A parameter of the localizer, by its program's name for it.")},
    "follower": {
        "": ("", "A parameter of nav2's regulated pure pursuit, in metres, seconds and radians.")
    },
}  # fmt: skip
"""Parameters of a comparison by group; the name "" covers all unnamed ones of a group."""


@dataclass(frozen=True)
class Parameter:
    """A parameter as a report shows it.

    Attributes:
        name: Name, after its group and a dot if it has one.
        value: Formatted value.
        unit: Unit of the value; empty if it has none.
        text: Description in a sentence; empty if only its name is known.
    """

    name: str
    value: str
    unit: str
    text: str


def map_parameters(parameters: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return the parameters of a map."""
    return tuple(_parameter(name, name, value, MAP) for name, value in parameters.items())


def scenario_parameters(parameters: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return the parameters of a comparison, those of a group one by one."""
    return tuple(_of_groups(parameters))


def _of_groups(parameters: Mapping[str, Any]) -> Iterator[Parameter]:
    for group, values in parameters.items():
        table = _TABLES.get(group, {})
        if not isinstance(values, Mapping):
            yield _parameter(group, "", values, table)
            continue
        for name, value in values.items():
            yield _parameter(f"{group}.{name}", name, value, table)


def _parameter(
    shown: str, name: str, value: object, table: Mapping[str, tuple[str, str]]
) -> Parameter:
    unit, text = table.get(name, table.get("", ("", "")))
    shown_value = "none" if name == "headings" and value is None else cell(value)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    number = number or (isinstance(value, list | tuple) and name != "")
    return Parameter(shown.replace("_", " "), shown_value, unit if number else "", text)
