"""Level a mesh whose floor is tilted: that of a survey is, by a fraction of a degree."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.mesh.mesh import Mesh

STEEPEST: Final = math.radians(10.0)
"""Tilts up to this are taken for an error of the survey."""
LEAST: Final = math.radians(0.01)
"""Smaller ones are left: 3 mm over 20 m."""

# Faces within this of the tilt that they agree on, and what share of the area must.
_AGREED: Final = math.radians(0.5)
_MOST: Final = 0.5


def levelled(mesh: Mesh) -> Mesh:
    """The mesh turned so that its floors and ceilings are level, and a note by how much.

    The slope is the median, by area, of that of all faces that are tilted by at most `STEEPEST`:
    floors, ceilings and the tops of furniture share it, whichever of them is the floor. Where
    fewer than half of them do (ramps, terrain), and of a tilt below `LEAST`, the mesh is returned
    as it is. Voxels are level by themselves.
    """
    normal, area = mesh.surface_normal, _areas(mesh.triangles)
    near = np.abs(normal[:, 2]) >= math.cos(STEEPEST)
    if mesh.voxel or not near.any():
        return mesh
    slopes = normal[near, :2] / normal[near, 2:]
    area = area[near]
    slope = np.array([_median(slopes[:, k], area) for k in range(2)])
    tilt = math.atan(float(np.hypot(*slope)))
    agreed = np.hypot(*(slopes - slope).T) <= math.tan(_AGREED)
    if not LEAST <= tilt <= STEEPEST or area[agreed].sum() < _MOST * area.sum():
        return mesh
    middle = mesh.bounds.mean(axis=0)
    turned = (mesh.vertices - middle) @ _upright(np.append(slope, 1.0)).T + middle
    where = str(mesh.source or mesh.name)
    return Mesh(
        turned,
        mesh.faces,
        name=mesh.name,
        source=mesh.source,
        processes=mesh.processes,
        notes=(*mesh.notes, f"{where}: its floor was tilted by {math.degrees(tilt):.2f} degrees "
               "and is levelled."),
    )  # fmt: skip


def _areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c = triangles.swapaxes(0, 1)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)


def _median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Weighted median: half of the weight lies at or below it."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _upright(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation about a horizontal axis that takes a direction to z (Rodrigues), (3, 3)."""
    x, y, z = direction / np.linalg.norm(direction)
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + z))
