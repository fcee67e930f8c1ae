"""Edits of a building: added obstacles and removed parts, with new free space and segments.

Whatever the edit does not touch stays as it is to the last bit, segments in their order, so that
what changed is a difference of rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.config import check_kind
from ambinav.geometry.border_cover import bare_pieces, meeting, repeated
from ambinav.geometry.obstacle import Obstacle, checked_outline
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from ambinav.geometry.segments import REFLECTOR, WALL, Segments, edges_of
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.runtime.errors import InputError

# Metres. What is this near to the border lies on it (as in `Environment`).
ON_BORDER: Final = 1e-6
# Metres. A drawn line this near to a wall lies along it.
NEAR: Final = 1e-3
# Metres. Shorter pieces of a line merely touch the floor.
SHORTEST: Final = 1e-2
# Square metres. Smaller pieces of floor come from rounding.
SLIVER: Final = 1e-6
# Metres. A corner this near to an edge of the floor lies on it but for rounding.
ON_EDGE: Final = 1e-9
# Half of what a wall without thickness takes from where footprints may be, metres.
HALF_WALL: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Building:
    """Fields of an environment that an edit may change; see `Environment` for each."""

    segments: Segments
    free: BaseGeometry
    drivable: BaseGeometry | None
    occupancy: OccupancyGrid | None
    name: str


def applied(
    before: Building, add: Sequence[Obstacle], remove: BaseGeometry | None
) -> tuple[Building, bool]:
    """Return the building without a shape and with obstacles added, and whether it differs.

    Where it does not it is the one before, to the last bit.

    Raises:
        InputError: see `removed` and `obstructed`.
    """
    after = before if remove is None else removed(before, remove)
    if len(add):
        after = obstructed(after, add)
    changed = not after.segments.same_as(before.segments)
    if before.drivable is not None and after.drivable is not None:
        changed |= abs(after.drivable.area - before.drivable.area) > SLIVER
    return (after if changed else before), bool(changed)


def removed(building: Building, shape: BaseGeometry) -> Building:
    """Return the building with floor everywhere in a Polygon or MultiPolygon.

    Where its edge lies in what is solid or unknown, a wall stands afterwards.

    Raises:
        InputError: it is of another type, crosses itself, or a coordinate is not finite.
    """
    if not isinstance(shape, shapely.Polygon | shapely.MultiPolygon):
        raise InputError(
            f"{building.name}: what is to be removed is a "
            f"{getattr(shape, 'geom_type', type(shape).__name__)}; give a Polygon."
        )
    shape = checked_outline(shape, f"{building.name}: remove")
    drivable, grid = building.drivable, building.occupancy
    return replace(
        _with_floor(building, polygons_of(shapely.union(building.free, shape)), shape, []),
        drivable=None if drivable is None else polygons_of(shapely.union(drivable, shape)),
        occupancy=None if grid is None else _with_cell_state(grid, shape, FREE),
    )


def obstructed(building: Building, obstacles: Sequence[Obstacle]) -> Building:
    """Return the building with obstacles on its floor.

    Raises:
        InputError: one does not lie on the floor, not even in part, or no floor is left.
    """
    for obstacle in obstacles:
        check_kind(
            obstacle, Obstacle, "an obstacle", "make one by `Obstacle.post`, `panel` or `wall`"
        )
    solids = [obstacle for obstacle in obstacles if obstacle.solid]
    for obstacle in solids:
        share = shapely.intersection(building.free, obstacle.outline).area / obstacle.outline.area
        _check_on_floor(building, obstacle, share)
    if solids:
        building = _cut(building, solids)
    for obstacle in obstacles:
        if not obstacle.solid:
            building = _with_thin_wall(building, obstacle)
    return building


def _cut(building: Building, solids: Sequence[Obstacle]) -> Building:
    """Return the building without the floor under solid obstacles."""
    solid = shapely.union_all([obstacle.outline for obstacle in solids])
    free = polygons_of(shapely.difference(building.free, solid))
    if free.is_empty:
        raise InputError(
            f"{building.name}: the obstacles cover all of its floor; make them smaller."
        )
    faces = [obstacle.outline.boundary for obstacle in solids if obstacle.reflective]
    drivable, grid = building.drivable, building.occupancy
    return replace(
        _with_floor(building, free, solid, faces),
        drivable=None if drivable is None else polygons_of(shapely.difference(drivable, solid)),
        occupancy=None if grid is None else _with_cell_state(grid, solid, OCCUPIED),
    )


def _with_floor(
    building: Building, free: BaseGeometry, shape: BaseGeometry, bright: Sequence[BaseGeometry]
) -> Building:
    """Return the building with another free space, which differs only within `shape`.

    Args:
        building: Before.
        free: The free space afterwards.
        shape: Segments that keep off it stay.
        bright: Lines on which new segments are reflectors.
    """
    old = building.segments
    shapely.prepare(shape)
    near = meeting(old.xy, shape.bounds)
    met = near[shapely.intersects(shape, shapely.linestrings(old.xy[near].reshape(-1, 2, 2)))]
    thin = met[_inside(old.xy[met], building.free)]
    border = np.setdiff1d(met, thin)
    pieces: dict[int, Floats] = {}
    for k in thin.tolist():
        left = shapely.difference(shapely.LineString(old.xy[k].reshape(2, 2)), shape)
        if left.length < old.lengths[k] - ON_BORDER:
            pieces[k] = straight(left)
    owner, start, end = bare_pieces(old.xy[border], edges_of(free), ON_BORDER)
    for k in np.unique(owner).tolist():
        row, mine = old.xy[border[k]], owner == k
        ends = np.column_stack([start[mine], end[mine]])
        ends = ends[(ends[:, 1] - ends[:, 0]) * np.hypot(*(row[2:] - row[:2])) > 2.0 * ON_BORDER]
        # A part that lies behind a new obstacle does no harm; in the floor it would be a wall.
        is_removed = _inside(between(row, ends), free)
        left = between(row, complement(ends))
        if is_removed.any() or not len(left):
            pieces[int(border[k])] = left
    stays = np.ones(len(old), dtype=np.bool_)
    stays[list(pieces)] = False
    cut = np.concatenate([np.empty((0, 4)), *pieces.values()])
    kinds = np.repeat(old.kind[list(pieces)], [len(piece) for piece in pieces.values()])
    segments = np.concatenate([old.xy[stays], cut])
    edges = edges_of(free)
    edges = edges[~repeated(edges, segments)]
    owner, start, end = bare_pieces(edges, segments, ON_BORDER)
    fresh = np.concatenate(
        [np.empty((0, 4)), *map(between, edges[owner], np.column_stack([start, end])[:, None])]
    )
    fresh = fresh[np.hypot(*(fresh[:, 2:] - fresh[:, :2]).T) > 2.0 * ON_BORDER]
    lit = shapely.dwithin(shapely.union_all(bright), _middles(fresh), ON_BORDER)
    kinds = np.concatenate([old.kind[stays], kinds, np.where(lit, REFLECTOR, WALL)])
    return replace(building, segments=Segments(np.concatenate([segments, fresh]), kinds), free=free)


def _with_thin_wall(building: Building, obstacle: Obstacle) -> Building:
    """Return the building with a wall without thickness on the floor, or a tag on a wall."""
    line, drivable = obstacle.outline, building.drivable
    pieces = on_floor(line, building.free)
    tagged = _with_reflectors(building, line) if obstacle.reflective else building
    if tagged is building:
        _check_on_floor(building, obstacle, float(len(pieces)))
    if len(pieces) == 0:
        return tagged
    old, grid = tagged.segments, building.occupancy
    if drivable is not None:
        walls = shapely.union_all(shapely.linestrings(pieces.reshape(-1, 2, 2)))
        drivable = polygons_of(shapely.difference(drivable, shapely.buffer(walls, HALF_WALL)))
    kind = np.full(len(pieces), REFLECTOR if obstacle.reflective else WALL, dtype=np.uint8)
    return replace(
        tagged,
        segments=Segments(np.concatenate([old.xy, pieces]), np.concatenate([old.kind, kind])),
        drivable=drivable,
        occupancy=None if grid is None else _with_cell_state(grid, line, OCCUPIED),
    )


def on_floor(line: BaseGeometry, free: BaseGeometry) -> Floats:
    """Return the straight pieces of a line on the floor that lie along no wall, shape (n, 4)."""
    pieces = straight(shapely.intersection(line, free))
    pieces = pieces[~shapely.dwithin(free.boundary, _middles(pieces), NEAR)]
    long: Floats = pieces[np.hypot(*(pieces[:, 2:] - pieces[:, :2]).T) > SHORTEST]
    return long


def _with_reflectors(building: Building, line: BaseGeometry) -> Building:
    """Return the building with the walls along a line as reflectors; itself if there are none."""
    old = building.segments
    lines = shapely.linestrings(old.xy.reshape(-1, 2, 2))
    near = np.flatnonzero(shapely.dwithin(line, lines, NEAR))
    owner, start, end = bare_pieces(old.xy[near], straight(line), NEAR)
    stays = np.ones(len(old), dtype=np.bool_)
    rows, kinds = [np.empty((0, 4))], [old.kind[:0]]
    for k in range(len(near)):
        row = old.xy[near[k]]
        length = np.hypot(*(row[2:] - row[:2]))
        ends = np.column_stack([start[owner == k], end[owner == k]])
        covered = complement(ends[(ends[:, 1] - ends[:, 0]) * length > SHORTEST])
        covered = covered[(covered[:, 1] - covered[:, 0]) * length > SHORTEST]
        if len(covered):
            stays[near[k]] = False
            bare = between(row, complement(covered))
            rows += [bare, between(row, covered)]
            kinds.append(np.full(len(bare), old.kind[near[k]]))
            kinds.append(np.full(len(covered), REFLECTOR))
    if stays.all():
        return building
    fresh = np.concatenate(rows)
    # An edge of the free space is of one kind: scans take it to be.
    corners = shapely.multipoints(np.unique(fresh.reshape(-1, 2), axis=0))
    return replace(
        building,
        segments=Segments(
            np.concatenate([old.xy[stays], fresh]), np.concatenate([old.kind[stays], *kinds])
        ),
        free=shapely.snap(building.free, corners, ON_EDGE),
    )


def _check_on_floor(building: Building, obstacle: Obstacle, share: float) -> None:
    """Raise `InputError` for an obstacle that is not on the floor, apart from rounding."""
    if not share > ON_EDGE:
        x, y = shapely.get_coordinates(obstacle.outline)[0].tolist()
        raise InputError(
            f"{building.name}: the obstacle at ({x:g}, {y:g}) is outside the floor; put it within "
            "the free space."
        )


def polygons_of(shape: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a shape, without slivers."""
    parts = shapely.get_parts(shapely.get_parts(shape))
    parts = parts[(shapely.get_dimensions(parts) == 2) & (shapely.area(parts) > SLIVER)]
    return parts[0] if len(parts) == 1 else shapely.multipolygons(parts)


