"""Building as a set of prisms: walls with heights, solids on a plan, floor and ceiling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.triangulation import Triangulation
from ambinav.casting.prisms.cast import PrismCaster
from ambinav.casting.prisms.faces import Pieces
from ambinav.casting.prisms.kernel import SLACK, PrismArrays
from ambinav.casting.prisms.rays import NOWHERE, PrismRays
from ambinav.casting.prisms.scans import cast_single
from ambinav.casting.ray_packets import packets_of
from ambinav.casting.space import SpaceRays, unit_rays
from ambinav.config import check_kind
from ambinav.geometry.segments import WALL, Segments, edges_of
from ambinav.runtime.array_types import Bools, Bytes, Floats, Indices, Ints, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of
from ambinav.runtime.threads import run_rows

# Edge of a cell, metres: flat between 0.4 and 1 (benchmarks/bench_prisms.py).
CELL = 0.6
# Outlines with a smaller area, square metres, are ignored.
NO_AREA = 1e-12


@dataclass(frozen=True)
class Solid:
    """A polygon of the plan, filled from one height to another.

    Attributes:
        outline: Polygon, holes and all, metres, map frame.
        bottom: z in metres.
        top: z in metres.
        kind: Kind of all of its faces; see `ambinav.geometry.segments`.
    """

    outline: shapely.Polygon
    bottom: float
    top: float
    kind: int = WALL


class Sheets(NamedTuple):
    """Upright walls without thickness.

    Attributes:
        xy: End points, shape (N, 4), metres, map frame.
        z: Lowest and highest z of each, shape (N, 2), metres.
        kind: Kind of each, shape (N,); see `ambinav.geometry.segments`.
    """

    xy: Floats
    z: Floats
    kind: Bytes

    @classmethod
    def of(cls, xy: Floats, low: float, high: float, kind: int = WALL) -> Sheets:
        """Make sheets of one height and kind, see the class."""
        count = len(xy)
        return cls(xy, np.tile((low, high), (count, 1)), np.full(count, kind, dtype=np.uint8))

    @classmethod
    def none(cls) -> Sheets:
        """Return no sheets."""
        return cls.of(np.empty((0, 4)), 0.0, 0.0)

    @classmethod
    def joined(cls, parts: Sequence[Sheets]) -> Sheets:
        """Return the sheets of all parts, in order."""
        return cls(*map(np.concatenate, zip(cls.none(), *parts, strict=True)))

    def among(self, rows: Bools | Indices | slice) -> Sheets:
        """Return some of the sheets."""
        return Sheets(self.xy[rows], self.z[rows], self.kind[rows])


class Prisms(PrismCaster):
    """Walls without thickness and solids, each between two heights, a floor and a ceiling.

    Surfaces are numbered: the W walls, given ones first and then the sides of the solids in their
    order; then bottom and top of each of the K solids; then floor and ceiling, W + 2 K and
    W + 2 K + 1, whether there are any or not. A wall or the side of a solid stops rays from both
    sides. A ray in the plane of a wall passes it, as it passes a face in whose plane it lies, and
    ends where it meets another surface: a solid that it grazes along a side ends it at the corner.
    Surfaces are closed: who meets an edge or a corner, within `SLACK`, meets a surface there, and
    which of them is named is not said.

    Args:
        xy: End points of walls without thickness, shape (N, 4), metres, map frame.
        z: Lowest and highest z of each, shape (N, 2), metres.
        kind: Kind of each, shape (N,); see `ambinav.geometry.segments`. None: all are walls.
        solids: They may touch, overlap and stand on each other.
        floor: z of a plane that goes on without end, metres; None for none.
        ceiling: As `floor`.
        free: Polygon or MultiPolygon of the plan; rays of scans that start beside it are nan. None:
            they may start anywhere but in a solid, under the floor and above the ceiling.

    Attributes:
        walls: The given ones, then the sides of the solids.
        wall_z: Lowest and highest z of each, shape (W, 2), metres.
        sheets: How many of the walls are given ones.
        solids: As given, like the others; `floor` and `ceiling` -inf and inf for none.

    Raises:
        InputError: nothing stands in it, a number is not finite, or an interval is empty.
    """

    def __init__(
        self,
        xy: ArrayLike = (),
        z: ArrayLike = (),
        kind: ArrayLike | None = None,
        *,
        solids: Sequence[Solid] = (),
        floor: float | None = None,
        ceiling: float | None = None,
        free: BaseGeometry | None = None,
    ) -> None:
        for solid in solids:
            check_kind(solid, Solid, "prisms: a solid")
        ends = np.asarray(xy, dtype=np.float64).reshape(-1, 4)
        heights = np.asarray(z, dtype=np.float64).reshape(-1, 2)
        kinds = np.zeros(len(ends)) if kind is None else np.asarray(kind).reshape(-1)
        if not len(ends) == len(heights) == len(kinds):
            raise InputError(
                f"prisms: {len(ends)} walls, {len(heights)} heights and {len(kinds)} kinds; give "
                "one of each for every wall."
            )
        _check(ends, heights, solids, floor, ceiling)
        count = len(ends)
        parts = [(ends, heights, kinds)]
        for solid in solids:
            sides = edges_of(solid.outline)
            parts.append(
                (
                    sides,
                    np.tile((solid.bottom, solid.top), (len(sides), 1)),
                    np.full(len(sides), solid.kind),
                )
            )
        ends, heights, kinds = (np.concatenate(part) for part in zip(*parts, strict=True))
        extended = (ends[:, 0] != ends[:, 2]) | (ends[:, 1] != ends[:, 3])
        if not extended.any():
            raise InputError("prisms: nothing stands in them; give a wall or a solid.")
        self.walls = Segments(ends[extended], kinds[extended])
        self.wall_z = np.ascontiguousarray(heights[extended])
        self.sheets = int(extended[:count].sum())
        self.solids = tuple(solids)
        self.floor = -math.inf if floor is None else float(floor)
        self.ceiling = math.inf if ceiling is None else float(ceiling)
        self.free = free

    def __repr__(self) -> str:
        """Return counts as text."""
        return f"Prisms({len(self.walls)} walls, {len(self.solids)} solids)"

    @property
    def given(self) -> Sheets:
        """The given walls, those that are no side of a solid."""
        return Sheets(self.walls.xy, self.wall_z, self.walls.kind).among(slice(self.sheets))

    def refilled(
        self, sheets: Sheets, *, solids: Sequence[Solid], free: BaseGeometry | None
    ) -> Prisms:
        """Return other walls, solids and plan between the same floor and ceiling; see the class."""
        floor, ceiling = (None if math.isinf(z) else z for z in (self.floor, self.ceiling))
        return Prisms(*sheets, solids=solids, floor=floor, ceiling=ceiling, free=free)

    @cached_property
    def checksum(self) -> str:
        """Digest of walls, solids, floor, ceiling and plan."""
        walls = self.walls.xy, self.walls.kind, self.wall_z
        return digest_of(*walls, self.solids, self.floor, self.ceiling, self.free)

    @cached_property
    def surface_normal(self) -> Floats:
        """Unit normals, shape (S, 3): of walls to the left of a to b, of the others upward."""
        xy = self.walls.xy
        normal = np.zeros((len(xy) + 2 * len(self.solids) + 2, 3))
        normal[: len(xy), 0] = xy[:, 1] - xy[:, 3]
        normal[: len(xy), 1] = xy[:, 2] - xy[:, 0]
        normal[len(xy) :, 2] = 1.0
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return normal

    @cached_property
    def surface_kind(self) -> Bytes:
        """Kind of each surface, shape (S,); floor and ceiling are walls."""
        of_solids = np.repeat([solid.kind for solid in self.solids], 2)
        return np.concatenate([self.walls.kind, of_solids, (WALL, WALL)]).astype(np.uint8)

    @cached_property
    def arrays(self) -> PrismArrays:
        """Arrays of the building for the kernels."""
        grid = SegmentGrid.build(self.walls, CELL)
        count = len(self.solids)
        z = np.array([(solid.bottom, solid.top) for solid in self.solids]).reshape(count, 2)
        pieces = Pieces.of([solid.outline for solid in self.solids])
        every = np.ones(len(pieces.owner), dtype=np.bool_)
        body_start, body = pieces.in_cells(grid, every)
        starts, faces = zip(
            *(pieces.in_cells(grid, self._seen(z[:, side])[pieces.owner]) for side in (0, 1)),
            strict=True,
        )
        face_start, face, side = _merged(starts, faces)
        wall_z = np.add(self.wall_z, (-SLACK, SLACK))[grid.item]
        faces_of = len(self.walls) + 2 * pieces.owner[:, None] + (0, 1)
        x0, y0 = grid.origin.tolist()
        return PrismArrays(
            x0, y0, grid.cell, *grid.shape, grid.start, grid.item,
            np.hstack([grid.line, wall_z]),
            face_start, (2 * face + side).astype(np.int32),
            np.hstack([np.repeat(pieces.edges, 2, axis=0), z[pieces.owner].reshape(-1, 1)]),
            faces_of.ravel().astype(np.int32),
            body_start, np.hstack([pieces.edges, z[pieces.owner]])[body],
            len(self.walls), self.floor, self.ceiling,
            np.concatenate([z.ravel(), (self.floor, self.ceiling)]), self.surface_normal,
        )  # fmt: skip

    def _seen(self, z: Floats) -> Bools:
        """Return which heights of horizontal faces lie between the floor and the ceiling."""
        return (z > self.floor) & (z < self.ceiling)

    def cast(
        self, origin: ArrayLike, direction: ArrayLike, max_range: float
    ) -> tuple[Floats, Ints32]:
        """Find the first surface along single rays, from anywhere, solids included.

        Args:
            origin: Metres, map frame, shape (..., 3).
            direction: Vectors of any length but 0, shape (..., 3); broadcast against `origin`.
            max_range: How far to look, metres.

        Returns:
            Distance in metres, shape (...), `max_range` where nothing is met and nan where the ray
            is not finite or has no direction; and the surface, -1 for none.

        Raises:
            InputError: the range is not a positive number.
        """
        shape, o, u, fine = unit_rays(origin, direction, max_range)
        distance, surface = np.empty(len(o)), np.empty(len(o), dtype=np.int32)
        run_rows(
            cast_single, len(o), o, u, self.arrays, float(max_range), distance, surface, least=512
        )
        distance[~fine], surface[~fine] = np.nan, -1
        return distance.reshape(shape), surface.reshape(shape)

    def rays(self, rays: SpaceRays, max_range: float, max_incidence: Floats) -> PrismRays:
        """Arrange rays for kernels that cast them pose by pose, see `cast_prism_rays`.

        Args:
            rays: R rays; heights count from z = 0 of the building.
            max_range: How far to look, metres.
            max_incidence: See `PrismRays.incidence`, shape (R,).
        """
        plan = NOWHERE if self.plan is None else self.plan.index
        return PrismRays(
            packets_of(rays), self.arrays, float(max_range), self.plan is not None, plan,
            max_incidence,
        )  # fmt: skip

    @cached_property
    def plan(self) -> Triangulation | None:
        """Area where rays of scans may start; None: anywhere."""
        return None if self.free is None else Triangulation.build(self.free, np.empty((0, 4)))


def _check(
    ends: Floats,
    heights: Floats,
    solids: Sequence[Solid],
    floor: float | None,
    ceiling: float | None,
) -> None:
    """Check that this is a building; raises `InputError`."""
    if not (np.isfinite(ends).all() and np.isfinite(heights).all()):
        raise InputError("prisms: an end point or a height of a wall is not finite; give metres.")
    empty = np.flatnonzero(heights[:, 0] >= heights[:, 1])
    if len(empty):
        low, high = heights[empty[0]]
        raise InputError(
            f"prisms: wall {empty[0]} stands from z = {low:g} to {high:g} m; the first must be "
            "the lower."
        )
    for i, solid in enumerate(solids):
        if not -math.inf < solid.bottom < solid.top < math.inf:
            raise InputError(
                f"prisms: solid {i} stands from z = {solid.bottom:g} to {solid.top:g} m; give two "
                "finite heights, the lower first."
            )
        if not (solid.outline.is_valid and solid.outline.area > NO_AREA):
            raise InputError(
                f"prisms: the outline of solid {i} is not a valid polygon with an area; draw it "
                "without crossings."
            )
    for name, value in (("floor", floor), ("ceiling", ceiling)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"prisms: {name} is {value}; give a height in metres, or none.")
    if floor is not None and ceiling is not None and not floor < ceiling:
        raise InputError(
            f"prisms: the floor is at z = {floor:g} m and the ceiling at {ceiling:g} m; the floor "
            "must be the lower."
        )


def _merged(starts: Sequence[Ints32], items: Sequence[Ints]) -> tuple[Ints32, Ints, Ints]:
    """Merge lists by cell: start of each cell, the items, and the source list of each item."""
    cells = [np.repeat(np.arange(len(start) - 1), np.diff(start)) for start in starts]
    cell, item = np.concatenate(cells), np.concatenate(items)
    which = np.repeat(np.arange(len(items)), [len(part) for part in items])
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange(len(starts[0]))).astype(np.int32)
    return start, item[order], which[order]
