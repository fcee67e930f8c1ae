"""Where a robot can stand with its scanner: a sensor inside a wall makes a pose impossible.

Such a pose is not indistinguishable from its neighbours, it is none: it has no value, and it
leaves their neighbourhoods.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.raycasting.fan import scan_rays
from ambinav.sensing.scanner import RangeScanner

# Sensors nearer to the robot's centre than this stand where it does, metres.
AT_CENTRE = 1e-9
# A sensor that a wall touches, to within the rounding of ranges, stands in it, metres.
TOUCHING = 1e-6


def can_stand(
    env: Environment,
    scanner: RangeScanner,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    theta: float,
    robot_radius: float = 0.0,
) -> NDArray[np.bool_]:
    """Whether the robot can stand at the poses (x, y, theta).

    It can where its body, a disc, its centre and all of its sensors are in the free space and touch
    no wall, and no wall parts a sensor from the robot's centre: behind a thin wall a sensor is in
    free space again, but the robot would stand on both sides.

    Args:
        env: The environment.
        scanner: The scanner, with its true mounts.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        theta: Heading of all poses, radians.
        robot_radius: Radius of the body, metres; 0 for the robot's centre alone.

    Returns:
        Shape (N,).
    """
    good = np.array(env.is_free(x, y, robot_radius), dtype=np.bool_)
    # On a wall itself it is left to rounding what a sensor in the robot's centre sees.
    good &= np.asarray(env.clearance(x, y, 2 * TOUCHING)) > TOUCHING
    sensors = np.unique(scanner.mounts[:, :2], axis=0)
    off = np.hypot(*sensors.T)
    sensors, off = sensors[off > AT_CENTRE], off[off > AT_CENTRE]
    left = np.flatnonzero(good)
    if not (len(sensors) and len(left)):
        return good
    x, y = x[left], y[left]
    distance, _, _ = scan_rays(
        env, x, y, np.full(len(left), theta), np.zeros((len(sensors), 2)),
        np.arctan2(sensors[:, 1], sensors[:, 0]), float(off.max()), incidence=False,
    )  # fmt: skip
    fine = (distance > off + TOUCHING).all(axis=1)
    c, s = math.cos(theta), math.sin(theta)
    for mx, my in sensors.tolist():
        # As rays find their first triangle, so that no sensor of a pose that is left is outside.
        fine &= env.triangulation.contains(x + c * mx - s * my, y + s * mx + c * my)
    good[left] = fine
    return good


def standing(
    lattice: Lattice,
    scanner: RangeScanner,
    headings: NDArray[np.float64],
    robot_radius: float = 0.0,
) -> NDArray[np.bool_]:
    """`can_stand` at the free points of a lattice, shape (N, H) for H headings."""
    x, y = lattice.points
    return np.stack(
        [
            can_stand(lattice.environment, scanner, x, y, float(theta), robot_radius)
            for theta in headings
        ],
        axis=1,
    )


def standing_lattice(
    lattice: Lattice,
    scanner: RangeScanner,
    headings: NDArray[np.float64],
    robot_radius: float = 0.0,
) -> tuple[Lattice, NDArray[np.bool_]]:
    """The lattice without points at which the robot can stand at none of the H headings.

    Returns:
        The lattice, with N free points, and `standing` at these, shape (N, H).

    Raises:
        InputError: no point is left.
    """
    possible = standing(lattice, scanner, headings, robot_radius)
    somewhere = np.asarray(possible.any(axis=1))
    if not somewhere.any():
        body = f" of radius {robot_radius:g} m" if robot_radius > 0.0 else ""
        raise InputError(
            f"at no point of {lattice.environment.name} a robot{body} with scanner "
            f"{scanner.name!r} fits: its body or a sensor stands inside a wall; check the mounts "
            "(metres) and the robot's radius, or give a smaller spacing."
        )
    return lattice.among(somewhere), possible[somewhere]
