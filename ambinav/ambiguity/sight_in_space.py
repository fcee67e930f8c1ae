"""Poses that see a face of a building of prisms, as `sight` has it in the plane."""

from __future__ import annotations

from typing import Final

import numpy as np

from ambinav.ambiguity.sight import GRAZE, HIDDEN
from ambinav.casting.added import AddedWalls
from ambinav.casting.prisms.prisms import Prisms
from ambinav.runtime.array_types import Bools, Floats
from ambinav.sensing.rays import RayTable

# Rays at a time.
RAYS_AT_ONCE: Final = 4_000_000
# One in so many rays is looked along before all others.
FEW: Final = 8


def sees_in_space(
    prisms: Prisms,
    floor: float,
    faces: AddedWalls,
    x: Floats,
    y: Floats,
    headings: Floats,
    rays: RayTable,
    reach: Floats,
) -> Bools:
    """Return whether a ray of each pose, shape (N,), meets one of the given faces.

    In doubt it does: at corners that a ray grazes.

    Args:
        prisms: The building.
        floor: z of its floor, metres.
        faces: The faces in question, wider than they are by `GRAZE`.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        headings: Of each of them, shape (H,), radians.
        rays: R rays of the scanner.
        reach: Range of each, shape (R,), metres.
    """
    seen = np.zeros(len(x), dtype=np.bool_)
    if not len(faces.kind):
        return seen
    table = np.column_stack([rays.angle, rays.origin, rays.height + floor, rays.elevation])
    few = np.arange(len(table)) % FEW == 0
    for theta in headings.tolist():
        # Most poses that see a face do so with many rays.
        for part in (few, ~few):
            _look(prisms, faces, x, y, theta, table[part], reach[part], seen)
    return seen


def _look(
    prisms: Prisms,
    faces: AddedWalls,
    x: Floats,
    y: Floats,
    theta: float,
    table: Floats,
    reach: Floats,
    seen: Bools,
) -> None:
    """Ask the poses that see no face yet about some rays, (R, 5), as `AddedWalls.shorten` has them.

    Written: `seen`, shape (N,).
    """
    if not len(table):
        return
    step = max(RAYS_AT_ONCE // len(table), 1)
    none = np.empty((0, 0), dtype=np.float32)
    rows, far = np.flatnonzero(~seen), float(reach.max())
    for low in range(0, len(rows), step):
        part = rows[low : low + step]
        nearest = np.tile(reach.astype(np.float32), (len(part), 1))
        face = np.full(nearest.shape, -1, dtype=np.int32)
        faces.shorten(x[part], y[part], theta, table, far, 0, (nearest, face, none))
        pose, ray = np.nonzero(face >= 0)
        origin = _placed(x[part[pose]], y[part[pose]], theta, table[ray])
        for turn in (0.0, -GRAZE, GRAZE):
            is_unseen = ~seen[part[pose]]
            pose, ray, origin = pose[is_unseen], ray[is_unseen], origin[is_unseen]
            look = _directions(theta + turn, table[ray])
            distance, _ = prisms.cast(origin, look, far)
            seen[part[pose[distance >= nearest[pose, ray] - HIDDEN]]] = True


def _placed(x: Floats, y: Floats, theta: float, rays: Floats) -> Floats:
    """Return the origins of rays of robots at poses, shape (n, 3)."""
    c, s = np.cos(theta), np.sin(theta)
    ox, oy = rays[:, 1], rays[:, 2]
    return np.column_stack([x + c * ox - s * oy, y + s * ox + c * oy, rays[:, 3]])


def _directions(theta: float, rays: Floats) -> Floats:
    """Return their unit vectors, shape (n, 3)."""
    flat, angle = np.cos(rays[:, 4]), rays[:, 0] + theta
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), np.sin(rays[:, 4])])
