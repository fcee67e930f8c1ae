"""Openings between walls: where a wall that ends goes on, as straight lines across the gap."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.io.wall_bodies import THICKEST

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
_AT_ONCE: Final = 1000

END, CAP, CORNER = 0, 1, 2
"""Where a line may go on: an end of a wall, along it or across it; a corner of a building."""


class Gaps(NamedTuple):
    """Straight lines, each a LineString.

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
    """Where a line of the net ends, or bends into free space: nodes, directions and kinds."""

    node: NDArray[np.int64]
    ahead: NDArray[np.float64]
    kind: NDArray[np.int64]


def gaps_in(net: BaseGeometry, solid: BaseGeometry) -> Gaps:
    """The lines by which walls go on across openings.

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
        some = _Stubs(*(part[first : first + _AT_ONCE] for part in stubs))
        faces = _first_hits(points, pairs, ends, tree, some, far)
        for stub in range(len(some.node)):
            here, there = int(some.node[stub]), _met(points, stubs, some, stub, float(faces[stub]))
            if some.kind[stub] != END:
                if there is not None:
                    mouths.append((here, there, shapely.LineString(points[[here, there]])))
            elif there is not None:
                inline.append(shapely.LineString(points[[here, there]]))
                jambs |= {here, there}
            elif faces[stub] <= WIDEST_MOUTH:
                face = points[here] + faces[stub] * some.ahead[stub]
                line = shapely.LineString([points[here], face])
                (inline if faces[stub] <= DOORWAY else facing).append(line)
    return Gaps(
        [*inline, *_doors(points, pairs, ends, tree, stubs)],
        facing,
        # The jambs of two doors that face each other are no ends of walls side by side.
        [gap for a, b, gap in mouths if a not in jambs and b not in jambs],
    )


def _met(
    points: NDArray[np.float64], stubs: _Stubs, some: _Stubs, k: int, face: float
) -> int | None:
    """The node of the nearest stub that comes to meet the k-th of some, before or at a face."""
    start, ahead, kind = points[some.node[k]], some.ahead[k], int(some.kind[k])
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


def _segments(net: BaseGeometry) -> NDArray[np.float64]:
    """Straight pieces of lines, shape (n, 4), without nodes at which a line goes straight on."""
    merged = shapely.get_parts(shapely.line_merge(net))
    pieces = []
    for line in shapely.simplify(merged, 1e-5):
        xy = shapely.get_coordinates(line)
        pieces.append(np.hstack([xy[:-1], xy[1:]]))
    return np.concatenate([np.empty((0, 4)), *pieces])


def _stubs(
    points: NDArray[np.float64], pairs: NDArray[np.int64], solid: BaseGeometry
) -> _Stubs:
    """Where lines may go on: beyond a node, neither along another line nor into a solid."""
    around: list[list[int]] = [[] for _ in points]
    for a, b in pairs.tolist():
        around[a].append(b)
        around[b].append(a)
    towards = {}
    for node, others in enumerate(around):
        for other in others:
            run = points[node] - points[other]
            towards[other, node] = run / np.hypot(*run), float(np.hypot(*run))
    node, ahead, kind, back = [], [], [], []
    for (other, here), (direction, _) in towards.items():
        leaving = [-towards[third, here][0] for third in around[here] if third != other]
        if any(float(one @ direction) > _ON for one in leaving):
            continue
        node.append(here)
        ahead.append(direction)
        back.append(other)
    probes = np.array([points[n] + _INSIDE * d for n, d in zip(node, ahead, strict=True)])
    shapely.prepare(solid)
    free = ~shapely.contains_xy(solid, probes) if len(probes) else np.empty(0, dtype=np.bool_)
    open_ = {(b, n) for b, n, f in zip(back, node, free, strict=True) if f}

    def is_cap(here: int, other: int) -> bool:
        """Whether the line between two nodes closes the end of a wall."""
        if len(around[here]) != 2 or len(around[other]) != 2:
            return False
        if towards[other, here][1] > THICKEST or not {(here, other), (other, here)} <= open_:
            return False
        sides = []
        for one, away in ((here, other), (other, here)):
            (third,) = [n for n in around[one] if n != away] or [away]
            if (third, one) not in open_:
                return False
            sides.append(towards[third, one][0])
        return bool(sides[0] @ sides[1] > _SAME)

    found: list[tuple[int, NDArray[np.float64], int]] = []
    for here, direction, other, is_free in zip(node, ahead, back, free, strict=True):
        if not is_free:
            continue
        what = CORNER
        if len(around[here]) == 1:
            what = END
            across = np.array([-direction[1], direction[0]])
            found += [(here, across, CAP), (here, -across, CAP)]
        elif len(around[here]) == 2:
            (third,) = [n for n in around[here] if n != other] or [other]
            if is_cap(here, third):
                what = END
            elif is_cap(here, other):
                what = CAP
        found.append((here, direction, what))
    return _Stubs(
        np.array([one[0] for one in found], dtype=np.int64),
        np.array([one[1] for one in found]).reshape(-1, 2),
        np.array([one[2] for one in found], dtype=np.int64),
    )


def _first_hits(
    points: NDArray[np.float64],
    pairs: NDArray[np.int64],
    ends: NDArray[np.float64],
    tree: shapely.STRtree,
    some: _Stubs,
    far: float,
) -> NDArray[np.float64]:
    """How far ahead of each stub the first line crosses; inf where none does."""
    start = points[some.node]
    rays = shapely.linestrings(np.stack([start, start + far * some.ahead], axis=1))
    ray, line = tree.query(rays, predicate="intersects")
    a, b = ends[line, :2], ends[line, 2:]
    run, d = b - a, some.ahead[ray]
    cross = d[:, 0] * run[:, 1] - d[:, 1] * run[:, 0]
    offset = a - start[ray]
    along = (offset[:, 0] * run[:, 1] - offset[:, 1] * run[:, 0]) / np.where(cross, cross, np.nan)
    # Lines that run along are met at their ends, by others.
    own = (pairs[line] == some.node[ray][:, np.newaxis]).any(axis=1)
    real = ~own & (along > _START) & (np.abs(cross) > 1e-6 * np.hypot(run[:, 0], run[:, 1]))
    first = np.full(len(start), np.inf)
    np.minimum.at(first, ray[real], along[real])
    return first


def _doors(
    points: NDArray[np.float64],
    pairs: NDArray[np.int64],
    ends: NDArray[np.float64],
    tree: shapely.STRtree,
    stubs: _Stubs,
) -> list[BaseGeometry]:
    """The shortest line from each end of a wall to another wall ahead of it, up to `DOORWAY`."""
    is_end = np.flatnonzero(stubs.kind == END)
    start = points[stubs.node[is_end]]
    stub, line = tree.query(shapely.points(start), predicate="dwithin", distance=DOORWAY)
    a, run = ends[line, :2], ends[line, 2:] - ends[line, :2]
    share = ((start[stub] - a) * run).sum(axis=1) / (run * run).sum(axis=1)
    near = a + np.clip(share, 0.0, 1.0)[:, np.newaxis] * run
    away = near - start[stub]
    length = np.hypot(away[:, 0], away[:, 1])
    ahead = (away * stubs.ahead[is_end[stub]]).sum(axis=1) >= _AHEAD * length
    own = (pairs[line] == stubs.node[is_end[stub]][:, np.newaxis]).any(axis=1)
    fits = np.flatnonzero(ahead & ~own & (length > _START))
    order = fits[np.lexsort((length[fits], stub[fits]))]
    _, first = np.unique(stub[order], return_index=True)
    return [shapely.LineString([start[stub[k]], near[k]]) for k in order[first]]
