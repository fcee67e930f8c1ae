"""Solids added to a building in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceCaster
from ambinav.geometry.segments import edges_of
from ambinav.runtime.errors import InputError


def with_solids(space: SpaceCaster, solids: Sequence[Solid]) -> SpaceCaster:
    """Return the building with solids added: prisms with more solids, a mesh with more faces.

    Args:
        space: The building; it is left as it is.
        solids: What is put into it; it may overlap what is there.

    Raises:
        InputError: the building is neither prisms nor a mesh.
    """
    if isinstance(space, Prisms):
        given = slice(space.sheets)
        return space.refilled(
            space.walls.xy[given], space.wall_z[given], space.walls.kind[given],
            solids=[*space.solids, *solids], free=space.free,
        )  # fmt: skip
    # Asked for its surfaces, a space that was not kept says so itself.
    count = len(space.surface_kind)
    if not isinstance(space, Mesh):
        raise InputError(
            f"the building in space is a {type(space).__name__} of {count} surfaces, into which "
            "nothing can be put; give prisms or a mesh."
        )
    triangles = [_faces(solid) for solid in solids]
    corners = np.concatenate([np.empty((0, 3)), *triangles]).reshape(-1, 3)
    fresh = np.arange(len(corners)).reshape(-1, 3) + len(space.vertices)
    return Mesh(
        np.concatenate([space.vertices, corners]),
        np.concatenate([space.faces, fresh]),
        name=space.name,
        source=space.source,
        processes=space.processes,
        notes=space.notes,
        voxel=space.voxel,
    )


def _faces(solid: Solid) -> NDArray[np.float64]:
    """Return triangles of the sides, top and bottom of a solid, by corners, shape (3 F, 3)."""
    sides = edges_of(solid.outline)
    a, b = sides[:, :2], sides[:, 2:]
    cut = shapely.get_parts(shapely.constrained_delaunay_triangles(solid.outline))
    flat = shapely.get_coordinates(cut).reshape(-1, 4, 2)[:, :3]
    low, high = solid.bottom, solid.top
    rows = [
        (np.stack([a, b, b], axis=1), (low, low, high)),
        (np.stack([a, b, a], axis=1), (low, high, high)),
        (flat, (low, low, low)),
        (flat[:, ::-1], (high, high, high)),
    ]
    triangles = [
        np.concatenate([xy, np.broadcast_to(np.array(z)[:, None], (len(xy), 3, 1))], axis=2)
        for xy, z in rows
    ]
    return np.concatenate(triangles).reshape(-1, 3)
