"""Surfaces of a building in space as triangles, for what is no ray."""

from __future__ import annotations

import numpy as np
import shapely

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Sheets, Solid
from ambinav.casting.space import SpaceCaster
from ambinav.geometry.segments import edges_of
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError


def triangles_of(
    space: SpaceCaster, bounds: tuple[float, float, float, float] | None = None
) -> Floats:
    """Return the surfaces of a building as triangles, shape (T, 3, 3), metres.

    Args:
        space: The building.
        bounds: (xmin, ymin, xmax, ymax), metres: as far as the floor and the ceiling of prisms go,
            which have no end; None: they are left out.

    Raises:
        InputError: the building is neither prisms nor a mesh.
    """
    if isinstance(space, Mesh):
        return space.triangles
    if not isinstance(space, Prisms):
        raise InputError(
            f"the building in space is a {type(space).__name__} whose surfaces are not kept; give "
            "prisms or a mesh."
        )
    solids = [faces_of(solid) for solid in space.solids]
    if bounds is not None:
        outline = shapely.box(*bounds)
        lids = [z for z in (space.floor, space.ceiling) if np.isfinite(z)]
        solids += [faces_of(Solid(outline, z, z))[-4:-2] for z in lids]
    return np.concatenate([faces_of_sheets(space.given), *solids])


def faces_of_sheets(sheets: Sheets) -> Floats:
    """Return two triangles of each wall without thickness, (2 N, 3, 3), metres."""
    a, b = np.split(sheets.xy, 2, axis=1)
    low, high = sheets.z.T
    corners = [((a, low), (b, low), (b, high)), ((a, low), (b, high), (a, high))]
    triangles = [
        np.stack([np.column_stack([xy, z]) for xy, z in triangle], axis=1) for triangle in corners
    ]
    return np.concatenate(triangles)


def faces_of(solid: Solid) -> Floats:
    """Return triangles of the sides, top and bottom of a solid, (F, 3, 3), metres."""
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
    return np.concatenate(triangles)
