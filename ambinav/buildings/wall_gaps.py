"""Openings between walls: straight lines across a gap in which a wall continues."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.wall_bodies import THICKEST
from ambinav.runtime.array_types import Floats, Ints

DOORWAY: Final = 1.3
"""Metres; an end of a wall this near to another wall is the jamb of a door."""
WIDEST_MOUTH: Final = 6.5
"""Metres; an opening whose sides are no two ends of walls in line may be this wide."""
# Metres. Ends of walls this far beside each other are in line; corners have to be by less.
_BESIDE, _FLUSH = 0.5 * THICKEST, 0.05
# Cosines. Walls at a smaller angle go on in the same direction; a line that bends by less goes on;
# a door is within 60 degrees of straight ahead.
_SAME, _ON, _AHEAD = 0.98, math.cos(math.radians(20.0)), 0.5
# Metres. Nearer than this a ray is still at its start, and a point is still in the wall.
_START, _INSIDE = 1e-4, 2e-3
# Rays that are cast at a time.
_AT_ONCE: Final = 1000

END, CAP, CORNER = 0, 1, 2
"""Kinds of stubs: end of a wall, along it or across it; corner of a building."""


class Gaps(NamedTuple):
    """Straight lines across gaps, each a LineString.

    Attributes:
        inline: Between two ends of walls in line, and doors.
        facing: From an end of a wall to what it faces, wider than a door.
        mouths: Between corners, or between ends of walls side by side: a corridor that is open at
            its end, or the gap between two buildings.
    """

    inline: list[BaseGeometry]
    facing: list[BaseGeometry]
    mouths: list[BaseGeometry]


class _Stubs(NamedTuple):
    """Nodes where a line of the net ends or bends into free space, with directions and kinds."""

    node: Ints
    ahead: Floats
    kind: Ints


def gaps_in(net: BaseGeometry, solid: BaseGeometry) -> Gaps:
    """Find the lines along which walls continue across openings.

    Args:
        net: Borders of solids, and walls without thickness; lines, noded.
        solid: The solids, polygons.
    """
    ends = _segments(net)
    if not len(ends):
        return Gaps([], [], [])
    points, where = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    pairs = where.reshape(-1, 2)
    stubs = _stubs(points, pairs, solid)
    inline: list[BaseGeometry] = []
    facing: list[BaseGeometry] = []
    mouths: list[tuple[int, int, BaseGeometry]] = []
    jambs: set[int] = set()
    lines = shapely.linestrings(ends.reshape(-1, 2, 2))
    tree = shapely.STRtree(lines)
    far = float(np.hypot(*np.ptp(points, axis=0))) + 1.0
    for first in range(0, len(stubs.node), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        chosen = _Stubs(stubs.node[part], stubs.ahead[part], stubs.kind[part])
        faces = _first_hits(points, pairs, ends, tree, chosen, far)
        for stub in range(len(chosen.node)):
            here, there = (
                int(chosen.node[stub]),
                _facing_node(points, stubs, chosen, stub, float(faces[stub])),
            )
            if chosen.kind[stub] != END:
                if there is not None:
                    mouths.append((here, there, shapely.LineString(points[[here, there]])))
            elif there is not None:
                inline.append(shapely.LineString(points[[here, there]]))
                jambs |= {here, there}
            elif faces[stub] <= WIDEST_MOUTH:
                face = points[here] + faces[stub] * chosen.ahead[stub]
                line = shapely.LineString([points[here], face])
                (inline if faces[stub] <= DOORWAY else facing).append(line)
    return Gaps(
        [*inline, *_doors(points, pairs, ends, tree, stubs)],
        facing,
        # The jambs of two doors that face each other are no ends of walls side by side.
        [gap for a, b, gap in mouths if a not in jambs and b not in jambs],
    )


def _facing_node(points: Floats, stubs: _Stubs, chosen: _Stubs, k: int, face: float) -> int | None:
    """Return the node of the nearest stub that faces the k-th stub, at or before a face."""
    start, ahead, kind = points[chosen.node[k]], chosen.ahead[k], int(chosen.kind[k])
    away = points[stubs.node] - start
    along = away @ ahead
    beside = np.abs(away[:, 0] * ahead[1] - away[:, 1] * ahead[0])
    meets = (along > _START) & (stubs.ahead @ ahead < -_SAME)
    if kind == END:
        meets &= np.where(stubs.kind == END, beside <= _BESIDE, beside <= _FLUSH)
        meets &= stubs.kind != CAP
        slack = _BESIDE
    else:
        meets &= (beside <= _FLUSH) & (stubs.kind != END)
        if kind == CORNER:
            meets &= along <= WIDEST_MOUTH
        slack = _START
    meets &= along <= face + slack
    if not meets.any():
        return None
    return int(stubs.node[int(np.where(meets, along, np.inf).argmin())])


def _segments(net: BaseGeometry) -> Floats:
    """Return straight pieces of lines, (n, 4), without nodes at which a line goes straight on."""
    merged = shapely.get_parts(shapely.line_merge(net))
    pieces = []
    for line in shapely.simplify(merged, 1e-5):
        xy = shapely.get_coordinates(line)
        pieces.append(np.hstack([xy[:-1], xy[1:]]))
    return np.concatenate([np.empty((0, 4)), *pieces])


class _Net:
    """Nodes of lines, and the pairs that a line joins."""

    def __init__(self, points: Floats, pairs: Ints) -> None:
        self.points = points
        self.around: list[list[int]] = [[] for _ in points]
        for a, b in pairs.tolist():
            self.around[a].append(b)
            self.around[b].append(a)

    def run(self, start: int, end: int) -> tuple[Floats, float]:
        """Return direction and length of the line from one node to another."""
        away = self.points[end] - self.points[start]
        length = float(np.hypot(*away))
        return away / length, length

    def ends(self) -> list[tuple[int, int]]:
        """Return lines, as pairs of nodes, that no other line continues without a bend."""
        ends = []
        for here, others in enumerate(self.around):
            ahead = [self.run(other, here)[0] for other in others]
            for k, other in enumerate(others):
                if all(
                    float(-direction @ ahead[k]) <= _ON
                    for m, direction in enumerate(ahead)
                    if m != k
                ):
                    ends.append((other, here))
        return ends

    def beyond(self, here: int, other: int) -> int:
        """Return the other one of two nodes beside `here`, not `other`."""
        a, b = self.around[here]
        return b if a == other else a

    def is_cap(self, here: int, other: int, free: set[tuple[int, int]]) -> bool:
        """Return whether the line between two nodes closes the end of a wall.

        Args:
            here: A node.
            other: A node beside it.
            free: The lines, from and to, beyond which there is free space.
        """
        if len(self.around[here]) != 2 or len(self.around[other]) != 2:
            return False
        if self.run(here, other)[1] > THICKEST or not {(here, other), (other, here)} <= free:
            return False
        a, b = self.beyond(here, other), self.beyond(other, here)
        if (a, here) not in free or (b, other) not in free:
            return False
        return bool(self.run(a, here)[0] @ self.run(b, other)[0] > _SAME)


def _stubs(points: Floats, pairs: Ints, solid: BaseGeometry) -> _Stubs:
    """Find where lines may continue: beyond a node, neither along another line nor into a solid."""
    net = _Net(points, pairs)
    ends = net.ends()
    ahead = np.array([net.run(a, b)[0] for a, b in ends]).reshape(-1, 2)
    probes = points[[b for _, b in ends]].reshape(-1, 2) + _INSIDE * ahead
    shapely.prepare(solid)
    free = {
        end for end, hit in zip(ends, shapely.contains_xy(solid, probes), strict=True) if not hit
    }
    stubs: list[tuple[int, Floats, int]] = []
    for end, direction in zip(ends, ahead, strict=True):
        if end not in free:
            continue
        other, here = end
        end_kind = CORNER
        if len(net.around[here]) == 1:
            end_kind = END
            across = np.array([-direction[1], direction[0]])
            stubs += [(here, across, CAP), (here, -across, CAP)]
        elif len(net.around[here]) == 2:
            if net.is_cap(here, net.beyond(here, other), free):
                end_kind = END
            elif net.is_cap(here, other, free):
                end_kind = CAP
        stubs.append((here, direction, end_kind))
    return _Stubs(
        np.array([node for node, _, _ in stubs], dtype=np.int64),
        np.array([direction for _, direction, _ in stubs]).reshape(-1, 2),
        np.array([end_kind for _, _, end_kind in stubs], dtype=np.int64),
    )


def _first_hits(
    points: Floats, pairs: Ints, ends: Floats, tree: shapely.STRtree, chosen: _Stubs, far: float
) -> Floats:
    """Compute the distance ahead of each stub to the first line; inf if there is none."""
    start = points[chosen.node]
    rays = shapely.linestrings(np.stack([start, start + far * chosen.ahead], axis=1))
    ray, line = tree.query(rays, predicate="intersects")
    a, b = ends[line, :2], ends[line, 2:]
    run, d = b - a, chosen.ahead[ray]
    cross = d[:, 0] * run[:, 1] - d[:, 1] * run[:, 0]
    offset = a - start[ray]
    along = (offset[:, 0] * run[:, 1] - offset[:, 1] * run[:, 0]) / np.where(cross, cross, np.nan)
    # Lines that run along are met at their ends, by others.
    is_own_line = (pairs[line] == chosen.node[ray][:, np.newaxis]).any(axis=1)
    real = ~is_own_line & (along > _START) & (np.abs(cross) > 1e-6 * np.hypot(run[:, 0], run[:, 1]))
    first = np.full(len(start), np.inf)
    np.minimum.at(first, ray[real], along[real])
    return first


def _doors(
    points: Floats, pairs: Ints, ends: Floats, tree: shapely.STRtree, stubs: _Stubs
) -> list[BaseGeometry]:
    """Return the shortest line from each wall end to another wall ahead, up to `DOORWAY`."""
    is_end = np.flatnonzero(stubs.kind == END)
    start = points[stubs.node[is_end]]
    stub, line = tree.query(shapely.points(start), predicate="dwithin", distance=DOORWAY)
    a, run = ends[line, :2], ends[line, 2:] - ends[line, :2]
    share = ((start[stub] - a) * run).sum(axis=1) / (run * run).sum(axis=1)
    near = a + np.clip(share, 0.0, 1.0)[:, np.newaxis] * run
    away = near - start[stub]
    length = np.hypot(away[:, 0], away[:, 1])
    ahead = (away * stubs.ahead[is_end[stub]]).sum(axis=1) >= _AHEAD * length
    is_own_line = (pairs[line] == stubs.node[is_end[stub]][:, np.newaxis]).any(axis=1)
    fits = np.flatnonzero(ahead & ~is_own_line & (length > _START))
    order = fits[np.lexsort((length[fits], stub[fits]))]
    _, first = np.unique(stub[order], return_index=True)
    return [shapely.LineString([start[stub[k]], near[k]]) for k in order[first]]
