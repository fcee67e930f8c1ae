"""Solids and thin walls added to a building in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Sheets, Solid
from ambinav.casting.space import SpaceCaster
from ambinav.casting.triangles import faces_of, faces_of_sheets
from ambinav.geometry.segments import REFLECTOR
from ambinav.runtime.errors import InputError

# Embree's coordinates are float32: by this much, metres, what is added to a mesh is taller.
HAIR: Final = 1e-5


def with_solids(
    space: SpaceCaster, solids: Sequence[Solid], sheets: Sheets | None = None
) -> SpaceCaster:
    """Return the building with solids added: prisms with more solids, a mesh with more faces.

    Args:
        space: The building; it is left as it is.
        solids: What is put into it; it may overlap what is there.
        sheets: Walls without thickness that are put into it; None: there are none.

    Raises:
        InputError: the building is neither prisms nor a mesh, or it is a mesh and a face is a
            reflector.
    """
    sheets = Sheets.none() if sheets is None else sheets
    if isinstance(space, Prisms):
        return space.refilled(
            Sheets.joined([space.given, sheets]), solids=[*space.solids, *solids], free=space.free
        )
    # Asked for its surfaces, a space that was not kept says so itself.
    count = len(space.surface_kind)
    if not isinstance(space, Mesh):
        raise InputError(
            f"the building in space is a {type(space).__name__} of {count} surfaces, into which "
            "nothing can be put; give prisms or a mesh."
        )
    if REFLECTOR in {*sheets.kind.tolist(), *(solid.kind for solid in solids)}:
        raise InputError(
            f"{space.name}: it is a mesh, in which no face is known as a reflector; put up "
            "obstacles that do not reflect, or give the building as a plan or an .ifc file."
        )
    # Surfaces are closed, as those of prisms are: a level ray at the height of a top meets it.
    sheets = sheets._replace(z=sheets.z + np.array([-HAIR, HAIR]))
    solids = [replace(s, bottom=s.bottom - HAIR, top=s.top + HAIR) for s in solids]
    triangles = [faces_of_sheets(sheets), *(faces_of(solid) for solid in solids)]
    corners = np.concatenate([np.empty((0, 3, 3)), *triangles]).reshape(-1, 3)
    fresh = np.arange(len(corners)).reshape(-1, 3) + len(space.vertices)
    made = Mesh(
        np.concatenate([space.vertices, corners]),
        np.concatenate([space.faces, fresh]),
        name=space.name,
        source=space.source,
        processes=space.processes,
        notes=space.notes,
        voxel=space.voxel,
    )
    # Ranges to what was there before stay as they are, to the last bit.
    made.middle = space.middle
    return made
