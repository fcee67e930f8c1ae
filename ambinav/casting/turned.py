"""Buildings in space, turned about the upright axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.space import SpaceCaster
from ambinav.geometry.segments import Segments, moved
from ambinav.runtime.errors import InputError


def turned(space: SpaceCaster, angle: float, dx: float, dy: float) -> SpaceCaster:
    """Turn a building about the origin by `angle` radians, then shift it by (dx, dy) metres.

    Raises:
        InputError: it is neither prisms nor a mesh.
    """
    if isinstance(space, Prisms):
        sheets = space.given
        lines = Segments(sheets.xy, sheets.kind).transformed(angle, dx, dy)
        solids = [
            replace(solid, outline=moved(solid.outline, angle, dx, dy)) for solid in space.solids
        ]
        free = None if space.free is None else moved(space.free, angle, dx, dy)
        return space.refilled(sheets._replace(xy=lines.xy), solids=solids, free=free)
    # Asked for its surfaces, a space that was not kept says so itself.
    count = len(space.surface_kind)
    if not isinstance(space, Mesh):
        raise InputError(
            f"the building in space is a {type(space).__name__} of {count} surfaces, which cannot "
            "be turned; give prisms or a mesh."
        )
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(
        space.vertices @ turn.T + (dx, dy, 0.0),
        space.faces,
        name=space.name,
        source=space.source,
        processes=space.processes,
        notes=space.notes,
        voxel=space.voxel,
    )
