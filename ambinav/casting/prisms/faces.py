"""Horizontal faces of solids, sorted into the cells of a grid for the prisms' kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.triangulation import sort_triangles, turns
from ambinav.runtime.array_types import Bools, Floats, Ints, Ints32


@dataclass(frozen=True, eq=False)
class Pieces:
    """Outlines on a plan, divided into convex pieces of three or four corners.

    Attributes:
        edges: float64, shape (P, 12): a, b and c of each edge, inside where a x + b y + c >= 0
            (metres from the edge); of a triangle the last edge comes twice.
        owner: int32, shape (P,): the outline that each is of.
        triangle: float64, shape (T, 3, 2): the pieces as triangles, counter-clockwise, metres.
        piece: int64, shape (T,): the piece that each triangle is of.
    """

    edges: Floats
    owner: Ints32
    triangle: Floats
    piece: Ints

    @classmethod
    def of(cls, outlines: Sequence[shapely.Polygon]) -> Pieces:
        """Divide outlines; a convex outline with four corners is kept as one piece."""
        corners: list[Floats] = []
        owner: list[int] = []
        triangle: list[Floats] = []
        piece: list[int] = []
        for i, outline in enumerate(outlines):
            parts = shapely.get_parts(shapely.constrained_delaunay_triangles(outline))
            cut = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
            turn = turns(cut[:, 0], cut[:, 1], cut[:, 2])
            cut = np.where((turn < 0.0)[:, None, None], cut[:, [0, 2, 1]], cut)[turn != 0.0]
            ring = shapely.get_coordinates(shapely.orient_polygons(outline).exterior)[:-1]
            convex = turns(ring, np.roll(ring, -1, axis=0), np.roll(ring, -2, axis=0)) > 0.0
            is_quad = len(ring) == 4 and not outline.interiors and bool(convex.all())
            piece += [len(corners)] * len(cut) if is_quad else range(
                len(corners), len(corners) + len(cut)
            )  # fmt: skip
            corners += [ring] if is_quad else [part[[0, 1, 2, 0]] for part in cut]
            owner += [i] * (len(corners) - len(owner))
            triangle.append(cut)
        quads = np.array(corners).reshape(-1, 4, 2)
        along = np.roll(quads, -1, axis=1) - quads
        # Of a triangle the last edge has no length: the first stands for it.
        along[:, 3] = np.where((along[:, 3] == 0.0).all(axis=1)[:, None], along[:, 0], along[:, 3])
        normal = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        offset = -(normal * quads).sum(axis=-1, keepdims=True)
        return cls(
            np.concatenate([normal, offset], axis=-1).reshape(-1, 12),
            np.array(owner, dtype=np.int32),
            np.concatenate([np.empty((0, 3, 2)), *triangle]),
            np.array(piece, dtype=np.int64),
        )

    def in_cells(self, grid: SegmentGrid, kept: Bools) -> tuple[Ints32, Ints]:
        """Sort the `kept` pieces, shape (P,), into cells; return cell starts and the pieces."""
        kept_triangles = kept[self.piece]
        corner = np.ascontiguousarray(self.triangle[kept_triangles].reshape(-1, 2))
        rows, columns = grid.shape
        counts = np.zeros(rows * columns + 1, dtype=np.int64)
        none = np.empty(0, dtype=np.int32)
        sort_triangles(corner, grid.origin, grid.cell, columns, counts, none)
        start = np.cumsum(counts)
        item = np.empty(int(start[-1]), dtype=np.int32)
        sort_triangles(corner, grid.origin, grid.cell, columns, start[:-1].copy(), item)
        cell = np.repeat(np.arange(rows * columns), np.diff(start))
        pairs = np.unique(np.stack([cell, self.piece[kept_triangles][item]], axis=1), axis=0)
        edges = np.arange(rows * columns + 1)
        return np.searchsorted(pairs[:, 0], edges).astype(np.int32), pairs[:, 1]
