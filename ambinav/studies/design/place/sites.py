"""Sites of obstacles at walls and on the floor, a given distance apart."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.obstacle_file import DrawnObstacle
from ambinav.geometry.collision.reach import room_for
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.array_types import Bools, Floats
from ambinav.studies.design.place.candidates import Candidate, PlaceRules
from ambinav.studies.design.place.passages import SLACK

Points = NDArray[np.float64]
Window = tuple[float, float, float, float]

EMBEDDED: Final = 0.2
"""Share of a post's radius that reaches into the wall that it stands at: no slit is left."""
THICKNESS: Final = 0.04
"""Thickness of a panel, metres."""
TAG_THICKNESS: Final = 0.02
"""Thickness of a tag, metres: half of it stands out of the wall."""
TURNS: Final = 4
"""Directions in which a free-standing panel is tried, evenly over half a turn."""
GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
"""Multiples of this, less their whole parts, are spread evenly between 0 and 1."""
FLAT: Final = 0.015
"""A wall is flat enough for a tag that lies so near to it everywhere, metres."""


class Sites:
    """Sites of obstacles in a building; passages are not checked here.

    Args:
        environment: The building.
        rules: Kind of the obstacles and rules for their positions.
        floor: Floor that the robot reaches.
        wide: Where the centre of a free-standing obstacle may be.
    """

    def __init__(
        self, environment: Environment, rules: PlaceRules, floor: BaseGeometry, wide: BaseGeometry
    ) -> None:
        self.rules, self.floor, self.wide = rules, floor, wide
        # At walls, obstacles are placed on lines at this distance from the wall.
        self.off = rules.radius * (1.0 - EMBEDDED) if rules.kind == "post" else FLAT / 2
        room = shapely.get_parts(room_for(environment, self.off))
        # The floor is to the left of all of them.
        self.rings = [ring for part in room.tolist() for ring in _rings(part)]
        segments = environment.segments
        self.unknown = shapely.multilinestrings(
            shapely.linestrings(segments.xy[segments.kind == FRONTIER].reshape(-1, 2, 2))
        )
        shapely.prepare([self.floor, self.unknown])

    def counts(self, step: float, is_allowed: Callable[[Points], Bools]) -> tuple[int, int]:
        """Count the wanted points at walls and on the floor, `step` metres apart.

        `every` makes no more of each kind.
        """
        on_walls = on_floor = 0
        if self.rules.on_walls:
            rings = [
                _points_at(ring, along)
                for number, ring in enumerate(self.rings)
                if len(along := _distances_along(ring, step, number))
            ]
            on_walls = int(is_allowed(np.concatenate(rings)).sum()) if rings else 0
        if self.rules.free_standing and self.rules.kind != "tag":
            on_floor = len(self._grid(step, is_allowed))
        return on_walls, on_floor

    def every(
        self, step: float, is_allowed: Callable[[Points], Bools], window: Window | None = None
    ) -> Iterator[Candidate]:
        """Yield candidates `step` metres apart at the wanted points.

        Args:
            step: Their distance, metres.
            is_allowed: Which points of an array (N, 2) are allowed.
            window: xmin, ymin, xmax and ymax, metres, outside of which none is; None: unknown.
        """
        if self.rules.on_walls:
            for number, ring in enumerate(self.rings):
                if window is None or shapely.intersects(shapely.box(*window), ring):
                    along = _distances_along(ring, step, number)
                    yield from self._beside(ring, along, is_allowed)
        if self.rules.free_standing and self.rules.kind != "tag":
            yield from self._on_floor(step, is_allowed, window)

    def _beside(
        self, ring: shapely.LinearRing, along: Points, is_allowed: Callable[[Points], Bools]
    ) -> Iterator[Candidate]:
        if not len(along):
            return
        at = _points_at(ring, along)
        mask = is_allowed(at)
        half = self.rules.width / 2 if self.rules.kind == "tag" else THICKNESS
        around = np.stack([_points_at(ring, along[mask] + s) for s in np.linspace(-half, half, 5)])
        for (x, y), near in zip(at[mask].tolist(), around.transpose(1, 0, 2), strict=True):
            candidate = self._at_wall(x, y, near)
            # Nothing can be mounted on a frontier.
            if candidate is not None and not shapely.dwithin(
                self.unknown, candidate.obstacle.outline, 2 * FLAT
            ):
                yield candidate

    def _at_wall(self, x: float, y: float, near: Points) -> Candidate | None:
        """Create the obstacle at (x, y), parallel to the line through the points `near`."""
        rules, off = self.rules, self.off
        if rules.kind == "post":
            return self._post(x, y, True)
        tx, ty = near[-1] - near[0]
        size = math.hypot(tx, ty)
        if size < SLACK:
            return None
        tx, ty = tx / size, ty / size
        nx, ny = -ty, tx
        if rules.kind == "panel":
            ends = np.array([(x, y), (x, y)]) + np.outer((-2 * off, rules.width), (nx, ny))
            return self._strip(ends, THICKNESS, True)
        uneven = np.abs((near - near[0]) @ (nx, ny)).max()
        if uneven > FLAT or size < rules.width - FLAT:
            return None
        half = rules.width / 2
        wall = np.array([(x - off * nx, y - off * ny)] * 2)
        return self._strip(wall + np.outer((-half, half), (tx, ty)), TAG_THICKNESS, True)

    def _on_floor(
        self, step: float, is_allowed: Callable[[Points], Bools], window: Window | None
    ) -> Iterator[Candidate]:
        rules = self.rules
        for x, y in self._grid(step, is_allowed, window).tolist():
            if rules.kind == "post":
                yield self._post(x, y, False)
                continue
            for angle in (np.arange(TURNS) * math.pi / TURNS).tolist():
                dx, dy = rules.width / 2 * math.cos(angle), rules.width / 2 * math.sin(angle)
                ends = np.array([(x - dx, y - dy), (x + dx, y + dy)])
                yield self._strip(ends, THICKNESS, False)

    def _grid(
        self, step: float, is_allowed: Callable[[Points], Bools], window: Window | None = None
    ) -> Points:
        """Return the wanted points of a floor grid common to all buildings, shape (N, 2)."""
        if self.wide.is_empty:
            return np.empty((0, 2))
        xmin, ymin, xmax, ymax = self.wide.bounds if window is None else window
        xs = np.arange(math.ceil(xmin / step), math.floor(xmax / step) + 1) * step
        ys = np.arange(math.ceil(ymin / step), math.floor(ymax / step) + 1) * step
        grid = np.stack([axis.ravel() for axis in np.meshgrid(xs, ys)], axis=1)
        grid = grid[is_allowed(grid)]
        inside = shapely.intersects_xy(self.wide, grid) & shapely.intersects_xy(self.floor, grid)
        return np.asarray(grid[inside], dtype=np.float64)

    def _post(self, x: float, y: float, on_wall: bool) -> Candidate:
        rules = self.rules
        kind = "reflector" if rules.reflective else "post"
        drawn = DrawnObstacle(
            kind, (_round((x, y)),), rules.radius, bottom=rules.bottom, top=rules.top
        )
        return Candidate("post", drawn, on_wall)

    def _strip(self, ends: Points, thickness: float, on_wall: bool) -> Candidate:
        rules = self.rules
        kind = "reflector" if rules.reflective else "panel"
        first, last = (_round(end) for end in ends.tolist())
        drawn = DrawnObstacle(
            kind, (first, last), thickness=thickness, bottom=rules.bottom, top=rules.top
        )
        return Candidate(rules.kind, drawn, on_wall)


