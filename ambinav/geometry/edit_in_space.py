"""Edits of a building in space: what stands in a removed part goes, obstacles get heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Protocol

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import NO_AREA, Prisms, Sheets, Solid
from ambinav.casting.solids import with_solids
from ambinav.casting.space import SpaceCaster
from ambinav.geometry.border_cover import bare_pieces, repeated
from ambinav.geometry.edit import NEAR, ON_BORDER, Building, between, complement, straight
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import REFLECTOR, WALL, Segments, edges_of
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError

# Metres above the floor. What ends below is driven and stood on.
GROUND: Final = 0.03
# Metres above the floor. What begins below is what the plan shows, not what hangs over it.
STANDING: Final = 0.3
# A tag stands this far in front of its wall, metres: its face, not the wall's, must be met.
TAG: Final = 2e-3


class Plan(Protocol):
    """Plan of a building: a `Building`, or an `Environment`."""

    @property
    def name(self) -> str:
        """Name in messages."""

    @property
    def segments(self) -> Segments:
        """Walls and frontiers."""

    @property
    def free(self) -> BaseGeometry:
        """Free space, metres."""


def edited_space(
    space: SpaceCaster,
    floor: float,
    before: Building,
    after: Building,
    add: Sequence[Obstacle],
    remove: BaseGeometry | None,
) -> SpaceCaster:
    """Return a building in space without what stands in a shape, and with obstacles added.

    Args:
        space: Before.
        floor: z of the floor, metres.
        before: The plan before.
        after: The plan afterwards.
        add: The obstacles.
        remove: Polygon or MultiPolygon. What hangs over it stays. Where its edge lies in what was
            not floor, and no cut solid closes it, a wall as high as the building stands.

    Raises:
        InputError: the building is neither prisms nor a mesh; a part of a mesh, or of a building
            that a map does not keep, is to be removed; an obstacle begins above the building; or
            see `with_solids`.
    """
    if remove is not None:
        space = _without(space, floor, before, after, remove)
    if not len(add):
        return space
    return with_solids(space, *bodies_of(add, before, floor, top_of(space)))


def top_of(space: SpaceCaster) -> float:
    """Return the greatest z of a building, metres: its ceiling, or what reaches highest.

    Raises:
        InputError: it is neither prisms nor a mesh.
    """
    if isinstance(space, Mesh):
        return float(space.bounds[1, 2])
    if isinstance(space, Prisms):
        return float(space.wall_z.max()) if math.isinf(space.ceiling) else space.ceiling
    # Asked for its surfaces, a space that was not kept says so itself.
    count = len(space.surface_kind)
    raise InputError(
        f"the building in space is a {type(space).__name__} of {count} surfaces, whose height is "
        "not known; give prisms or a mesh."
    )


def bodies_of(
    obstacles: Sequence[Obstacle], plan: Plan, floor: float, top: float
) -> tuple[list[Solid], Sheets]:
    """Return obstacles as solids, and as sheets: walls without thickness, and tags on walls.

    Args:
        obstacles: The obstacles.
        plan: The building into which they are put, one after the other.
        floor: z of the floor, metres.
        top: z up to which those without a height of their own reach, metres.

    Raises:
        InputError: one begins above `top`.
    """
    solids: list[Solid] = []
    sheets: list[Sheets] = []
    walls = plan.segments.xy
    for obstacle in obstacles:
        low = floor + obstacle.bottom
        high = top if obstacle.top is None else floor + obstacle.top
        if not low < min(high, top):
            raise InputError(
                f"{plan.name}: an obstacle begins {obstacle.bottom:g} m above the floor, and the "
                f"building is {top - floor:g} m high; give a smaller bottom."
            )
        kind = REFLECTOR if obstacle.reflective else WALL
        if obstacle.solid:
            solids.append(Solid(obstacle.outline, low, high, kind))
            rows = edges_of(obstacle.outline)
        else:
            rows = straight(obstacle.outline)
            faces = rows
            if obstacle.reflective:
                tags = _before_walls(_parts(rows, walls, NEAR, covered=True), plan.free)
                faces = np.concatenate([_parts(rows, walls, NEAR, covered=False), tags])
            sheets.append(Sheets.of(faces, low, high, kind))
        walls = np.concatenate([walls, rows])
    return solids, Sheets.joined(sheets)


def _before_walls(rows: Floats, free: BaseGeometry) -> Floats:
    """Return parts of walls, shifted to the sides where there is floor."""
    normal = Segments(rows, np.zeros(len(rows), dtype=np.uint8)).normals
    sides = np.concatenate([rows + sign * TAG * np.tile(normal, 2) for sign in (-1.0, 1.0)])
    middle = (sides[:, :2] + sides[:, 2:]) / 2
    return np.asarray(sides[shapely.contains_xy(free, *middle.T)])


def _parts(rows: Floats, lines: Floats, near: float, *, covered: bool) -> Floats:
    """Return the parts of rows on which a line lies, or on which none does, shape (n, 4)."""
    owner, start, end = bare_pieces(rows, lines, near)
    parts = [np.empty((0, 4))]
    for k, row in enumerate(rows):
        bare = np.column_stack([start[owner == k], end[owner == k]])
        parts.append(between(row, complement(bare) if covered else bare))
    made = np.concatenate(parts)
    return np.asarray(made[np.hypot(*(made[:, 2:] - made[:, :2]).T) > 2.0 * ON_BORDER])


def _without(
    space: SpaceCaster, floor: float, before: Building, after: Building, shape: BaseGeometry
) -> Prisms:
    """Return a building without what stands in a shape; see `edited_space`."""
    # Asked for its surfaces, a space that was not kept says so itself.
    count = len(space.surface_kind)
    if not isinstance(space, Prisms):
        raise InputError(
            f"{before.name}: it is a mesh of {count} triangles, of which no part can be removed; "
            "change its file, or give the building as a plan or an .ifc file."
        )
    sheets, shape = space.given, shapely.force_2d(shape)
    shapely.prepare(shape)
    lines = shapely.linestrings(sheets.xy.reshape(-1, 2, 2))
    met = _stands(sheets.z, floor) & shapely.intersects(lines, shape)
    sheet_parts = [sheets.among(~met)]
    for k in np.flatnonzero(met):
        # A wall on the edge of the shape stays.
        parts = [shapely.difference(lines[k], shape), lines[k].intersection(shape.boundary)]
        rows = np.concatenate([straight(part) for part in parts])
        sheet_parts.append(sheets.among(np.full(len(rows), k))._replace(xy=rows))
    solids: list[Solid] = []
    for solid in space.solids:
        stands = _stands(np.array([[solid.bottom, solid.top]]), floor)[0]
        if not (stands and shapely.intersects(solid.outline, shape)):
            solids.append(solid)
            continue
        left = shapely.get_parts(shapely.difference(solid.outline, shape))
        solids += [
            Solid(part, solid.bottom, solid.top, solid.kind)
            for part in left
            if part.geom_type == "Polygon" and part.area > NO_AREA
        ]
    standing = [edges_of(s.outline) for s in solids if s.bottom <= floor + STANDING]
    closed = np.concatenate([part.xy for part in sheet_parts] + standing)
    edges = edges_of(after.free)
    fresh = edges[~repeated(edges, edges_of(before.free))]
    fresh = _parts(fresh, edges_of(shape), ON_BORDER, covered=True)
    fresh = _parts(fresh, closed, ON_BORDER, covered=False)
    sheet_parts.append(Sheets.of(fresh, floor, top_of(space)))
    free = space.free
    if free is not None and not shapely.covers(free, shape):
        free = shapely.union(free, shape)
    return space.refilled(Sheets.joined(sheet_parts), solids=solids, free=free)


def _stands(z: Floats, floor: float) -> Bools:
    """Return which heights, lowest and highest, (N, 2), are those of what stands on the floor."""
    low, high = z.T
    return np.asarray((low <= floor + STANDING) & (high > floor + GROUND))
