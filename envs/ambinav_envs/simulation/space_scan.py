"""Simulated scans in a 3D building from the true pose."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.casting.prisms.rays import cast_prism_rays, cast_prism_sweep, silence_oblique
from ambinav.casting.upright import box_entry, cylinder_entry
from ambinav.drive.clutter import OBSTACLE_HEIGHT
from ambinav.drive.people import PERSON_HEIGHT
from ambinav.drive.world import unicycle
from ambinav.runtime.kernels import kernel

DOOR_HEIGHT: Final = 2.1
"""Height of a closed door in a 3D building, metres, as a doorway's. Rays pass over it."""


@kernel(forceinline=True)
def sense_in_space(space, cast, scanner, state, settings, people, boxes, i, scratch):
    """Cast the rays from a robot's true pose if the building is 3D; return whether it is.

    Which branch is compiled is settled by the type of `space`, see `casting.CastTables`; the
    others are what `scanner_kernel.sense` has. Written: `scratch.cast`, see `casting.cast_rays`.
    """
    if space is not None:
        cast_around(space, cast, scanner, state, settings, people, boxes, i, scratch.cast)
        return True
    return False


# Not inlined: `step.advance` counts no references, and so would never free what is made here.
@kernel
def cast_around(space, cast, scanner, state, settings, people, boxes, i, work):
    """Cast the rays of robot i among walls, people and boxes; see `sense_in_space`."""
    ux, uy, distance, hit, _ = work
    crowded = people.shape[1] > 0 or state.boxes > 0
    x, y, theta = state.truth[0], state.truth[1], state.truth[2]
    poses = np.empty((ux.size if crowded or settings.scan_time > 0.0 else 0, 3))
    for j in range(len(poses)):
        # During the scan the robot drives as in the last step.
        ago = scanner.moment[cast.beam[j]] * settings.scan_time
        poses[j, 0], poses[j, 1], poses[j, 2] = unicycle(
            x, y, theta, state.ground[0], state.ground[1], ago
        )
    if settings.scan_time > 0.0:
        cast_prism_sweep(poses, space, ux, uy, distance, hit)
    else:
        cast_prism_rays(x, y, theta, space, ux, uy, distance, hit, None, None)
    if crowded:
        shade_in_space(
            poses, cast.start, scanner.height, scanner.rise, people, settings.person_radius, boxes,
            state.boxes, state.door, i, work,
        )  # fmt: skip
    silence_oblique(space, ux, uy, distance, hit)


@kernel
def shade_in_space(
    poses, start, height, rise, people, radius, boxes, count, door, row, work
):  # fmt: skip
    """Shorten rays, already cast, that hit a person or a box before a surface.

    As `obstacles.shade`, each ray from a pose of the robot of its own.

    Args:
        poses: x, y (metres, map frame) and heading (radians) for each ray, shape (R, 3).
        start: x and y of each ray, shape (R, 2), metres, robot frame.
        height: Height of their starts above the floor, shape (R,), metres.
        rise: Sine of their elevations, shape (R,).
        people: `Memory.people`.
        radius: Radius of a person, metres.
        boxes: `Memory.boxes`.
        count: Number of boxes in use.
        door: Whether the first of them is a closed door.
        row: Which robot's they are.
        work: As `cast_prism_rays` left it; distances are shortened, surfaces made -1.
    """
    ux, uy, distance, hit, _ = work
    for j in range(distance.size):
        if math.isnan(distance[j]):
            continue
        co, si = math.cos(poses[j, 2]), math.sin(poses[j, 2])
        px = poses[j, 0] + co * start[j, 0] - si * start[j, 1]
        py = poses[j, 1] + si * start[j, 0] + co * start[j, 1]
        best = distance[j]
        for k in range(people.shape[1]):
            wx, wy = people[row, k, 0] - px, people[row, k, 1] - py
            d = cylinder_entry(
                wx, wy, ux[j], uy[j], rise[j], height[j], radius, PERSON_HEIGHT
            )  # fmt: skip
            best = min(best, d)
        for k in range(count):
            top = DOOR_HEIGHT if door and k == 0 else OBSTACLE_HEIGHT
            wx, wy = boxes[row, k, 0] - px, boxes[row, k, 1] - py
            d = box_entry(
                wx, wy, ux[j], uy[j], rise[j], height[j], boxes[row, k, 2], boxes[row, k, 3],
                boxes[row, k, 4], boxes[row, k, 5], top,
            )  # fmt: skip
            best = min(best, d)
        if best < distance[j]:
            distance[j], hit[j] = best, -1
