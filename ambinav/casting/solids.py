"""Solids added to a building in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceCaster
from ambinav.casting.triangles import faces_of
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
    triangles = [faces_of(solid) for solid in solids]
    corners = np.concatenate([np.empty((0, 3, 3)), *triangles]).reshape(-1, 3)
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
