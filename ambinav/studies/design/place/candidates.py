"""Candidate positions of posts, panels and tags: at walls or free-standing, no passage closed.

A passage is closed where a disc as wide as it no longer gets through. The centre of such a disc may
be anywhere in the free space shrunk by half the width; an obstacle takes away what lies within half
the width of it. If its edge crosses what was there before in one piece, everything that was
connected still is, and every way round is still there; if in several, the obstacle
stands between two walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.obstacle_file import DrawnObstacle
from ambinav.config import as_number
from ambinav.geometry.collision.reach import room_for
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.errors import InputError

Points = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal["post", "panel", "tag"]
KINDS: Final[tuple[Kind, ...]] = ("post", "panel", "tag")

EMBEDDED: Final = 0.2
"""Share of a post's radius that reaches into the wall that it stands at: no slit is left."""
THICKNESS: Final = 0.04
"""Thickness of a panel, metres."""
TAG_THICKNESS: Final = 0.02
"""Thickness of a tag, metres: half of it stands out of the wall."""
TURNS: Final = 4
"""Directions in which a free-standing panel is tried, evenly over half a turn."""
STEP: Final = 0.25
"""Distance between candidates, metres, where that makes no more than are asked for."""
COARSER: Final = 1.1
"""Factor by which they are moved apart until there are no more than are asked for."""
MANY: Final = 4
"""Passages are checked for at most this multiple of the requested number of candidates."""
POINTS: Final = 0.02
"""Distance of the points at which the edge of what an obstacle takes is looked at, metres."""
SLACK: Final = 1e-3
"""Metres that are of rounding."""
FLAT: Final = 0.015
"""A wall is flat enough for a tag that lies so near to it everywhere, metres."""


@dataclass(frozen=True)
class PlaceRules:
    """Kind of the obstacles and the rules for their positions.

    Attributes:
        kind: The name "post", "panel" or "tag" (a reflector flat on a wall).
        radius: Radius of a post, metres.
        width: Width of a panel or a tag, metres.
        min_passage: Passages at least this wide, metres, are not made narrower than this.
        on_walls: True if they may touch walls.
        free_standing: True if they may be free-standing; tags are not.
        reflective: True if they are reflectors.
        most: Maximum number of candidates; it determines the distance between them.

    Raises:
        InputError: a number is out of its range, or they may stand nowhere.
    """

    kind: Kind = "post"
    radius: float = 0.1
    width: float = 0.6
    min_passage: float = 0.9
    on_walls: bool = True
    free_standing: bool = True
    reflective: bool = False
    most: int = 200

    def __post_init__(self) -> None:
        """Check every number."""
        for name in ("radius", "width", "min_passage"):
            value = as_number(getattr(self, name), name)
            if not value > 0.0:
                option = name.replace("_", "-")
                raise InputError(f"--{option}: {value:g} is not above zero; give metres.")
        if self.kind == "post" and 2.0 * self.radius >= self.min_passage:
            raise InputError(
                f"--radius: posts {2 * self.radius:g} m wide are not narrower than the passage of "
                f"{self.min_passage:g} m that must stay free; give less, or a larger --min-passage."
            )
        if self.most < 1:
            raise InputError(f"--candidates: {self.most} is too few; give 1 or more.")
        if not (self.on_walls or (self.free_standing and self.kind != "tag")):
            raise InputError("--free-standing: a tag is flat on a wall; leave this out.")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate position of an obstacle.

    Attributes:
        kind: Kind of the obstacle.
        drawn: The same as files hold it.
        on_wall: Whether it touches a wall.
    """

    kind: Kind
    drawn: DrawnObstacle
    on_wall: bool

    @cached_property
    def obstacle(self) -> Obstacle:
        """The obstacle as a part of a building."""
        return self.drawn.obstacle

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the obstacle: x and y, metres, map frame."""
        x, y = np.mean(self.drawn.points, axis=0).tolist()
        return x, y

    @property
    def angle(self) -> float:
        """Direction of a panel or a tag, radians in [0, pi); 0 for a post."""
        (x0, y0), (x1, y1) = self.drawn.points[0], self.drawn.points[-1]
        return math.atan2(y1 - y0, x1 - x0) % math.pi


