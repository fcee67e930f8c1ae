"""Bound of the precision with which a scan and ranges to beacons fix the pose.

Beacons are named points that a receiver on the robot measures its distance to, as ultra-wideband
anchors. Which beacon a range is of is known, so there is nothing to be mistaken for: a range of
deviation s to a beacon in the direction u tells of x and y by u u^T / s^2, seen from above; of a
beacon that is higher than the receiver by what is level of u alone. The layer is the bound of
`layers.fisher` with these ranges beside the beams.

Our own reading: a beacon is in view if nothing stands on the straight line to it, and otherwise
gives no range. Real radio passes through thin walls and comes out late; such ranges are left out,
as receivers do that detect them. The receiver is taken to be in the robot's centre.
"""

from __future__ import annotations

import warnings
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.ops import nearest_points

from ambinav.config import as_flat, as_number, as_positive
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.layers.fisher import checked_tau, scan_informations
from ambinav.layers.marginal import marginal_radii, prior_deviations
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError, InputWarning

STD: Final = 0.1
"""Standard deviation of a range, metres. For receivers with the DW1000 the manual of Time Domain's
P330 (section 6.4) has an accuracy of 5 to 10 cm in the line of sight."""
MAX_RANGE: Final = 30.0
ON_WALL: Final = 0.1
"""A beacon within a wall by at most so much, metres, hangs on its nearest surface."""
ROUNDING: Final = 1e-6
"""A ray to a beacon on a surface may end before it by so much, metres."""


def range_information(
    environment: Environment,
    x: ArrayLike,
    y: ArrayLike,
    at: ArrayLike,
    *,
    std: float = STD,
    max_range: float = MAX_RANGE,
    receiver: float = 0.0,
) -> tuple[Floats, Bools]:
    """Compute the Fisher information about x and y that ranges to beacons give.

    Args:
        environment: The building, whose walls hide beacons.
        x: Positions, shape (N,), metres, map frame.
        y: The same.
        at: The beacons: x, y and, if their height counts, z above the floor, metres, shape (K, 2)
            or (K, 3).
        std: Standard deviation of a range, metres.
        max_range: Largest distance that is measured, metres.
        receiver: Height of the receiver above the floor, metres; for beacons with heights.

    Returns:
        The information, shape (N, 2, 2), 1 / square metres, map frame; and whether each beacon
        gives a range, shape (N, K).

    Raises:
        InputError: there is no beacon, or a number is out of its range.

    Warns:
        InputWarning: a beacon is within a wall, or outside of the building: it is nowhere in view.
    """
    places, variance, longest, low = _checked(at, std, max_range, receiver)
    _, (px, py) = as_flat(x=x, y=y)
    information = np.zeros((len(px), 2, 2))
    seen = np.zeros((len(px), len(places)), dtype=np.bool_)
    for k, (bx, by, height) in enumerate(places):
        surface = _surface(environment, bx, by)
        dx, dy = bx - px, by - py
        level = np.hypot(dx, dy)
        distance = np.hypot(level, height - low)
        near = np.flatnonzero(distance <= longest)
        if surface is None or not len(near):
            continue
        near = near[_in_view(environment, px[near], py[near], surface)]
        seen[near, k] = True
        # Just below or above a beacon its range says nothing of x and y.
        share = level[near] / np.maximum(distance[near], np.finfo(np.float64).tiny)
        towards = share[:, None] * np.column_stack([dx, dy])[near]
        towards /= np.maximum(level[near], np.finfo(np.float64).tiny)[:, None]
        information[near] += towards[:, :, None] * towards[:, None, :] / variance
    return information, seen


def _surface(environment: Environment, x: float, y: float) -> tuple[float, float] | None:
    """Return the point of the free space that a beacon is at; None: it is too deep in a wall."""
    beacon = shapely.Point(x, y)
    nearest, _ = nearest_points(environment.free, beacon)
    if shapely.distance(nearest, beacon) <= ON_WALL:
        return nearest.x, nearest.y
    warnings.warn(
        f"beacons: ({x:g}, {y:g}) is within a wall or outside of {environment.name} by more than "
        f"{ON_WALL:g} m, and nowhere in view; move it to a surface.",
        InputWarning,
        stacklevel=3,
    )
    return None