def _middles(rows: Floats) -> NDArray[np.object_]:
    return np.asarray(shapely.points((rows[:, :2] + rows[:, 2:]) / 2))


def _inside(rows: Floats, free: BaseGeometry) -> Bools:
    """Return the mask of rows whose middle lies in the free space, off its border."""
    shapely.prepare(free)
    middle = _middles(rows)
    inside: Bools = shapely.contains(free, middle)
    inside &= ~shapely.dwithin(free.boundary, middle, ON_BORDER)
    return inside


def straight(shape: BaseGeometry) -> Floats:
    """Return the straight pieces of the lines in a shape, shape (n, 4)."""
    parts = shapely.get_parts(shapely.get_parts(shape))
    lines = parts[shapely.get_dimensions(parts) == 1]
    xy, line = shapely.get_coordinates(lines, return_index=True)
    pieces: Floats = np.hstack([xy[:-1], xy[1:]])[line[:-1] == line[1:]]
    return pieces


def complement(ends: Floats) -> Floats:
    """Return the parts of [0, 1] outside of ascending intervals, each of shape (n, 2)."""
    inner = np.concatenate([[0.0], ends.ravel(), [1.0]]).reshape(-1, 2)
    return inner[inner[:, 1] > inner[:, 0]]


def between(row: Floats, ends: Floats) -> Floats:
    """Return pieces of a row by start and end shares; the row's own ends stay exact."""
    a, b = row[:2], row[2:]
    at = a + ends[:, :, None] * (b - a)
    at[ends == 0.0], at[ends == 1.0] = a, b
    return at.reshape(-1, 4)


