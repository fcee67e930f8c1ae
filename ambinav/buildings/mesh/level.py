"""Levelling of a mesh or points with a tilted floor; surveys tilt by a fraction of a degree."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.buildings.mesh.frame import triangle_areas
from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.array_types import Floats, Ints

STEEPEST: Final = math.radians(10.0)
"""Tilts up to this are taken for an error of the survey."""
LEAST: Final = math.radians(0.01)
"""Smaller ones are left: 3 mm over 20 m."""

# Faces within this of the tilt that they agree on, and what share of the area must.
_AGREED: Final = math.radians(0.5)
_MOST: Final = 0.5
# Tops of voxels that are looked at, planes that are tried, and how often the best one is fitted.
_TOPS, _TRIES, _REFITS = 20_000, 400, 4


def levelled(mesh: Mesh) -> Mesh:
    """Return the mesh turned so that floors and ceilings are level, with a note of the angle.

    The slope is the median, by area, of that of all faces that are tilted by at most `STEEPEST`:
    floors, ceilings and the tops of furniture share it, whichever of them is the floor. Where
    fewer than half of them do (ramps, terrain), and of a tilt below `LEAST`, the mesh is returned
    as it is. Voxels are level by themselves.
    """
    normal, area = mesh.surface_normal, triangle_areas(mesh.triangles)
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
    turned = (mesh.vertices - middle) @ upright(slope).T + middle
    where = str(mesh.source or mesh.name)
    return Mesh(
        turned,
        mesh.faces,
        name=mesh.name,
        source=mesh.source,
        processes=mesh.processes,
        notes=(*mesh.notes, levelled_note(where, slope)),
    )  # fmt: skip


def _median(values: Floats, weights: Floats) -> float:
    """Return the weighted median: half of the weight lies at or below it."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def levelled_note(where: str, slope: Floats) -> str:
    """Return the note about a building that was levelled."""
    tilt = math.degrees(math.atan(float(np.hypot(*slope))))
    return f"{where}: its floor was tilted by {tilt:.2f} degrees and is levelled."


def upright(slope: Floats) -> Floats:
    """Return the rotation about a horizontal axis that makes a plane level (Rodrigues), (3, 3).

    Args:
        slope: Slope of the plane x s + y t + z = constant, (s, t).
    """
    direction = np.append(slope, 1.0)
    x, y, z = direction / np.linalg.norm(direction)
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + z))


def voxel_slope(keys: Ints) -> Floats | None:
    """Find the tilt of a floor of voxels, by the plane that most of their tops lie in.

    Planes through three tops at random are tried (RANSAC, Fischler and Bolles 1981), those that
    are tilted by at most `STEEPEST`, and the best one is fitted to the tops within a voxel of it.

    Args:
        keys: Distinct voxels, shape (V, 3), z up.

    Returns:
        The slope for `upright`; None: no plane, or over the whole building it rises by less than a
        voxel, which stepping over a layer allows for.
    """
    order = np.lexsort(keys.T)
    above = np.zeros(len(keys), dtype=np.bool_)
    column = np.lexsort((keys[:, 2], keys[:, 1], keys[:, 0]))
    stacked = (np.diff(keys[column], axis=0) == (0, 0, 1)).all(axis=1)
    above[column[:-1][stacked]] = True
    tops = keys[order][~above[order]].astype(np.float64)
    rng = np.random.default_rng(0)  # the same planes each time
    if len(tops) > _TOPS:
        tops = tops[rng.choice(len(tops), _TOPS, replace=False)]
    if len(tops) < 3:
        return None
    tops -= tops.mean(axis=0)
    best = np.zeros(len(tops), dtype=np.bool_)
    for three in rng.integers(0, len(tops), size=(_TRIES, 3)):
        normal = np.cross(tops[three[1]] - tops[three[0]], tops[three[2]] - tops[three[0]])
        if np.hypot(*normal[:2]) > math.tan(STEEPEST) * abs(normal[2]) or normal[2] == 0.0:
            continue
        near = np.abs((tops - tops[three[0]]) @ normal) <= abs(normal[2])
        if near.sum() > best.sum():
            best = near
    for _ in range(_REFITS):
        if best.sum() < 3:
            return None
        sides = np.column_stack([tops[best, :2], np.ones(best.sum())])
        plane = np.linalg.lstsq(sides, tops[best, 2], rcond=None)[0]
        best = np.abs(tops[:, 2] - tops[:, :2] @ plane[:2] - plane[2]) <= 1.0
    slope = -plane[:2]
    rise = float(np.abs(slope) @ np.ptp(keys[:, :2], axis=0))
    return slope if rise > 1.0 and np.hypot(*slope) <= math.tan(STEEPEST) else None
