"""Scans of a scene, in the plane or in space: only this module distinguishes the two."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.casting.plane.fan import scan_plan
from ambinav.casting.scene import Scene
from ambinav.casting.space import Scans, SpaceRays
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

GIVE_HEIGHTS: Final = (
    "give the building heights: `--extrude M`, or `--in-space` for those of an .ifc file, in "
    "Python environment.in_space(extruded(environment, height))"
)
"""Remedy for a plan where a building in space is needed."""


def scan_rays(
    scene: Scene,
    x: Floats,
    y: Floats,
    theta: Floats,
    ray_origin: Floats,
    ray_angle: Floats,
    max_range: float,
    *,
    height: Floats,
    elevation: Floats,
    incidence: bool = True,
) -> Scans:
    """Cast the same rays of a scanner from many poses of the robot.

    Args:
        scene: The building; rays are cast against its `space` where it has one, else in the plane.
        x: Poses, shape (N,), metres, map frame.
        y: Poses, shape (N,), metres, map frame.
        theta: Headings, shape (N,), radians.
        ray_origin: Where the rays start, shape (R, 2), metres, robot frame.
        ray_angle: Their azimuths, shape (R,), radians, robot frame.
        max_range: How far to look, metres.
        height: Where they start, shape (R,), metres above the floor.
        elevation: Radians above the horizon, shape (R,).
        incidence: Work out the angles of incidence too.

    Returns:
        distance: float32, shape (N, R), metres; inf where nothing is hit within `max_range`,
            nan where the ray starts outside the free space, in space: in what is solid.
        surface: int32, shape (N, R), index of the surface that was hit, -1 for none: of a plan
            the segment.
        incidence: float32, shape (N, R), angle between ray and surface normal, radians in
            [0, pi/2]; nan where nothing is hit. Shape (0, 0) if not asked for.

    Raises:
        InputError: see `check_rays`.
    """
    check_rays(scene, height, elevation)
    if scene.space is None:
        return scan_plan(scene, x, y, theta, ray_origin, ray_angle, max_range, incidence=incidence)
    origin = np.column_stack([ray_origin.reshape(-1, 2), height + scene.floor])
    rays = SpaceRays(origin, ray_angle, elevation)
    return scene.space.cast_scans(x, y, theta, rays, max_range, incidence=incidence)


def check_rays(scene: Scene, height: Floats, elevation: Floats) -> None:
    """Raise an error for rays that cannot be cast in a scene.

    Raises:
        InputError: a ray leaves the plane and the scene is a plan; or it starts on the floor or
            under it, and the scene is in space.
    """
    if scene.space is None:
        steep = np.flatnonzero(elevation)
        if len(steep):
            raise InputError(
                f"{scene.name}: it is a plan, and the scanner looks up and down (a beam has an "
                f"elevation of {math.degrees(elevation[steep[0]]):.3g} degrees); {GIVE_HEIGHTS}."
            )
    elif len(height) and not height.min() > 0.0:
        raise InputError(
            f"{scene.name}: it is a building in space, and a sensor of the scanner is at z = "
            f"{height.min():g} m, on its floor; give the mount a height: `z:` in its file, "
            "`--scanner-height M` on the command line, in Python scanner.raised(height)."
        )


def plane_only(scene: Scene, purpose: str) -> None:
    """Raise an error for a building in space where only plans are supported.

    Args:
        scene: The building.
        purpose: What is asked of it: a noun in the singular.

    Raises:
        InputError: the building has a `space`.
    """
    if scene.space is not None:
        raise InputError(
            f"{scene.name}: it is a building in space, and {purpose} is known for plans alone; "
            "give its plan, in Python environment.plan."
        )