def _round(point: Sequence[float]) -> tuple[float, float]:
    """Round to a tenth of a millimetre, so that written and computed values agree."""
    return round(point[0], 4), round(point[1], 4)


def _rings(part: shapely.Polygon) -> list[shapely.LinearRing]:
    """Return the rings of a polygon, its inside to the left of each."""
    turned = shapely.geometry.polygon.orient(part)
    return [turned.exterior, *turned.interiors]


def _distances_along(ring: shapely.LinearRing, step: float, number: int) -> Points:
    """Return distances along a ring about `step` metres apart, metres.

    Of many short rings (equal pillars, say) some have a point, evenly over their numbers, and each
    at another place: half round a rectangle is always a corner.
    """
    steps = ring.length / step
    count, phase = int(steps), 0.5
    if count < 3:
        count += int((number + 1) * GOLDEN % 1.0 < steps % 1.0)
        phase = (number + 1) * math.sqrt(2.0) % 1.0
    return np.asarray((np.arange(count) + phase) * (ring.length / max(count, 1)))


def _points_at(ring: shapely.LinearRing, along: Floats) -> Points:
    """Return points at given distances along a ring, metres, shape (N, 2)."""
    corners = shapely.get_coordinates(ring)
    metres = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    along = along % metres[-1]
    return np.column_stack([np.interp(along, metres, axis) for axis in corners.T])
