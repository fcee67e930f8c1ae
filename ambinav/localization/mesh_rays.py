"""Rays of some beams in a mesh, which Embree casts outside of kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.space import SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables, tables_of
from ambinav.runtime.array_types import Floats, Floats32, Ints, Ints32
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True, eq=False)
class MeshRays:
    """Rays of some beams, renumbered from 0, in a mesh.

    Attributes:
        mesh: The mesh.
        rays: R rays; heights count from z = 0 of the mesh.
        incidence: Largest angle to the normal that returns an echo, shape (R,), radians.
        reach: How far to look, metres.
        tables: The rays and faces, for kernels that are given what the rays meet.
    """

    mesh: Mesh
    rays: SpaceRays
    incidence: Floats32
    reach: float
    tables: CastTables

    def cast(self, poses: Floats) -> tuple[Floats, Ints32]:
        """Cast all rays at poses, shape (N, 3).

        Returns:
            Distances, shape (N, R), metres, inf without an echo; and the faces met, -1 for none.
        """
        x, y, theta = np.ascontiguousarray(poses.T)
        has_incidence = bool(np.isfinite(self.incidence).any())
        distance, face, oblique = self.mesh.cast_scans(
            x, y, theta, self.rays, self.reach, incidence=has_incidence
        )
        if has_incidence:
            silent = oblique > self.incidence
            distance[silent], face[silent] = np.inf, -1
        return distance.astype(np.float64), face


def mesh_rays(environment: Environment, mesh: Mesh, scanner: RangeScanner, beams: Ints) -> MeshRays:
    """Arrange the rays of some beams in a mesh.

    Raises:
        InputError: a sensor lies on the floor.
    """
    tables, chosen = tables_of(environment, scanner, beams)
    rays = scanner.rays(in_space=True)
    origin = np.column_stack([rays.origin, rays.height + environment.floor])[chosen]
    return MeshRays(
        mesh,
        SpaceRays(origin, rays.angle[chosen], rays.elevation[chosen]),
        rays.max_incidence[chosen],
        float(rays.max_range[chosen].max()),
        tables,
    )