def _with_cell_state(grid: OccupancyGrid, shape: BaseGeometry, state: int) -> OccupancyGrid:
    """Return the grid with another state in the cells that a shape meets.

    For `free`, those whose centre it contains.
    """
    painted = grid.state.copy()
    # Part by part: between parts that are far apart lie all cells of a map.
    for part in shapely.get_parts(shape):
        _paint(grid, painted, part, state)
    return replace(grid, state=painted, checksum="")


def _paint(grid: OccupancyGrid, states: Bytes, shape: BaseGeometry, state: int) -> None:
    """Write a state to the cells that a shape meets; arguments as of `_with_cell_state`."""
    xmin, ymin, xmax, ymax = shape.bounds
    columns, rows = grid.to_cells(
        np.array([xmin, xmax, xmax, xmin]), np.array([ymin, ymin, ymax, ymax])
    )
    low = np.maximum(np.floor([rows.min(), columns.min()]).astype(int), 0)
    high = np.floor([rows.max(), columns.max()]).astype(int) + 1
    window = states[tuple(slice(a, max(a, b)) for a, b in zip(low, high, strict=True))]
    row, column = np.indices(window.shape) + low[:, None, None]
    shapely.prepare(shape)
    if state == FREE:
        met = shapely.contains_xy(shape, *grid.to_world(column + 0.5, row + 0.5))
    else:
        corner = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
        squares = np.stack([np.stack(grid.to_world(*at), axis=-1) for at in corner], axis=-2)
        met = shapely.intersects(shape, shapely.polygons(squares))
    window[met] = state
