"""The outline of a building that is drawn by its walls: what lies within, and what beyond."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.edit import polygons_of
from ambinav.geometry.io.mesh_section import GRAIN
from ambinav.geometry.io.wall_gaps import DOORWAY, gaps_in

# Shares of its border by which a space may be open to the outside: any, and one into which two
# openings or more lead, or that stands alone.
_OPEN, _OPEN_HALL = 0.2, 1.0 / 3.0
# Metres; the grid of the lines, and how near a piece lies to the line that it is of.
_NEAR: Final = 1e-4
# Metres; a shorter stretch of a border is a touch. Square metres; less floor is none.
_TOUCH, _ROOM = 0.1, 1.0


class Outline(NamedTuple):
    """What a building encloses.

    Attributes:
        region: Its walls and all that is within, polygons.
        mouths: Openings to the outside that are wider than a door, lines.
        outside: Spaces behind openings that count as outside, polygons.
    """

    region: BaseGeometry
    mouths: list[BaseGeometry]
    outside: list[BaseGeometry]


def outline_of(
    solids: Sequence[BaseGeometry],
    walls: Sequence[BaseGeometry],
    leaves: Sequence[BaseGeometry] = (),
    edges: Sequence[BaseGeometry] = (),
) -> Outline:
    """Find what lies within a building whose walls are known, and its openings.

    Within is what walls, shut doors and edges of floors enclose once walls go on across their gaps
    (`gaps_in`). A space that is open at its end, between corners, is within if a fifth of its border
    at the most is open, or a third where two openings or more lead into it; and if from each
    building beside it an opening leads into it: a corridor is, a niche in a front or the gap
    between two buildings is not.

    Args:
        solids: Polygons.
        walls: Lines without thickness.
        leaves: Doors, shut: lines.
        edges: Edges of floor: lines.
    """
    solid = polygons_of(shapely.union_all(list(solids), grid_size=GRAIN))
    net = shapely.union_all([shapely.boundary(solid), *walls], grid_size=GRAIN)
    gaps = gaps_in(net, solid)
    closed = shapely.union_all([net, *leaves, *edges, *gaps.inline], grid_size=GRAIN)
    within = shapely.union_all([*_faces(closed), solid], grid_size=GRAIN)
    outside: list[BaseGeometry] = []
    accepted: list[BaseGeometry] = []
    if gaps.mouths:
        accepted, outside = _spaces(closed, gaps.mouths, within, solid, net)
    region = shapely.union_all([within, *accepted], grid_size=GRAIN)
    border = shapely.boundary(region)
    openings = shapely.union_all([*gaps.inline, *gaps.mouths], grid_size=GRAIN)
    bare = shapely.difference(openings, shapely.union_all([net, *leaves, *edges]), grid_size=GRAIN)
    rim = shapely.line_merge(shapely.intersection(bare, border, grid_size=GRAIN))
    mouths = [line for line in shapely.get_parts(rim) if line.length > DOORWAY]
    return Outline(region, mouths, outside)


def _faces(net: BaseGeometry) -> NDArray[np.object_]:
    return shapely.get_parts(shapely.polygonize(shapely.get_parts(net).tolist()))


def _spaces(
    closed: BaseGeometry,
    mouths: Sequence[BaseGeometry],
    within: BaseGeometry,
    solid: BaseGeometry,
    net: BaseGeometry,
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Spaces behind mouths: those that are within, and the others."""
    every = shapely.union_all([closed, *mouths], grid_size=GRAIN)
    faces = _faces(every)
    inner = shapely.point_on_surface(faces)
    shapely.prepare(within)
    faces = faces[~shapely.contains(within, inner)]
    if not len(faces):
        return [], []
    pieces = shapely.get_parts(every)
    middles = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
    is_mouth = ~shapely.dwithin(closed, middles, _NEAR)
    tree = shapely.STRtree(faces)
    piece, face = tree.query(middles, predicate="dwithin", distance=_NEAR)
    # Faces on both sides of a mouth are one space.
    root = list(range(len(faces)))

    def top(k: int) -> int:
        while root[k] != k:
            root[k] = root[root[k]]
            k = root[k]
        return k

    sides: dict[int, list[int]] = {}
    for p, f in zip(piece.tolist(), face.tolist(), strict=True):
        if is_mouth[p]:
            sides.setdefault(p, []).append(f)
    for both in sides.values():
        for other in both[1:]:
            root[top(both[0])] = top(other)
    buildings = [
        (one, shapely.difference(one, solid).area > _ROOM) for one in shapely.get_parts(within)
    ]
    walls = shapely.buffer(net, _NEAR)
    inside, outside = [], []
    for group in sorted({top(k) for k in range(len(faces))}):
        space = shapely.union_all(faces[[top(k) == group for k in range(len(faces))]])
        belongs = _is_within(space, closed, buildings, walls, within)
        (inside if belongs else outside).append(space)
    return inside, outside


def _is_within(
    space: BaseGeometry,
    closed: BaseGeometry,
    buildings: Sequence[tuple[BaseGeometry, bool]],
    walls: BaseGeometry,
    within: BaseGeometry,
) -> bool:
    border = shapely.boundary(space)
    open_ = shapely.difference(border, shapely.buffer(closed, _NEAR)).length
    share = open_ / border.length
    # Openings: where floor within borders on it and no wall is between.
    bare = shapely.difference(border, walls)
    leading = shapely.line_merge(shapely.intersection(bare, shapely.buffer(within, _NEAR)))
    doors = [part for part in shapely.get_parts(leading) if part.length > 0.5 * _TOUCH]
    alone = True
    for building, has_floor in buildings:
        near = shapely.buffer(building, _NEAR)
        if not has_floor or shapely.intersection(border, near).length < _TOUCH:
            continue
        alone = False
        if not any(shapely.intersects(near, door) for door in doors):
            return False
    return bool(share <= (_OPEN_HALL if alone or len(doors) > 1 else _OPEN))
