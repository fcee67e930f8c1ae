"""Outline of a building that is drawn by its walls: the inside and the outside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.mesh_section import GRAIN
from ambinav.buildings.wall_gaps import DOORWAY, Gaps, gaps_in
from ambinav.geometry.edit import polygons_of
from ambinav.runtime.array_types import Bools

# Shares of its border by which a space may be open to the outside: any, and one into which two
# openings or more lead, or that stands alone.
_OPEN, _OPEN_HALL = 0.2, 1.0 / 3.0
# Metres; the grid of the lines, and how near a piece lies to the line that it is of.
_NEAR: Final = 1e-4
# Metres; a shorter stretch of a border is a touch. Square metres; less floor is none.
_TOUCH, _DOOR, _ROOM = 0.1, 0.05, 1.0


class Outline(NamedTuple):
    """Area that a building encloses.

    Attributes:
        region: Its walls and all that is within, polygons.
        mouths: Openings to the outside that are wider than a door, lines.
        outside: Spaces behind openings that count as outside, polygons,
        doubtful: and those of them into which two openings or more lead.
    """

    region: BaseGeometry
    mouths: list[BaseGeometry]
    outside: list[BaseGeometry]
    doubtful: list[BaseGeometry]


def outline_of(
    solids: Sequence[BaseGeometry],
    walls: Sequence[BaseGeometry],
    leaves: Sequence[BaseGeometry] = (),
    edges: Sequence[BaseGeometry] = (),
) -> Outline:
    """Find the inside of a building whose walls are known, and its openings.

    Within is what walls, shut doors and edges of floors enclose once walls go on across gaps in
    line (`gaps_in`). A space that is open between corners, or between the end of a wall and what
    it faces, is within if a fifth of its border at the most is open, a third where two openings
    lead into it or it stands alone (of the second kind twice as much); and if from each building
    beside it an opening leads into it. A corridor is, a niche in a front or the gap between two
    buildings is not.

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
    doubtful: list[BaseGeometry] = []
    if gaps.facing or gaps.mouths:
        accepted, outside, doubtful = _spaces(closed, gaps, within, solid, net)
    region = shapely.union_all([within, *accepted], grid_size=GRAIN)
    border = shapely.boundary(region)
    openings = shapely.union_all([*gaps.inline, *gaps.facing, *gaps.mouths], grid_size=GRAIN)
    bare = shapely.difference(openings, shapely.union_all([net, *leaves, *edges]), grid_size=GRAIN)
    rim = shapely.line_merge(shapely.intersection(bare, border, grid_size=GRAIN))
    mouths = [line for line in shapely.get_parts(rim) if line.length > DOORWAY]
    return Outline(region, mouths, outside, doubtful)


def _faces(net: BaseGeometry) -> NDArray[np.object_]:
    return np.asarray(shapely.get_parts(shapely.polygonize(shapely.get_parts(net).tolist())))


def _spaces(
    closed: BaseGeometry, gaps: Gaps, within: BaseGeometry, solid: BaseGeometry, net: BaseGeometry
) -> tuple[list[BaseGeometry], list[BaseGeometry], list[BaseGeometry]]:
    """Classify spaces behind openings: inside, outside, and those that may be either."""
    every = shapely.union_all([closed, *gaps.facing, *gaps.mouths], grid_size=GRAIN)
    faces = _faces(every)
    shapely.prepare(within)
    faces = faces[~shapely.contains(within, shapely.point_on_surface(faces))]
    if not len(faces):
        return [], [], []
    pieces = shapely.get_parts(every)
    length = shapely.length(pieces)
    middles = shapely.line_interpolate_point(pieces, 0.5, normalized=True)
    is_mouth = ~_on(closed, middles)
    is_wall = _on(net, middles)
    faces_one = is_mouth & _on(shapely.union_all(gaps.facing), middles)
    open_ = length * is_mouth * np.where(faces_one, 0.5, 1.0)
    piece, face = shapely.STRtree(faces).query(middles, predicate="dwithin", distance=_NEAR)
    # Faces on both sides of a mouth are one space.
    across = coo_array((is_mouth[piece], (face, piece)), shape=(len(faces), len(pieces))).tocsr()
    _, space = connected_components(across @ across.T, directed=False)
    buildings = shapely.get_parts(within)
    has_floor = shapely.area(shapely.difference(buildings, solid)) > _ROOM
    beside, building = shapely.STRtree(buildings).query(
        middles, predicate="dwithin", distance=_NEAR
    )
    inside: list[BaseGeometry] = []
    outside: list[BaseGeometry] = []
    doubtful: list[BaseGeometry] = []
    for index in range(int(space.max()) + 1):
        mine, sides = np.unique(piece[space[face] == index], return_counts=True)
        rim = mine[sides == 1]
        near = np.isin(beside, rim)
        leads = near & ~is_wall[beside]
        # Both sides of a gap may be joined by two lines, which differ by rounding.
        doors = shapely.buffer(shapely.union_all(pieces[np.unique(beside[leads])]), _DOOR)
        neighbours = [
            k
            for k in np.unique(building[near]).tolist()
            if has_floor[k] and length[beside[near & (building == k)]].sum() > _TOUCH
        ]
        share = open_[rim].sum() / length[rim].sum()
        several = not doors.is_empty and shapely.get_num_geometries(doors) > 1
        hall = not neighbours or several
        belongs = share <= (_OPEN_HALL if hall else _OPEN)
        if len(neighbours) > 1 or (is_mouth & ~faces_one)[rim].any():
            belongs &= all((leads & (building == k)).any() for k in neighbours)
        kind = inside if belongs else doubtful if several else outside
        kind.append(shapely.union_all(faces[space == index]))
    return inside, outside, doubtful


def _on(lines: BaseGeometry, points: NDArray[np.object_]) -> Bools:
    """Return the mask of the points that lie on lines."""
    on_line = np.zeros(len(points), dtype=np.bool_)
    tree = shapely.STRtree(shapely.get_parts(lines))
    on_line[tree.query(points, predicate="dwithin", distance=_NEAR)[0]] = True
    return on_line
