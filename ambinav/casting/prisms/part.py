"""Part of a building of prisms near a box: rays there meet exactly the same, bit for bit.

A ray walks the cells of the building's grid, and what it is compared with, and in which order, are
the items of these cells. So the cells that touch the box are kept as they are, where they are: the
grid goes on over all of the building, empty elsewhere.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ambinav.casting.plane.triangulation import Triangulation
from ambinav.casting.prisms.cast import PrismCaster
from ambinav.casting.prisms.kernel import PrismArrays
from ambinav.casting.prisms.prisms import Prisms
from ambinav.runtime.array_types import Bounds, Bytes, Floats, Ints, Ints32

# No triangle of the plan is near: use one in which no ray starts.
FAR_AWAY = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]) - 1e9


class Cells(NamedTuple):
    """Cells of a grid that are not empty.

    Attributes:
        cell: Their numbers, ascending.
        items: How many items each has.
    """

    cell: Ints32
    items: Ints32

    def start(self, cells: int) -> Ints32:
        """Return the first item of each cell of a grid with this many cells, and the end."""
        counts = np.zeros(cells + 1, dtype=np.int32)
        counts[self.cell + 1] = self.items
        return np.cumsum(counts, dtype=np.int32)


class PrismPart(PrismCaster):
    """Rays near a box in a building of prisms; a `SpaceCaster` that is sent as its arrays.

    Surfaces are numbered anew, in the order of the building's. Rays that leave the box meet what is
    kept of it, or nothing.

    Args:
        scene: What kernels read; `start`, `face_start` and `body_start` are empty.
        cells: The cells of walls, of faces and of solids.
        kind: Kind of each surface; see `ambinav.geometry.segments`.
        triangles: Triangles of the plan in which rays may start, shape (T, 3, 2), metres; None:
            anywhere.
        checksum: Checksum of the building.
    """

    def __init__(
        self,
        scene: PrismArrays,
        cells: tuple[Cells, Cells, Cells],
        kind: Bytes,
        triangles: Floats | None,
        checksum: str,
    ) -> None:
        self._made_of = scene, cells, kind, triangles, checksum
        self.surface_kind = kind
        self.checksum = checksum

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle only the arrays."""
        return PrismPart, self._made_of

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        scene, cells, kind, triangles, _ = self._made_of
        pieces = (*scene, *(array for pair in cells for array in pair), kind, triangles)
        return sum(array.nbytes for array in pieces if isinstance(array, np.ndarray))

    @property
    def surface_normal(self) -> Floats:
        """Unit normal of each surface, shape (S, 3)."""
        return self._made_of[0].normal

    @cached_property
    def arrays(self) -> PrismArrays:
        """Arrays of the part for the kernels."""
        scene, cells, *_ = self._made_of
        walls, faces, bodies = (cell.start(scene.rows * scene.columns) for cell in cells)
        return scene._replace(start=walls, face_start=faces, body_start=bodies)

    @cached_property
    def plan(self) -> Triangulation | None:
        """Area where rays of scans may start; None: anywhere."""
        triangles = self._made_of[3]
        return None if triangles is None else Triangulation.from_triangles(triangles)


def part_of(prisms: Prisms, box: Bounds) -> PrismPart:
    """Return the surfaces that rays within a box can meet.

    Args:
        prisms: The building.
        box: (xmin, ymin, xmax, ymax), metres.
    """
    scene = prisms.arrays
    near = _near(scene, box)
    walls, item = _kept(scene.start, near)
    faces, face = _kept(scene.face_start, near)
    bodies, body = _kept(scene.body_start, near)
    level = len(scene.level) - 2
    # Surfaces that are met: walls, then bottom and top of each solid, then floor and ceiling.
    used_walls = np.unique(scene.item[item])
    used_faces = np.unique(scene.face_item[face])
    solids = np.unique((scene.face_surface[used_faces] - scene.walls) // 2)
    horizontal = np.append((2 * solids[:, None] + (0, 1)).ravel(), (level, level + 1))
    horizontal = horizontal.astype(np.int64)
    surface = np.concatenate([used_walls, scene.walls + horizontal])
    none = np.empty(0, dtype=np.int32)
    part = scene._replace(
        start=none,
        item=np.searchsorted(used_walls, scene.item[item]).astype(np.int32),
        wall=scene.wall[item],
        face_start=none,
        face_item=np.searchsorted(used_faces, scene.face_item[face]).astype(np.int32),
        face=scene.face[used_faces],
        face_surface=np.searchsorted(surface, scene.face_surface[used_faces]).astype(np.int32),
        body_start=none,
        body=scene.body[body],
        walls=len(used_walls),
        level=scene.level[horizontal],
        normal=np.ascontiguousarray(scene.normal[surface]),
    )
    triangles = None
    if prisms.plan is not None:
        corners = prisms.plan.corner.reshape(-1, 3, 2)
        within = (corners.min(axis=1) <= box[2:]).all(axis=1)
        within &= (corners.max(axis=1) >= box[:2]).all(axis=1)
        triangles = corners[within] if within.any() else FAR_AWAY
    return PrismPart(
        part, (walls, faces, bodies), prisms.surface_kind[surface], triangles, prisms.checksum
    )


def _near(scene: PrismArrays, box: Bounds) -> Ints:
    """Return the indices of the cells that touch a box, and of their neighbours, ascending."""
    low = (np.array(box[:2]) - (scene.x0, scene.y0)) // scene.cell - 1
    high = (np.array(box[2:]) - (scene.x0, scene.y0)) // scene.cell + 1
    (left, bottom), (right, top) = (
        np.clip(edge, 0, (scene.columns - 1, scene.rows - 1)).astype(np.int64)
        for edge in (low, high)
    )
    rows, columns = np.arange(bottom, top + 1), np.arange(left, right + 1)
    return (rows[:, None] * scene.columns + columns).ravel()


def _kept(start: Ints32, cells: Ints) -> tuple[Cells, Ints]:
    """Return the cells that are not empty, and their items, in the original order."""
    count = start[cells + 1] - start[cells]
    filled = count > 0
    cells, count = cells[filled], count[filled]
    before = np.repeat(start[cells] - np.append(0, np.cumsum(count)[:-1]), count)
    return Cells(cells.astype(np.int32), count), before + np.arange(int(count.sum()))
