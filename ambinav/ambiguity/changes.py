"""Differences of two buildings: rows of segments and edges, and boxes around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ambinav.casting.added import AddedWalls
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceCaster
from ambinav.geometry.border_cover import repeated, row_keys
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments, edges_of
from ambinav.runtime.array_types import Bools, Bounds, Floats

# An edge around everything, metres.
EVERYWHERE = np.array([[-1e8, -1e8, 1e8, 1e8]])


@dataclass(frozen=True, eq=False)
class Changes:
    """Segments and edges that only one of two buildings has.

    A segment is the same if its ends, their order and its kind are, to the last bit. A region that
    is free in one of the two alone is bounded by edges that one of the two alone has.

    Attributes:
        removed: End points of the segments that the first alone has, shape (K, 4), metres.
        added: Those that the second alone has, likewise.
        edges: All of these, and the edges of the spaces for scans and for footprints that one of
            the two alone has; in space also those, seen from above, of what one alone has.
    """

    removed: Floats
    added: Floats
    edges: Floats

    @classmethod
    def between(cls, old: Environment, new: Environment, footprints: bool) -> Changes:
        """Compare two buildings.

        Args:
            old: The first.
            new: The second.
            footprints: Whether it matters where a body fits (`Environment.collision`).
        """
        removed, added = _rows(old.segments, new.segments), _rows(new.segments, old.segments)
        pairs = [(edges_of(old.free), edges_of(new.free))]
        if footprints:
            pairs.append((_body_edges(old), _body_edges(new)))
        edges = [removed, added]
        for first, second in pairs:
            edges += [first[~repeated(first, second)], second[~repeated(second, first)]]
        if old.space is not None and new.space is not None:
            edges += _in_space(old.space, new.space) if old.floor == new.floor else [EVERYWHERE]
        return cls(removed, added, np.concatenate(edges))

    def boxes(self, margin: float) -> list[Bounds]:
        """Return boxes (xmin, ymin, xmax, ymax) that hold all edges with a margin, metres.

        They do not meet each other, and each region that is free in one building alone lies in one
        of them.
        """
        return merged(self._around + np.array([-margin, -margin, margin, margin]))

    @cached_property
    def _around(self) -> Floats:
        """Boxes around the edges, shape (N, 4): of edges that meet there is one."""
        low = np.minimum(self.edges[:, :2], self.edges[:, 2:])
        high = np.maximum(self.edges[:, :2], self.edges[:, 2:])
        return np.array(merged(np.hstack([low, high]))).reshape(-1, 4)


def merged(boxes: Floats) -> list[Bounds]:
    """Merge boxes, shape (N, 4), that meet into their bounding box, until none do."""
    while True:
        outlines = shapely.box(*boxes.T)
        # Not their union: GEOS takes ten times as long where many of them lie on each other.
        first, second = shapely.STRtree(outlines).query(outlines)
        meet = coo_array((np.ones(len(first)), (first, second)), shape=(len(boxes), len(boxes)))
        count, group = connected_components(meet, directed=False)
        if count == len(boxes):
            return [(a, b, c, d) for a, b, c, d in boxes.tolist()]
        around = np.tile(EVERYWHERE[:, [2, 3, 0, 1]], (count, 1))
        np.minimum.at(around[:, :2], group, boxes[:, :2])
        np.maximum.at(around[:, 2:], group, boxes[:, 2:])
        boxes = around


def _rows(segments: Segments, other_segments: Segments) -> Floats:
    """Return the rows that the other array does not contain."""
    mine, theirs = (np.column_stack([part.xy, part.kind]) for part in (segments, other_segments))
    return np.asarray(segments.xy[_missing(mine, theirs)])


def _missing(rows: Floats, other_rows: Floats) -> Bools:
    """Return which rows the other array does not contain, bit for bit."""
    other_keys = set(row_keys(other_rows))
    return np.array([row not in other_keys for row in row_keys(rows)], dtype=np.bool_)


def _in_space(old: SpaceCaster, new: SpaceCaster) -> list[Floats]:
    """Return edges around all that one of two buildings alone has, seen from above."""
    if old.checksum == new.checksum:
        return []
    if comparable(old, new):
        assert isinstance(old, Prisms) and isinstance(new, Prisms)
        edges = [faces.xy for faces in changed_faces(old, new)]
        starts = [np.empty((0, 4)) if p.free is None else edges_of(p.free) for p in (old, new)]
        return edges + [part[~repeated(part, other)] for part, other in _both_ways(*starts)]
    if isinstance(old, Mesh) and isinstance(new, Mesh):
        faces = [mesh.triangles.reshape(-1, 9) for mesh in (old, new)]
        corners = [part[_missing(part, other)] for part, other in _both_ways(*faces)]
        around = np.concatenate(corners).reshape(-1, 3, 3)[..., :2]
        return [np.hstack([around.min(axis=1), around.max(axis=1)])]
    return [EVERYWHERE]


def comparable(old: SpaceCaster | None, new: SpaceCaster | None) -> bool:
    """Return whether two buildings are prisms between the same floor and ceiling."""
    if not (isinstance(old, Prisms) and isinstance(new, Prisms)):
        return False
    return (old.floor, old.ceiling) == (new.floor, new.ceiling)


def changed_faces(old: Prisms, new: Prisms, margin: float = 0.0) -> list[AddedWalls]:
    """Return the faces that the first alone of two buildings has, and those of the second alone.

    Each is wider by `margin` metres on all sides.
    """
    sheets = [np.column_stack(part.given).astype(np.float64) for part in (old, new)]
    solids = [{_key(solid): solid for solid in part.solids} for part in (old, new)]
    faces = []
    for k in range(2):
        rows = sheets[k][_missing(sheets[k], sheets[1 - k])]
        bodies = [solid for key, solid in solids[k].items() if key not in solids[1 - k]]
        outlines = [shapely.buffer(solid.outline, margin, join_style="mitre") for solid in bodies]
        edges = [_longer(row[None, :4], margin) for row in rows]
        edges += [edges_of(outline) for outline in outlines]
        z = [*rows[:, 4:6], *((solid.bottom, solid.top) for solid in bodies)]
        kinds = [*rows[:, 6], *(solid.kind for solid in bodies)]
        faces.append(
            AddedWalls.of(
                edges,
                kinds,
                [(low - margin, high + margin) for low, high in z],
                [False] * len(rows) + [True] * len(bodies),
            )
        )
    return faces


def _key(solid: Solid) -> tuple[object, ...]:
    return shapely.to_wkb(solid.outline), solid.bottom, solid.top, solid.kind


def _longer(edges: Floats, by: float) -> Floats:
    """Return edges, (n, 4), that are longer at both ends."""
    along = edges[:, 2:] - edges[:, :2]
    along *= by / np.linalg.norm(along, axis=1, keepdims=True)
    return edges + np.hstack([-along, along])


def _both_ways(first: Floats, second: Floats) -> tuple[tuple[Floats, Floats], ...]:
    return (first, second), (second, first)


def _body_edges(env: Environment) -> Floats:
    """Return edges that a footprint must not cross."""
    return edges_of(env.free if env.drivable is None else env.drivable)