class Passages:
    """Check of which obstacles leave the passages of a building free.

    Args:
        environment: The building.
        width: Width of the passages to keep open, metres.
    """

    def __init__(self, environment: Environment, width: float) -> None:
        self.width = width
        self.room = room_for(environment, width / 2)
        self.wide = room_for(environment, width)
        shapely.prepare([self.room, self.wide])

    def stays(self, outline: BaseGeometry, on_wall: bool) -> bool:
        """Return whether an obstacle leaves the passages free.

        It is to touch a wall, or to leave the width between itself and all of them.
        """
        if not on_wall:
            return bool(shapely.covers(self.wide, outline))
        taken = shapely.buffer(outline, self.width / 2 - SLACK, quad_segs=8)
        ring = taken.exterior
        count = math.ceil(ring.length / POINTS)
        points = _points_at(ring, np.arange(count) * (ring.length / count))
        inside = np.asarray(shapely.intersects_xy(self.room, points), dtype=np.bool_)
        if inside.any():
            # Pieces of the ring, which begins where it ends.
            return int((inside & ~np.roll(inside, 1)).sum()) <= 1
        return not shapely.intersects(self.room, taken)


def apart(first: Candidate, second: Candidate, passage: float) -> bool:
    """Return whether a passage remains between two obstacles."""
    return not shapely.dwithin(first.obstacle.outline, second.obstacle.outline, passage)


def candidates(
    environment: Environment,
    rules: PlaceRules,
    bad: Points,
    sight: float,
    floor: BaseGeometry,
    routes: Sequence[BaseGeometry] = (),
    keep_out: BaseGeometry | None = None,
) -> tuple[Candidate, ...]:
    """Return candidate positions from which bad floor may be seen.

    Args:
        environment: The building.
        rules: Kind of the obstacles and rules for their positions.
        bad: Points of bad floor, shape (N, 2), metres.
        sight: Range of the scanner, metres.
        floor: Floor that the robot reaches; free-standing obstacles stand on it.
        routes: Lines that half of the passage is kept clear of on both sides.
        keep_out: Polygons that no obstacle may touch; None: there are none.

    Returns:
        At most `rules.most`, always the same.

    Raises:
        InputError: there is none.
    """
    if not len(bad):
        raise InputError(
            f"{environment.name}: none of the floor that counts is bad for this scanner, so "
            "nothing can help."
        )
    passages = Passages(environment, rules.min_passage)
    lines = shapely.MultiLineString(list(routes))
    kept_out = shapely.Polygon() if keep_out is None else keep_out
    shapely.prepare([lines, kept_out])
    near = cKDTree(bad)
    spots = _Positions(environment, rules, floor, passages)
    step = STEP

    def wanted(points: Points) -> Mask:
        seeing = np.asarray(near.query(points, distance_upper_bound=sight)[0] <= sight)
        beside = points[seeing]
        seeing[seeing] = ~shapely.dwithin(
            lines, shapely.points(beside), rules.min_passage / 2
        ) & ~shapely.intersects_xy(kept_out, beside)
        return seeing

    # Counted before they are created, since most are too close to each other.
    while sum(counts := spots.counts(step, wanted)) > MANY * rules.most:
        step *= _step_factor(*counts, MANY * rules.most)
    while True:
        seen = [
            candidate
            for candidate in spots.every(step, wanted)
            if not shapely.dwithin(lines, candidate.obstacle.outline, rules.min_passage / 2)
            and not shapely.intersects(kept_out, candidate.obstacle.outline)
        ]
        # Checking passages takes longest.
        if len(seen) > MANY * rules.most:
            step *= _step_factor(*_count_by_kind(seen), MANY * rules.most)
            continue
        allowed = [
            candidate
            for candidate in seen
            if passages.stays(candidate.obstacle.outline, candidate.on_wall)
        ]
        if not allowed:
            raise InputError(
                f"{environment.name}: a {rules.kind} fits nowhere within sight of bad floor"
                f"{'' if keep_out is None else ' and off the --keep-out zones'} "
                f"without narrowing a passage of {rules.min_passage:g} m; give a smaller "
                "--min-passage, or allow both --on-walls and --free-standing"
                f"{'' if keep_out is None else ', or draw smaller zones'}."
            )
        if len(allowed) <= rules.most:
            return tuple(allowed)
        step *= _step_factor(*_count_by_kind(allowed), rules.most)


def _count_by_kind(placed: Sequence[Candidate]) -> tuple[int, int]:
    """Count the candidates at walls and those on the floor."""
    on_walls = sum(candidate.on_wall for candidate in placed)
    return on_walls, len(placed) - on_walls


def _step_factor(on_walls: int, on_floor: int, most: int) -> float:
    """Return the step factor that leaves a given number: walls scale as 1 / f, floor as 1 / f²."""
    root = math.sqrt(on_walls**2 + 4.0 * on_floor * most)
    return max((on_walls + root) / (2.0 * most), COARSER)


