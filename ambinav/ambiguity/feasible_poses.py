"""Feasible poses of a robot with its scanner: no body or sensor inside a wall.

Such a pose is not indistinguishable from its neighbours, it is none: it has no value, and it
leaves their neighbourhoods.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.plane.fan import distinct_rows, scan_plan
from ambinav.casting.space import SpaceCaster, SpaceRays
from ambinav.geometry.edit_in_space import top_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

# Sensors nearer to the robot's centre than this stand where it does, metres.
AT_CENTRE = 1e-9
# A sensor that a wall touches, to within the rounding of ranges, stands in it, metres.
TOUCHING = 1e-6
# What stands over the floor by less hinders no mast, metres: floors are uneven.
UNEVEN = 0.1


def can_stand(
    env: Environment,
    scanner: RangeScanner,
    x: Floats,
    y: Floats,
    theta: float | Floats,
    robot_radius: float = 0.0,
) -> Bools:
    """Return whether the robot can stand at the poses (x, y, theta).

    It can where its body, a disc, its centre and all of its sensors are in the free space and touch
    no wall, and no wall parts a sensor from the robot's centre: behind a thin wall a sensor is in
    free space again, but the robot would stand on both sides. In space the sensors are in what is
    free at their height, and nothing is over the floor at the robot's centre up to the highest.

    Args:
        env: The environment.
        scanner: The scanner, with its true mounts.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        theta: Heading of all poses, radians, or of each, shape (N,).
        robot_radius: Radius of the body, metres; 0 for the robot's centre alone.

    Returns:
        Shape (N,).
    """
    good = np.array(env.is_free(x, y, robot_radius), dtype=np.bool_)
    heading = np.broadcast_to(np.asarray(theta, dtype=np.float64), np.shape(x))
    # On a wall itself it is left to rounding what a sensor in the robot's centre sees.
    good &= np.asarray(env.clearance(x, y, 2 * TOUCHING)) > TOUCHING
    if env.space is not None:
        rows = np.flatnonzero(good)
        good[rows] = _free_in_space(env.space, env.floor, scanner, x[rows], y[rows], heading[rows])
        return good
    mounts = scanner.mounts[:, :2]
    sensors = mounts[np.hypot(*mounts.T) > AT_CENTRE]
    rows = np.flatnonzero(good)
    if not (len(sensors) and len(rows)):
        return good
    sensors, _ = distinct_rows(sensors)
    off = np.hypot(*sensors.T)
    x, y, heading = x[rows], y[rows], heading[rows]
    distance, _, _ = scan_plan(
        env, x, y, heading, np.zeros((len(sensors), 2)),
        np.arctan2(sensors[:, 1], sensors[:, 0]), float(off.max()), incidence=False,
    )  # fmt: skip
    fine = (distance > off + TOUCHING).all(axis=1)
    c, s = np.cos(heading), np.sin(heading)
    for mx, my in sensors.tolist():
        # Use the rays' own point location, so that every sensor of a remaining pose is inside.
        fine &= env.triangulation.contains(x + c * mx - s * my, y + s * mx + c * my)
    good[rows] = fine
    return good


def _free_in_space(
    space: SpaceCaster, floor: float, scanner: RangeScanner, x: Floats, y: Floats, heading: Floats
) -> Bools:
    """Return whether no solid is at the sensors, nor between them and the robot's axis."""
    places = np.unique(np.column_stack([scanner.mounts[:, :2], scanner.upright[:, 0]]), axis=0)
    off = np.hypot(places[:, 0], places[:, 1])
    count, top = len(places), float(places[:, 2].max())
    # From the axis to each sensor, and from the highest of them down to the floor.
    outward = SpaceRays(
        np.column_stack([np.zeros((count, 2)), places[:, 2] + floor]),
        np.arctan2(places[:, 1], places[:, 0]),
        np.zeros(count),
    )
    down = SpaceRays(np.array([[0.0, 0.0, top + floor]]), np.zeros(1), np.full(1, -math.pi / 2))
    reach = float(off.max()) + TOUCHING
    distance, _, _ = space.cast_scans(x, y, heading, outward, reach, incidence=False)
    # A ray that starts in a solid has length nan, for which this comparison is false.
    is_clear = distance > np.where(off > AT_CENTRE, off, 0.0) + TOUCHING
    drop, _, _ = space.cast_scans(x, y, heading, down, top, incidence=False)
    return np.asarray(is_clear.all(axis=1) & ~(drop[:, 0] < top - UNEVEN))


def standing(
    lattice: Lattice, scanner: RangeScanner, headings: Floats, robot_radius: float = 0.0
) -> Bools:
    """Compute `can_stand` at the free points of a lattice, shape (N, H) for H headings."""
    x, y = lattice.points
    return np.stack(
        [
            can_stand(lattice.environment, scanner, x, y, float(theta), robot_radius)
            for theta in headings
        ],
        axis=1,
    )


def standing_lattice(
    lattice: Lattice, scanner: RangeScanner, headings: Floats, robot_radius: float = 0.0
) -> tuple[Lattice, Bools]:
    """Return the lattice without points where the robot can stand at no heading.

    Returns:
        The lattice, with N free points, and `standing` at these, shape (N, H).

    Raises:
        InputError: no point is left.
    """
    possible = standing(lattice, scanner, headings, robot_radius)
    somewhere = np.asarray(possible.any(axis=1))
    if not somewhere.any():
        env = lattice.environment
        body = f" of radius {robot_radius:g} m" if robot_radius > 0.0 else ""
        highest = float(scanner.upright[:, 0].max())
        top = math.inf if env.space is None else top_of(env.space) - env.floor
        if highest >= top:
            why = (
                f"a sensor is {highest:g} m above the floor, and the building ends at {top:g} m; "
                "mount it lower"
            )
        else:
            why = (
                "its body or a sensor stands inside a wall; check the mounts (metres), in space "
                "also their heights, and the robot's radius, or give a smaller spacing"
            )
        raise InputError(
            f"at no point of {env.name} a robot{body} with scanner {scanner.name!r} fits: {why}."
        )
    return lattice.among(somewhere), possible[somewhere]