def _in_view(environment: Environment, x: Floats, y: Floats, to: tuple[float, float]) -> Bools:
    """Return whether nothing stands between positions, shape (N,), and a point; shape (N,)."""
    dx, dy = to[0] - x, to[1] - y
    away = np.hypot(dx, dy)
    free, _ = environment.cast_hits(x, y, np.arctan2(dy, dx), float(away.max()) + 1.0)
    return free >= away - ROUNDING


def beacons(
    context: LayerContext,
    *,
    at: ArrayLike = (),
    std: float = STD,
    max_range: float = MAX_RANGE,
    receiver: float = 0.0,
    odometry_std: float | None = None,
    heading_std: float | None = None,
    tau: float = 1.0,
) -> dict[str, Floats32]:
    """Compute the radii of the bound's covariance of x and y, with the heading marginalised.

    Args:
        context: What the map was made of; all beams of its scanner are taken.
        at: See `range_information`, like the next three.
        std: See there.
        max_range: See there.
        receiver: See there.
        odometry_std: As for `fisher`, like the next two.
        heading_std: See there.
        tau: See there; of the beams alone.

    Returns:
        beacons, beacons_minor and beacons_alone, from the ranges without the scan (metres),
        beacons_direction (radians) and beacons_in_view (how many).

    Raises:
        InputError: there is no beacon, or a number is out of its range.
    """
    place, turn = prior_deviations(context, odometry_std, heading_std)
    tau = checked_tau(tau)
    x, y = context.points
    of_ranges, seen = range_information(
        context.environment, x, y, at, std=std, max_range=max_range, receiver=receiver
    )
    alone = np.zeros((len(x), 3, 3))
    alone[:, :2, :2] = of_ranges
    radii = np.empty((3, len(x), len(context.headings)))
    for h, part, information in scan_informations(context):
        radii[:, part, h] = marginal_radii(information / tau + alone[part], place, turn)
    major, minor, direction = (context.spread(values) for values in radii)
    return {
        "beacons": major,
        "beacons_minor": minor,
        "beacons_direction": direction,
        "beacons_alone": context.spread(marginal_radii(alone, place, turn)[0]),
        "beacons_in_view": context.spread(seen.sum(axis=1)),
    }


def _checked(
    at: ArrayLike, std: float, max_range: float, receiver: float
) -> tuple[Floats, float, float, float]:
    """Return the beacons, shape (K, 3), the variance, the largest range and the height."""
    try:
        places = np.asarray(at, dtype=np.float64)
    except (TypeError, ValueError):
        places = np.empty(0)
    if places.ndim != 2 or not len(places) or places.shape[1] not in (2, 3):
        raise InputError(
            "beacons: there are none; give their places as `at`, rows of x and y, or of x, y and "
            "z, in metres."
        )
    if not np.isfinite(places).all():
        row = int(np.flatnonzero(~np.isfinite(places).all(axis=1))[0])
        raise InputError(f"beacons: at[{row}] is {places[row].tolist()}; give finite metres.")
    low = as_number(receiver, "receiver")
    std, max_range = (
        as_positive(std, "std", "metres"),
        as_positive(max_range, "max_range", "metres"),
    )
    if places.shape[1] == 2:
        places = np.column_stack([places, np.full(len(places), low)])
    return places, std**2, max_range, low


def _reach(context: LayerContext, *, max_range: float = MAX_RANGE, **_: object) -> float:
    """Return the distance at which a change affects the layer: it may hide a beacon."""
    return max(context.sight, max_range)


LAYER = Layer(
    name="beacons",
    title="Fisher bound with ranges to beacons, major radius",
    unit="m",
    source="ours: Censi 2007 (ICRA) for the scan, and u u^T / s^2 for a range",
    worse="high",
    compute=beacons,
    slow=True,
    reach=_reach,
    high_is_good=("beacons_in_view",),
    companions={
        "beacons_minor": ("Fisher bound with ranges to beacons, minor radius", "m"),
        "beacons_direction": (
            "Fisher bound with ranges to beacons, axis of the major radius",
            "rad",
        ),
        "beacons_alone": ("bound of the ranges to beacons without the scan, major radius", "m"),
        "beacons_in_view": ("beacons in view and in range", "1"),
    },
)
