"""Reflectors as targets of a scanner that navigates by them: their edges and their middles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import pieces_of
from ambinav.runtime.array_types import Floats, Indices, Ints


@dataclass(frozen=True, eq=False)
class Targets:
    """L reflectors.

    Attributes:
        middle: Middle of each, float64, shape (L, 2), metres, map frame.
        edges: Edges of all, one reflector after the other, shape (E, 4), metres.
        first: Those of reflector l are first[l] to first[l + 1] - 1, int64, shape (L + 1,).
    """

    middle: Floats
    edges: Floats
    first: Ints

    def __len__(self) -> int:
        """Return the number of reflectors."""
        return len(self.middle)

    @classmethod
    def of(cls, environment: Environment) -> Targets:
        """Return the reflectors of a building; segments that touch are one reflector."""
        segments = environment.segments
        lines = shapely.linestrings(segments.xy[segments.reflectors].reshape(-1, 2, 2))
        merged = shapely.get_parts(shapely.line_merge(shapely.union_all(lines)))
        group = _touching(merged)
        return cls.of_outlines(
            [shapely.multilinestrings(merged[group == k]) for k in range(group.max(initial=-1) + 1)]
        )

    @classmethod
    def of_outlines(cls, outlines: Sequence[BaseGeometry] | NDArray[np.object_]) -> Targets:
        """Return reflectors of these outlines, lines or polygons."""
        middle = [shapely.get_coordinates(shapely.centroid(outline))[0] for outline in outlines]
        edges = [_joined(map(pieces_of, shapely.get_parts(outline))) for outline in outlines]
        return cls(
            np.array(middle, dtype=np.float64).reshape(-1, 2),
            np.ascontiguousarray(_joined(edges), dtype=np.float64),
            np.cumsum([0, *map(len, edges)], dtype=np.int64),
        )

    def and_of(self, other: Targets) -> Targets:
        """Return these reflectors, followed by others."""
        return Targets(
            np.concatenate([self.middle, other.middle]),
            np.concatenate([self.edges, other.edges]),
            np.concatenate([self.first, self.first[-1] + other.first[1:]]),
        )

    def among(self, numbers: Ints) -> Targets:
        """Return those with the given numbers."""
        spans = [slice(self.first[k], self.first[k + 1]) for k in numbers.tolist()]
        edges = [self.edges[span] for span in spans]
        return Targets(
            self.middle[numbers], _joined(edges), np.cumsum([0, *map(len, edges)], dtype=np.int64)
        )


def _touching(pieces: NDArray[np.object_]) -> Indices:
    """Return the group of each line, from 0 on; lines that touch are of one."""
    first, second = shapely.STRtree(pieces).query(pieces, predicate="intersects")
    size = len(pieces)
    links = coo_array((np.ones(len(first)), (first, second)), shape=(size, size))
    _, group = connected_components(links, directed=False)
    return np.asarray(group, dtype=np.intp)


def _joined(edges: Iterable[Floats]) -> Floats:
    return np.concatenate([np.empty((0, 4)), *edges])
