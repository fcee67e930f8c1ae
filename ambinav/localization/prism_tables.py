"""Tables of `casting.CastTables` for a building in space, and the kinds of its edges."""

from __future__ import annotations

import numpy as np

from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.prisms.rays import PrismRays
from ambinav.casting.space import SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Bytes, Indices
from ambinav.runtime.errors import InputError
from ambinav.sensing.rays import RayTable


def edge_kinds(environment: Environment) -> Bytes:
    """Return the kind of each border edge of a plan, or of each surface in space, (K,)."""
    if environment.space is None:
        return environment.segments.kind[environment.border_segment]
    return environment.surface_kind


def prisms_of(environment: Environment) -> Prisms | None:
    """Return the prisms of an environment; None for a plan.

    Raises:
        InputError: it is a mesh, whose rays Embree casts, which needs the interpreter; or the map
            of a building that keeps the floor alone.
    """
    if environment.space is None or isinstance(environment.space, Prisms):
        return environment.space
    # Asked for its surfaces, a space that was not kept says so itself.
    triangles = len(environment.surface_kind)
    raise InputError(
        f"{environment.name}: it is a mesh of {triangles} triangles, in which no kernel casts "
        "rays; give prisms, or let Monte Carlo localization look ranges up (laser_model_type "
        "beam_prob with beam_table_resolution 0.2 and without localizability_weighting)."
    )


def prism_rays(prisms: Prisms, floor: float, rays: RayTable, chosen: Indices) -> PrismRays:
    """Return chosen rays of a scanner on a robot that drives on a floor at this z."""
    origin = np.column_stack([rays.origin[chosen], rays.height[chosen] + floor])
    chosen_rays = SpaceRays(origin, rays.angle[chosen], rays.elevation[chosen])
    reach = float(rays.max_range[chosen].max())
    return prisms.rays(chosen_rays, reach, rays.max_incidence[chosen].astype(np.float64))
