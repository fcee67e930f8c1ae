"""Environment: free space, the segments that bound it, and queries to both."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import overload

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from ambinav.casting.plane.anywhere import cast_anywhere
from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.raycast import clearances
from ambinav.casting.plane.triangulation import Triangulation
from ambinav.casting.space import SpaceCaster
from ambinav.casting.turned import turned
from ambinav.config import as_array, as_flat, as_nonnegative, as_number
from ambinav.geometry.border_cover import lines_of, longest_bare, owners_of
from ambinav.geometry.edit import ON_BORDER, Building, applied
from ambinav.geometry.edit_in_space import edited_space
from ambinav.geometry.footprint import ROUNDING
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.occupancy_grid import OccupancyGrid
from ambinav.geometry.segments import REFLECTOR, WALL, Segments, edges_of, moved
from ambinav.geometry.window import clipped, off_border, windowed
from ambinav.runtime.array_types import Bools, Bytes, Floats, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of
from ambinav.runtime.scalars import Scalar

# A drawn plan differs from the building: walls stand about this far, in metres, from their line.
BOX = "(xmin, ymin, xmax, ymax), metres"
"""What messages ask for where bounds are wanted."""
DRAWING_STD = 0.02
# Walls fitted to an occupancy map stand about this far from where a scanner meets them, metres:
# measured in the logs of seven robots (benchmarks/bench_cells.py). Not the size of a cell, which
# says how finely a map is stored, not how well it was surveyed: the fit averages over many cells.
MAPPING_STD = 0.03


class Environment:
    """Static surroundings of a robot: free space bounded by segments, in the map frame.

    Args:
        segments: Walls and frontiers, on all of the border of `free`. Those inside `free` are
            walls without thickness.
        free: Polygon or MultiPolygon of the free space, metres.
        name: Name in reports.
        source: The file that it came from.
        checksum: SHA-256 of its files.
        resolution: Edge of a cell in metres if it came from an occupancy grid.
        notes: What was repaired or left out when it was read.
        extent: Area of its source, such as the image of a map, if floor may continue beyond its
            border; None if the floor ends at what is drawn.
        occupancy: The grid that it came from, if it came from one.
        drivable: Polygon or MultiPolygon within `free` that no footprint may leave, metres; None
            for `free` itself. Rays ignore it; see `collision`.
        space: The building in three dimensions, against which the rays of scanners are cast; None:
            it is a plan. `free`, `segments` and `drivable` still describe the floor, where a robot
            can be.
        floor: z of the floor in `space`, metres.

    Raises:
        InputError: no free space, no segment, or a stretch of the border of the free space
            without one.
    """

    def __init__(
        self,
        segments: Segments,
        free: BaseGeometry,
        *,
        name: str = "environment",
        source: Path | None = None,
        checksum: str = "",
        resolution: float | None = None,
        notes: tuple[str, ...] = (),
        extent: shapely.Polygon | None = None,
        occupancy: OccupancyGrid | None = None,
        drivable: BaseGeometry | None = None,
        space: SpaceCaster | None = None,
        floor: float = 0.0,
    ) -> None:
        origin = str(source) if source is not None else name
        if free.is_empty or free.area <= 0.0:
            raise InputError(f"{origin}: there is no free space in it; give a map with free cells.")
        if len(segments) == 0:
            raise InputError(f"{origin}: nothing bounds its free space; give a map with walls.")
        bare = longest_bare(free, segments.xy, ON_BORDER)
        if bare is not None:
            raise InputError(
                f"{origin}: no segment lies on the border of its free space for {bare[2]:.3g} m "
                f"around ({bare[0]:.6g}, {bare[1]:.6g}); give it a wall or a frontier there."
            )
        self.segments = segments
        self.free = free
        self.name = name
        self.source = source
        self.checksum = checksum
        self.resolution = resolution
        self.notes = notes
        self.extent = extent
        self.occupancy = occupancy
        self._drivable = drivable
        self.space = space
        self.floor = as_number(floor, f"{origin}: floor")

    def __repr__(self) -> str:
        """Return name, size and counts as text."""
        xmin, ymin, xmax, ymax = self.bounds
        return (
            f"Environment({self.name!r}, {xmax - xmin:.1f} x {ymax - ymin:.1f} m, "
            f"{self.free.area:.0f} m2 free, {len(self.segments)} segments"
            f"{'' if self.space is None else f', {self.space!r}'})"
        )

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the free space and the segments, metres."""
        a, b = self.free.bounds, self.segments.bounds
        return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])

    @property
    def drivable(self) -> BaseGeometry | None:
        """Area that footprints must not leave, metres; None where that is `free`."""
        return self._drivable

    @cached_property
    def collision(self) -> Environment:
        """Environment for footprints: no occupied cell of the map is free in it.

        A drawn plan is its own. For an occupancy map it is `drivable`, with all edges as walls: use
        this to check where a robot fits, and the environment itself for rays.

        Raises:
            InputError: no free space is left in it, or it is not known
                (`AmbiguityMap.environment`).
        """
        drivable = self.drivable
        if drivable is None:
            return self
        if drivable.is_empty:
            raise InputError(
                f"{self.source or self.name}: no free space is left beside its occupied cells; "
                "give a map with more free cells."
            )
        edges = edges_of(drivable)
        return Environment(
            Segments(edges, np.full(len(edges), WALL, dtype=np.uint8)),
            drivable,
            name=self.name,
            source=self.source,
            checksum=self.checksum,
            resolution=self.resolution,
            notes=self.notes,
        )

    def in_space(self, space: SpaceCaster, floor: float = 0.0) -> Environment:
        """Return the same floor in a three-dimensional building.

        Args:
            space: What the rays of scanners are cast against: `extruded(environment, height)`, or
                other `Prisms`, or the `Mesh` that `floor_environment` found the floor in.
            floor: z of the floor in it, metres.

        Raises:
            InputError: the floor is not a finite number.
        """
        return self._with_space(space, floor)

    @property
    def plan(self) -> Environment:
        """Same environment without `space`, or itself: rays are cast against its segments."""
        return self if self.space is None else self._with_space(None, 0.0)

    def _with_space(self, space: SpaceCaster | None, floor: float) -> Environment:
        # Copy the results computed for the floor, which stays the same.
        made = copy.copy(self)
        made.space = space
        made.floor = as_number(floor, f"{self.name}: floor")
        if vars(made).get("collision") is self:
            del made.collision
        return made

    @property
    def surface_normals(self) -> Floats:
        """Unit normals of the surfaces that rays hit: of a plan (S, 2), in space (S, 3)."""
        if self.space is None:
            return self.segments.normals
        return self.space.surface_normal

    @property
    def surface_kind(self) -> Bytes:
        """Kind of each surface, shape (S,): see `ambinav.geometry.segments`."""
        return self.segments.kind if self.space is None else self.space.surface_kind

    @property
    def has_reflectors(self) -> bool:
        """True if a surface is a reflector, distinguished from a wall only by intensities."""
        return bool((self.surface_kind == REFLECTOR).any())

    @property
    def map_std(self) -> float:
        """Standard deviation of the walls' position, metres; it depends on the map's source."""
        return DRAWING_STD if self.resolution is None else MAPPING_STD

    @cached_property
    def grid(self) -> SegmentGrid:
        """The segments in a grid, for clearances and rays from outside the free space."""
        return SegmentGrid.build(self.segments)

    @cached_property
    def triangulation(self) -> Triangulation:
        """The free space as triangles, for rays and for what is free."""
        return Triangulation.build(self.free, self.thin_walls)

    @cached_property
    def border_segment(self) -> Ints32:
        """Segment on which each border edge of the triangulation lies, int32, (K,)."""
        return owners_of(self.triangulation.border, self.segments.xy)

    @cached_property
    def border_lines(self) -> Floats:
        """End points of a piece of the line of each border edge, (K, 4), metres.

        The edges of a slit lie beside their wall; their lines are the wall's own, so that ranges
        are exact at every angle. What closes a slit's end stands for itself.
        """
        return lines_of(self.triangulation.border, self.segments.xy[self.border_segment])

    @property
    def thin_walls(self) -> Floats:
        """End points of the walls without thickness inside the free space, (K, 4), metres."""
        return self.segments.xy[self._thin]

    @cached_property
    def _thin(self) -> Bools:
        """Mask over the segments: those that run through the free space."""
        return off_border(self.segments.xy, self.free)

    @overload
    def is_free(self, x: Scalar, y: Scalar, radius: float = 0.0) -> bool: ...

    @overload
    def is_free(self, x: ArrayLike, y: ArrayLike, radius: float = 0.0) -> Bools: ...

    def is_free(self, x: ArrayLike, y: ArrayLike, radius: float = 0.0) -> Bools | bool:
        """Return whether a scan can be taken at (x, y), or a disc of `radius` metres fits there.

        A point is free if it lies in the free space of rays. A disc is free if a robot of that
        outline fits there, also beside every occupied cell (`collision`).

        Args:
            x: Metres, map frame, any shape.
            y: Metres, map frame, broadcast against x.
            radius: Metres; 0 for a point.

        Returns:
            Booleans of the broadcast shape; a plain bool for plain numbers.

        Raises:
            InputError: the radius is negative or not a number.
        """
        radius = as_nonnegative(radius, "is_free: radius", "metres")
        shape, (flat_x, flat_y) = as_flat(x=x, y=y)
        if radius > 0.0:
            place, limit = self.collision, radius * (1 + 1e-6) + 1e-9
            inside = place.triangulation.contains(flat_x, flat_y)
            inside &= clearances(place.grid, flat_x, flat_y, limit) >= radius - ROUNDING
        else:
            inside = self.triangulation.contains(flat_x, flat_y)
        return inside.reshape(shape) if shape else bool(inside[0])

    @overload
    def clearance(self, x: Scalar, y: Scalar, limit: float = math.inf) -> float: ...

    @overload
    def clearance(self, x: ArrayLike, y: ArrayLike, limit: float = math.inf) -> Floats: ...

    def clearance(self, x: ArrayLike, y: ArrayLike, limit: float = math.inf) -> Floats | float:
        """Compute the distance from (x, y) to a segment, metres, at most `limit`; broadcast."""
        shape, (flat_x, flat_y) = as_flat(x=x, y=y)
        flat = clearances(self.grid, flat_x, flat_y, min(limit, 1e9))
        return flat.reshape(shape) if shape else float(flat[0])

    @overload
    def cast(self, x: Scalar, y: Scalar, angle: Scalar, max_range: float) -> float: ...

    @overload
    def cast(self, x: ArrayLike, y: ArrayLike, angle: ArrayLike, max_range: float) -> Floats: ...

    def cast(
        self, x: ArrayLike, y: ArrayLike, angle: ArrayLike, max_range: float
    ) -> Floats | float:
        """Compute the exact distance along rays to the first segment.

        Args:
            x: Origins, metres, map frame, any shape.
            y: Origins, metres, map frame.
            angle: Directions, radians counter-clockwise from the map's x axis.
            max_range: How far to look, metres.

        Returns:
            Distances of the broadcast shape in metres, `max_range` where nothing is hit, nan
            where the ray is not finite; a plain float for plain numbers. From a point on a wall a
            ray may hit that wall at once.
        """
        distance, _ = self.cast_hits(x, y, angle, max_range)
        return distance if distance.ndim else float(distance)

    def cast_hits(
        self, x: ArrayLike, y: ArrayLike, angle: ArrayLike, max_range: float
    ) -> tuple[Floats, Ints32]:
        """Cast rays as `cast` does, and return the index of the segment hit too.

        The index is -1 where nothing is hit; both results are arrays.
        """
        if not max_range > 0.0:
            raise InputError(f"cast: max_range is {max_range}; give a positive number of metres.")
        return cast_anywhere(self, self.grid, x, y, angle, float(max_range))

    def normals(self, segment: ArrayLike) -> Floats:
        """Return unit normals, (..., 2), of segments by index, left of a to b; nan for -1."""
        return self.segments.normals_of(segment)

    def transformed(self, angle: float, dx: float = 0.0, dy: float = 0.0) -> Environment:
        """Turn about the origin by `angle` radians, then shift by (dx, dy) metres.

        Raises:
            InputError: a number is not finite, or see `casting.turned`.
        """
        for name, value in (("angle", angle), ("dx", dx), ("dy", dy)):
            as_number(value, name)
        drivable = self.drivable
        return Environment(
            self.segments.transformed(angle, dx, dy),
            moved(self.free, angle, dx, dy),
            name=self.name,
            source=self.source,
            checksum=self.checksum,
            resolution=self.resolution,
            notes=self.notes,
            extent=None if self.extent is None else moved(self.extent, angle, dx, dy),
            occupancy=None if self.occupancy is None else self.occupancy.transformed(angle, dx, dy),
            drivable=None if drivable is None else moved(drivable, angle, dx, dy),
            space=None if self.space is None else turned(self.space, angle, dx, dy),
            floor=self.floor,
        )

    def window(
        self, bounds: tuple[float, float, float, float], *, footprints: bool = True
    ) -> Environment | None:
        """Return the part of the building in a box, for rays and footprints that stay in it.

        Its border is a frontier; segments are not cut, so ranges are bit-identical.

        Args:
            bounds: (xmin, ymin, xmax, ymax), metres.
            footprints: False: it is only for rays, and its `collision` is not valid.

        Returns:
            The building itself if it lies in the box or is in space; None if no floor lies there.

        Raises:
            InputError: the bounds are no box.
        """
        if self.space is not None:
            return self
        a, b = as_array(bounds, "bounds", BOX), np.array(self.free.bounds)
        if a.shape != (4,) or not (a[:2] < a[2:]).all():
            raise InputError(f"bounds is {bounds}; give {BOX}.")
        if (a[:2] <= b[:2]).all() and (a[2:] >= b[2:]).all():
            return self
        cut = windowed(self.segments, self.free, bounds)
        if cut is None:
            return None
        drivable = self._drivable if footprints else None
        made = Environment(
            cut.segments,
            cut.free,
            name=self.name,
            source=self.source,
            resolution=self.resolution,
            drivable=None if drivable is None else clipped(drivable, bounds),
        )
        # The middle of a wall on the border may lie beyond the window.
        made._thin = cut.thin
        return made

    def edited(
        self,
        add: Sequence[Obstacle] = (),
        remove: BaseGeometry | None = None,
        name: str | None = None,
    ) -> Environment:
        """Return the building without a shape and with obstacles added.

        Other segments stay bit-identical and in their order; new ones follow. Obstacles block rays
        and footprints (`collision`), and occupy the cells of an occupancy map. Geometry hidden
        behind an obstacle may keep its segment.

        In space obstacles have heights (`Obstacle`), and tags are a few millimetres in front of
        their walls. What hangs over a removed part stays.

        Args:
            add: Obstacles to add, see `ambinav.geometry.obstacle`.
            remove: Polygon or MultiPolygon, metres: everything in it becomes floor, including walls
                and frontiers. Where its edge lies in solid or unknown space, it becomes a wall.
            name: Name of the result in reports; None: as before.

        Returns:
            The changed building; its checksum is a digest of the old one and the changes. The
            building itself if nothing changes.

        Raises:
            InputError: an obstacle lies outside the floor, or they cover all of it; `remove` is no
                sound polygon; or occupied cells are not known (`AmbiguityMap.environment`); or in
                space see `edited_space`.
        """
        before = Building(self.segments, self.free, self.drivable, self.occupancy, self.name)
        after, changed = applied(before, add, remove)
        space, content = self.space, [after.segments, after.free, after.drivable]
        if space is not None:
            checksum_before = space.checksum
            space = edited_space(space, self.floor, before, after, add, remove)
            changed |= space.checksum != checksum_before
            content.append(space.checksum)
        if not changed and name in (None, self.name):
            return self
        done = f"Edited: {len(add)} obstacles added{'' if remove is None else ', a part removed'}."
        return Environment(
            after.segments,
            after.free,
            name=self.name if name is None else name,
            source=self.source,
            checksum=digest_of(self.checksum, *content) if changed else self.checksum,
            resolution=self.resolution,
            notes=(*self.notes, done) if changed else self.notes,
            extent=self.extent,
            occupancy=after.occupancy,
            drivable=after.drivable,
            space=space,
            floor=self.floor,
        )
