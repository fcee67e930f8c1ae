"""Descriptions of the parameters of a map or a comparison: unit and one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from ambinav.reports.pages import cell

MAP: Final = {
    "spacing": ("m", "Distance between cell centres."),
    "radius": ("m", "Radius around a pose within which scans are compared."),
    "map_std": ("m", "Standard deviation of a wall's position; adds to the sensor's."),
    "tau": ("beams", "Number of beams that carry one independent piece of evidence."),
    "sigma_theta": ("rad", "Standard deviation of the heading that is known beforehand."),
    "outlier_share": ("", "Share of beams that hit objects that are not in the map."),
    "low": ("", "Relative ambiguity radii up to this are small."),
    "high": ("", "Relative ambiguity radii from this are large."),
    "robot_radius": ("m", "Radius of the robot's body; poses at which it collides are left out."),
    "headings": ("", "Number of headings of the map; none if the heading does not matter."),
    "beams_used": ("", "Number of beams of a scan that are used."),
    "beams": ("", "Number of beams of a scan."),
    "free_poses": ("", "Number of cells in which a robot can be."),
    "off_centre": ("m", "Distance by which the beams were moved to the robot's centre."),
    "layer": ("", "Layer of costs and exposure; default: the map's cost layer."),
    "layers": ("", "Additional layers of the map."),
    "cost_layer": ("", "Default layer of costs and rewards."),
}  # fmt: skip
"""Parameters of a map: unit and sentence by name."""

_TABLES: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "space": {
        "extrude": ("m", "Height of the walls of a plan, between a floor and a ceiling."),
        "in_space": ("", "True if the building has the heights of its file."),
        "robot_height": ("m", "Height of the robot; anything lower is an obstacle."),
        "floor": ("m", "z of the floor of a mesh."),
        "up": ("", "Upward axis of a mesh."),
    },
    "map": MAP,
    "robot": {
        "radius": ("m", "Radius of the robot's disc."),
        "max_speed": ("m/s", "Maximum speed, forwards and backwards."),
        "max_turn_rate": ("rad/s", "Maximum turn rate."),
        "acceleration": ("m/s²", "Maximum acceleration and deceleration."),
        "turn_acceleration": ("rad/s²", "Maximum angular acceleration and deceleration."),
    },
    "planning": {
        "space": ("", "State space of the robot: r2 holonomic, se2, dubins or reeds-shepp."),
        "turning_radius": ("m", "Turning radius, only for dubins and reeds-shepp."),
        "planner": ("", "Planner of routes that name none."),
        "iterations": ("", "Iterations of the planner; no time limit, so routes are reproducible."),
        "seed": ("", "Seed of the planner's random numbers."),
        "margin": ("m", "Distance from walls in addition to the robot's radius."),
    },
    "routes": {"": ("", "The compared routes, with their planners and weights.")},
    "pairs": {"": ("m, °", "Starts and goals.")},
    "drive": {
        "runs": ("", "Number of drives per route."),
        "seed": ("", "Run k of every route has the same seed."),
        "open_loop": ("", "True if the robot stays on its route, whatever its estimate."),
        "rate": ("1/s", "Steps of the simulation per second."),
        "start_std": ("m", "Standard deviations of x and y of the first estimate."),
        "start_heading_std_deg": ("°", "Standard deviation of its heading."),
        "max_time": ("s", "Longest run; default: three times that of the route, plus 10 s."),
    },
    "odometry": {
        "alpha1": ("", "Error of turns by turning, as in AMCL."),
        "alpha2": ("1/m²", "Error of turns by driving."),
        "alpha3": ("", "Error of the distance by driving."),
        "alpha4": ("m²", "Error of the distance by turning."),
        "scale": ("", "Factor on the deviations given by the alphas."),
        "distance": ("m", "Distance between updates to which the alphas refer."),
        "angle": ("rad", "Turn on the spot between updates to which the alphas refer."),
        "bias_distance": ("", "Relative systematic error of every reported distance."),
        "bias_turn": ("rad/m", "Systematic drift of the heading to the left."),
    },
    "people": {
        "count": ("", "Number of people who walk around and block beams."),
        "radius": ("m", "Radius of a person's disc."),
        "speed": ("m/s", "Speed of a person."),
    },
    "obstacles": {
        "count": ("", "Number of boxes that are in the building but not in the map."),
        "sizes": ("m", "Smallest and largest edge of a box."),
        "seed": ("", "Seed of their positions."),
        "margin": ("m", "Distance between a box and the robot on any route of the pair."),
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