class _Positions:
    """Positions for obstacles; passages are not checked here."""

    def __init__(
        self, environment: Environment, rules: PlaceRules, floor: BaseGeometry, passages: Passages
    ) -> None:
        self.rules, self.floor, self.wide = rules, floor, passages.wide
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

    def counts(self, step: float, wanted: Callable[[Points], Mask]) -> tuple[int, int]:
        """Count the wanted points at walls and on the floor, `step` metres apart.

        `every` makes no more of each kind.
        """
        on_walls = on_floor = 0
        if self.rules.on_walls:
            rings = [
                _points_at(ring, along)
                for ring in self.rings
                if len(along := _distances_along(ring, step))
            ]
            on_walls = int(wanted(np.concatenate(rings)).sum()) if rings else 0
        if self.rules.free_standing and self.rules.kind != "tag":
            on_floor = len(self._grid(step, wanted))
        return on_walls, on_floor

    def every(self, step: float, wanted: Callable[[Points], Mask]) -> Iterator[Candidate]:
        """Yield candidates `step` metres apart at the wanted points."""
        if self.rules.on_walls:
            for ring in self.rings:
                yield from self._beside(ring, step, wanted)
        if self.rules.free_standing and self.rules.kind != "tag":
            yield from self._on_floor(step, wanted)

    def _beside(
        self, ring: shapely.LinearRing, step: float, wanted: Callable[[Points], Mask]
    ) -> Iterator[Candidate]:
        along = _distances_along(ring, step)
        if not len(along):
            return
        at = _points_at(ring, along)
        kept = wanted(at)
        half = self.rules.width / 2 if self.rules.kind == "tag" else THICKNESS
        around = np.stack([_points_at(ring, along[kept] + s) for s in np.linspace(-half, half, 5)])
        for (x, y), near in zip(at[kept].tolist(), around.transpose(1, 0, 2), strict=True):
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

    def _on_floor(self, step: float, wanted: Callable[[Points], Mask]) -> Iterator[Candidate]:
        rules = self.rules
        for x, y in self._grid(step, wanted).tolist():
            if rules.kind == "post":
                yield self._post(x, y, False)
                continue
            for angle in (np.arange(TURNS) * math.pi / TURNS).tolist():
                dx, dy = rules.width / 2 * math.cos(angle), rules.width / 2 * math.sin(angle)
                ends = np.array([(x - dx, y - dy), (x + dx, y + dy)])
                yield self._strip(ends, THICKNESS, False)

    def _grid(self, step: float, wanted: Callable[[Points], Mask]) -> Points:
        """Return the wanted points of a floor grid common to all buildings, shape (N, 2)."""
        if self.wide.is_empty:
            return np.empty((0, 2))
        xmin, ymin, xmax, ymax = self.wide.bounds
        xs = np.arange(math.ceil(xmin / step), math.floor(xmax / step) + 1) * step
        ys = np.arange(math.ceil(ymin / step), math.floor(ymax / step) + 1) * step
        grid = np.stack([axis.ravel() for axis in np.meshgrid(xs, ys)], axis=1)
        grid = grid[wanted(grid)]
        inside = shapely.intersects_xy(self.wide, grid) & shapely.intersects_xy(self.floor, grid)
        return np.asarray(grid[inside], dtype=np.float64)

    def _post(self, x: float, y: float, on_wall: bool) -> Candidate:
        kind = "reflector" if self.rules.reflective else "post"
        drawn = DrawnObstacle(kind, (_round((x, y)),), radius=self.rules.radius)
        return Candidate("post", drawn, on_wall)

    def _strip(self, ends: Points, thickness: float, on_wall: bool) -> Candidate:
        kind = "reflector" if self.rules.reflective else "panel"
        first, last = (_round(end) for end in ends.tolist())
        drawn = DrawnObstacle(kind, (first, last), thickness=thickness)
        return Candidate(self.rules.kind, drawn, on_wall)


def _round(point: Sequence[float]) -> tuple[float, float]:
    """Round to a tenth of a millimetre, so that written and computed values agree."""
    return round(point[0], 4), round(point[1], 4)


def _rings(part: shapely.Polygon) -> list[shapely.LinearRing]:
    """Return the rings of a polygon, its inside to the left of each."""
    turned = shapely.geometry.polygon.orient(part)
    return [turned.exterior, *turned.interiors]


def _distances_along(ring: shapely.LinearRing, step: float) -> NDArray[np.float64]:
    """Return distances along a ring about `step` metres apart, metres; empty for a short ring."""
    count = int(ring.length / step)
    return np.asarray((np.arange(count) + 0.5) * (ring.length / max(count, 1)))


def _points_at(ring: shapely.LinearRing, along: NDArray[np.float64]) -> Points:
    """Return points at given distances along a ring, metres, shape (N, 2)."""
    corners = shapely.get_coordinates(ring)
    metres = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    along = along % metres[-1]
    return np.column_stack([np.interp(along, metres, axis) for axis in corners.T])
