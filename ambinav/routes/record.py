"""Route as plain data: the fields of its files, and their checks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Final, Literal, TypeVar

import numpy as np
from pydantic import Field

from ambinav.config import ConfigModel, NonNegative, Number
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, NOT_FREE, OPEN, TRANSITION, ZONES
from ambinav.routes.clock import SpeedLimits
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError

FORMAT: Final = "ambinav-route/1"

Value = TypeVar("Value")
Zone = Literal["localizable", "transition", "corridor", "open", "unexplored"]


class Figures(ConfigModel):
    """Fields of a route file, all but the poses. See `Route` for meanings."""

    format: Literal["ambinav-route/1"] = FORMAT
    planner: str
    seed: int | None
    environment: str
    scanner: str
    space: str
    turning_radius_m: Number
    layer: str
    weight: NonNegative
    power: NonNegative
    clearance_weight: NonNegative
    comfort_m: NonNegative
    length_m: NonNegative
    cost: NonNegative
    exposure_m: NonNegative
    localizable_m: NonNegative
    transition_m: NonNegative
    corridor_m: NonNegative
    open_m: NonNegative
    unexplored_m: NonNegative = 0.0
    longest_bad_m: NonNegative
    longest_corridor_m: NonNegative
    longest_open_m: NonNegative
    turn_rad: NonNegative
    duration_s: NonNegative | None = None
    speed_limits: SpeedLimits | None = None
    seconds: NonNegative
    first_seconds: NonNegative | None
    iterations: int | None
    curve: tuple[tuple[NonNegative, NonNegative], ...]


class Waypoint(ConfigModel):
    """Pose of a route."""

    x: Number
    y: Number
    theta: Number
    distance: NonNegative
    cost: NonNegative
    level: NonNegative
    zone: Zone
    stamp: NonNegative | None = Field(default=None, description="seconds from the start")
    covariance: tuple[Number, Number, Number, Number, Number, Number] | None = Field(
        default=None, description="xx, xy, x theta, yy, y theta, theta theta"
    )


_UPPER: Final = np.triu_indices(3)
_CODES: Final[dict[Zone, int]] = {
    "localizable": LOCALIZABLE,
    "transition": TRANSITION,
    "corridor": CORRIDOR,
    "open": OPEN,
    "unexplored": NOT_FREE,
}
_SAME: Final = {field.name for field in fields(Route)} & set(Figures.model_fields)
"""Fields that are called the same in a file."""
_NAMES: Final = {code: name for name, code in _CODES.items()}


def figures(route: Route) -> Figures:
    """Return the figures of a route.

    Raises:
        InputError: nobody has measured it.
    """
    _check_measured(route)
    return Figures.model_validate(
        {name: getattr(route, name) for name in _SAME}
        | {f"{name}_m": metres for name, metres in route.zone_metres.items()}
        | {
            "space": route.steering.space,
            "turning_radius_m": route.steering.radius,
            "comfort_m": route.comfort,
            "length_m": route.length,
            "exposure_m": route.exposure,
            "unexplored_m": route.unexplored_metres,
            "longest_bad_m": route.longest_bad,
            "longest_corridor_m": route.longest_corridor,
            "longest_open_m": route.longest_open,
            "turn_rad": route.turn,
            "duration_s": route.duration,
        }
    )


def _check_measured(route: Route) -> None:
    if math.isnan(route.length):
        raise InputError("the route is not measured; `evaluate_route` measures it on a map.")


def waypoints(route: Route) -> Iterator[Waypoint]:
    """Yield the poses of a route in order.

    Raises:
        InputError: nobody has measured it.
    """
    _check_measured(route)
    for i, (x, y, theta) in enumerate(route.poses.tolist()):
        covariance = None if route.covariances is None else route.covariances[i][_UPPER].tolist()
        yield Waypoint(
            x=x,
            y=y,
            theta=theta,
            distance=float(route.distance[i]),
            cost=float(route.spent[i]),
            level=float(route.levels[i]),
            zone=_NAMES[int(route.zones[i])],
            stamp=None if route.stamps is None else float(route.stamps[i]),
            covariance=covariance,
        )


def route_of(saved: Figures, points: list[Waypoint], where: str) -> Route:
    """Build the route from the figures and poses of a file.

    Raises:
        InputError: fewer than two poses, only some with a covariance or a stamp, stamps that fall,
            or an unusable steering.
    """
    if len(points) < 2:
        raise InputError(
            f"{where}: it has {len(points)} of the poses of a route; it needs two or more."
        )
    covariance_values = _all_or_none("covariance", [point.covariance for point in points], where)
    stamps = _all_or_none("stamp", [point.stamp for point in points], where)
    falls = np.flatnonzero(np.diff(stamps) < 0.0)
    if len(falls):
        before, after = stamps[falls[0] : falls[0] + 2]
        raise InputError(
            f"{where}: the stamp of pose {falls[0] + 1} is {after:g} s, after {before:g} s; "
            "give stamps that never fall."
        )
    try:
        steering = Steering(saved.space, saved.turning_radius_m)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    covariances = None
    if covariance_values:
        covariances = np.empty((len(covariance_values), 3, 3))
        covariances[:, _UPPER[0], _UPPER[1]] = covariance_values
        covariances[:, _UPPER[1], _UPPER[0]] = covariance_values
    return Route(
        poses=np.array([(point.x, point.y, point.theta) for point in points]),
        steering=steering,
        **{name: getattr(saved, name) for name in _SAME},
        comfort=saved.comfort_m,
        length=saved.length_m,
        exposure=saved.exposure_m,
        zone_metres={name: getattr(saved, f"{name}_m") for name in ZONES},
        unexplored_metres=saved.unexplored_m,
        longest_bad=saved.longest_bad_m,
        longest_corridor=saved.longest_corridor_m,
        longest_open=saved.longest_open_m,
        turn=saved.turn_rad,
        distance=np.array([point.distance for point in points]),
        spent=np.array([point.cost for point in points]),
        levels=np.array([point.level for point in points]),
        zones=np.array([_CODES[point.zone] for point in points], dtype=np.uint8),
        covariances=covariances,
        stamps=np.array(stamps) if stamps else None,
    )


def _all_or_none(name: str, values: list[Value | None], where: str) -> list[Value]:
    """Return the values of all poses, or none.

    Raises:
        InputError: only some have one.
    """
    present = [value for value in values if value is not None]
    if present and len(present) < len(values):
        raise InputError(
            f"{where}: only {len(present)} of {len(values)} poses have a {name}; "
            "give it for all or for none."
        )
    return present
