"""Building as a triangle mesh, and rays against it: the caster for what is not prisms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ambinav.casting.space import Scans, SpaceRays, unit_rays
from ambinav.config import as_array
from ambinav.runtime.array_types import Bytes, Floats, Floats32, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import need
from ambinav.runtime.provenance import digest_of

# Rays whose directions are computed at a time.
RAYS_AT_ONCE = 500_000


class Mesh:
    """Triangles in the map frame, metres, z up, with queries through Embree.

    A surface is a face, and stops rays from both sides. Embree works in float32, relative to the
    middle of the mesh: within 100 m ranges are good to about 1e-5 m, more where a ray grazes a
    face. Nothing is known to be solid: a mesh may be open or cut itself, as most do, so that only
    rays of poses that are not finite are nan (see `SpaceCaster`). Where a robot can stand is asked
    of `floor_environment`.

    Args:
        vertices: Shape (V, 3), metres.
        faces: Indices of the corners of each face, shape (F, 3).
        name: Name in messages.
        source: The file that it came from.
        processes: Embree holds the interpreter's lock, so more than one core means more than one
            process. Neither their number nor the order of rays changes a bit. Used in a `with`
            statement, or by `close`, they end at once, else with the mesh.
        notes: What was done to make it, a sentence each.
        voxel: Edge of the voxels of a scan that these are the faces of, which look outward: its
            noise puts one floor into two layers of them. 0: they are no such voxels.

    Raises:
        InputError: there is no triangle with an area, a number is not finite, an index names no
            vertex, or embreex is not installed.
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        name: str = "mesh",
        source: Path | None = None,
        processes: int = 1,
        notes: Sequence[str] = (),
        voxel: float = 0.0,
    ) -> None:
        where = str(source) if source is not None else name
        tables = [
            as_array(values, f"{where}: {noun}", "numbers, three in a row")
            for noun, values in (("vertices", vertices), ("faces", faces))
        ]
        for noun, table in zip(("vertices", "faces"), tables, strict=True):
            if table.size and (table.ndim != 2 or table.shape[1] != 3):
                raise InputError(
                    f"{where}: {noun} have the shape {table.shape}; give three numbers in a row."
                )
        points = tables[0].reshape(-1, 3)
        corners = tables[1].reshape(-1, 3).astype(np.int64)
        if not np.isfinite(points).all():
            raise InputError(f"{where}: a vertex is not finite; repair the mesh.")
        if len(corners) and not (corners.min() >= 0 and corners.max() < len(points)):
            raise InputError(f"{where}: a face names a vertex that is not there; repair the mesh.")
        cross = _crosses(points[corners])
        extended = np.linalg.norm(cross, axis=1) > 0.0
        if not extended.any():
            raise InputError(
                f"{where}: there are {len(points)} points and no triangle with an area in it; give "
                "a mesh of surfaces."
            )
        if processes < 1:
            raise InputError(f"{where}: processes is {processes}; give at least 1.")
        self.vertices = points
        self.faces = corners[extended]
        self.name = name
        self.source = source
        self.processes = processes
        self.notes = tuple(notes)
        self.voxel = voxel
        self._normal = cross[extended]
        self._normal /= np.linalg.norm(self._normal, axis=1, keepdims=True)

    def __repr__(self) -> str:
        """Return name, size and counts as text."""
        size = " x ".join(f"{length:.1f}" for length in np.ptp(self.bounds, axis=0))
        return f"Mesh({self.name!r}, {size} m, {len(self.faces)} faces)"

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the ray processes: a copy starts its own."""
        return {key: value for key, value in vars(self).items() if key != "_caster"}

    def __enter__(self) -> Self:
        """Return the mesh itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """End the processes."""
        self.close()

    def close(self) -> None:
        """End the processes, if there are any; the next cast starts new ones."""
        caster = self.__dict__.pop("_caster", None)
        if caster is not None:
            caster.close()

    @property
    def triangles(self) -> Floats:
        """Corners of the faces, shape (F, 3, 3), metres."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def bounds(self) -> Floats:
        """Lowest and highest x, y and z of the faces, shape (2, 3), metres."""
        named = np.zeros(len(self.vertices), dtype=np.bool_)
        named[self.faces] = True
        used = self.vertices[named]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @cached_property
    def middle(self) -> Floats:
        """Point that Embree's coordinates are relative to, shape (3,), metres."""
        return np.asarray(self.bounds.mean(axis=0))

    @cached_property
    def checksum(self) -> str:
        """Digest of the triangles."""
        return digest_of(self.vertices, self.faces)

    @property
    def surface_normal(self) -> Floats:
        """Unit normals of the faces, shape (F, 3)."""
        return np.asarray(self._normal)

    @cached_property
    def surface_kind(self) -> Bytes:
        """Kind of each surface, shape (F,): all are walls."""
        return np.zeros(len(self.faces), dtype=np.uint8)

    @cached_property
    def open_edges(self) -> int:
        """Number of edges that belong to only one face; 0 for a watertight mesh."""
        _, weld = np.unique(self.vertices, axis=0, return_inverse=True)
        corners = weld.reshape(-1)[self.faces]
        edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        _, shared = np.unique(edges, axis=0, return_counts=True)
        return int((shared == 1).sum())

    def cast(
        self, origin: ArrayLike, direction: ArrayLike, max_range: float
    ) -> tuple[Floats, Ints32]:
        """Find the first face along single rays; see `Prisms.cast`.

        Raises:
            InputError: the range is not a positive number.
        """
        shape, o, u, fine = unit_rays(origin, direction, max_range)
        lengths, face = self._cast(o, u, float(max_range))
        distance = np.minimum(lengths.astype(np.float64), max_range)
        distance[~fine], face[~fine] = np.nan, -1
        return distance.reshape(shape), face.reshape(shape)

    def cast_scans(
        self,
        x: Floats,
        y: Floats,
        theta: Floats,
        rays: SpaceRays,
        max_range: float,
        *,
        incidence: bool = True,
    ) -> Scans:
        """Cast the same rays from many poses of the robot; see `SpaceCaster`.

        x, y and theta may also have the shape (N, R): a pose for each ray.
        """
        shape = len(x), len(rays.azimuth)
        distance = np.empty(shape, dtype=np.float32)
        face = np.empty(shape, dtype=np.int32)
        oblique = np.empty(shape if incidence else (0, 0), dtype=np.float32)
        step = max(RAYS_AT_ONCE // max(shape[1], 1), 1)
        for low in range(0, len(x), step):
            part = slice(low, low + step)
            origin, direction = rays.at(x[part], y[part], theta[part])
            hits = self._cast(origin.reshape(-1, 3), direction.reshape(-1, 3), float(max_range))
            distance[part], face[part] = (values.reshape(origin.shape[:2]) for values in hits)
            if incidence:
                normal = self._normal[face[part]]
                facing = np.abs((normal * direction).sum(axis=-1))
                aside = np.linalg.norm(np.cross(normal, direction), axis=-1)
                oblique[part] = np.where(face[part] >= 0, np.arctan2(aside, facing), np.nan)
        # Embree reports a ray with nan coordinates as a miss.
        nowhere = ~np.isfinite(x + y + theta)
        distance[nowhere] = np.nan
        return distance, face, oblique

    def _cast(self, origin: Floats, direction: Floats, reach: float) -> tuple[Floats32, Ints32]:
        middle = self.middle
        hits: tuple[Floats32, Ints32] = self._caster.cast(
            (origin - middle).astype(np.float32), direction.astype(np.float32), reach
        )
        return hits

    @cached_property
    def _caster(self) -> Any:
        need(f"{self.source or self.name}: casting rays", ("embreex",), "mesh")
        from ambinav.casting.mesh.processes import EmbreeCaster

        vertices = (self.vertices - self.middle).astype(np.float32)
        return EmbreeCaster(vertices, self.faces.astype(np.int32), self.processes)


def _crosses(triangles: Floats) -> Floats:
    """Compute normals of triangles, shape (F, 3, 3), twice as long as their areas, (F, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    cross: Floats = np.cross(b - a, c - a)
    return cross
