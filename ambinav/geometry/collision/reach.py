"""Floor that a robot can reach: the connected part of the floor where a disc fits.

The centre of a disc of radius r may stand wherever every obstacle is at least r away: in the free
space shrunk by r (its erosion, Lozano-Perez 1983: configuration space). Two places of it are
connected by a motion if, and only if, they lie in the same connected piece. So pieces are
computed as polygons, not on a lattice: a door is judged by its width alone.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.config import as_positive, check_kind
from ambinav.config.numbers import shown
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.array_types import Bools, Bounds
from ambinav.runtime.errors import InputError, InputWarning

ROBOT_RADIUS: Final = 0.2
"""Radius in metres if neither the caller nor the scanner gives the size of the robot."""
SLACK: Final = 1e-6
"""Metres that the disc may be smaller: a gap of exactly its width is wide enough."""
QUAD_SEGS: Final = 16
"""Number of chords that approximate a quarter of a circle. An arc of up to one and a half chords is
one chord, so at a corner a disc may come nearer than its radius by 0.27 % of it."""
MARGIN_SHARE: Final = 0.25
"""Share of the map's rim from which a piece that lies along it is taken for a page's margin."""
MARGIN_RIVAL: Final = 0.05
"""A margin is passed over only for a piece of at least this share of its area: streets that the
edge of a map cuts through are not left out for a backyard."""
ON_RIM: Final = 0.1
"""Metres; a frontier this near to the rim of a map lies on it, or one cell where that is more."""
INSIDE: Final = 0.008
"""Metres that an offered place lies inside of where the disc fits: it is rounded to 1 cm."""
WINDOW_CORNERS: Final = 600
"""Corners of an outline that are shrunk at a time."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Floor where the centre of a disc can stand, and the part of it that the disc can reach.

    Attributes:
        radius: Radius of the disc, metres.
        start: x and y from which it sets out, metres; None: in the piece chosen by `find_reach`.
        fits: Everywhere that the disc fits, map frame, metres.
        floor: The connected piece of `fits` that it can reach.
        margins: Other pieces of `fits` that lie along the map's rim as the margin of a page does:
            outside of the building.
        notes: What was found at the rim of the map, in sentences.
    """

    radius: float
    start: tuple[float, float] | None
    fits: BaseGeometry
    floor: BaseGeometry
    margins: BaseGeometry
    notes: tuple[str, ...]

    def reaches(self, x: ArrayLike, y: ArrayLike) -> Bools:
        """Return whether the disc can reach these points; metres, broadcast."""
        return _contains(self.floor, x, y)

    def has_room(self, x: ArrayLike, y: ArrayLike) -> Bools:
        """Return whether the disc fits at these points, reachable or not; metres, broadcast."""
        return _contains(self.fits, x, y)


# Cached, as a map and its audit ask for the same floor.
_known: WeakKeyDictionary[Environment, dict[object, Reach]] = WeakKeyDictionary()


class FitsNowhereError(InputError):
    """The disc fits nowhere in the building."""


def find_reach(
    environment: Environment, radius: float, start: Sequence[float] | None = None
) -> Reach:
    """Find the floor that a disc can reach, and warn of floor at the map's border.

    Args:
        environment: The building.
        radius: Radius of the disc, metres, above zero.
        start: x and y of the start, metres.

    Raises:
        InputError: see `reach_of`.

    Warns:
        InputWarning: free floor touches the border of the map.
    """
    reach = reach_of(environment, radius, start)
    for note in reach.notes:
        warnings.warn(note, InputWarning, stacklevel=2)
    return reach


def check_reach(reach: Reach) -> None:
    """Check that an argument `reach` is one, or raise `InputError`."""
    check_kind(reach, Reach, "reach", "give what `find_reach` returns")


def reach_of(
    environment: Environment,
    radius: float,
    start: Sequence[float] | None = None,
    before: tuple[BaseGeometry, Sequence[Bounds]] | None = None,
) -> Reach:
    """Find the floor that a disc can reach.

    Without a start that is the largest piece, by where the centre can stand. A piece along a
    quarter of the map's rim or more (`MARGIN_SHARE`) is passed over, as the margin of a page, if
    another one has a twentieth of its area (`MARGIN_RIVAL`).

    Args:
        environment: The building.
        radius: Radius of the disc, metres, above zero.
        start: x and y of the start, metres.
        before: Where the disc fitted (`Reach.fits`) in a building that differs in some boxes alone,
            the radius and `SLACK` included, and these boxes.

    Raises:
        InputError: the radius is not above zero, the disc does not fit at the start, or it fits
            nowhere (`FitsNowhereError`).
    """
    check_kind(environment, Environment, "environment")
    key = as_positive(radius, "robot radius", "metres"), None if start is None else _pair(start)
    by_key = _known.setdefault(environment, {})
    if key not in by_key:
        by_key[key] = _reach_of(environment, *key, before)
    return by_key[key]


def _reach_of(
    environment: Environment,
    radius: float,
    start: tuple[float, float] | None,
    before: tuple[BaseGeometry, Sequence[Bounds]] | None,
) -> Reach:
    fits = (
        room_for(environment, radius) if before is None else _patched(environment, radius, *before)
    )
    pieces = _pieces(fits)
    if not pieces:
        raise FitsNowhereError(
            f"{_label(environment)}: a robot of radius {radius:g} m fits nowhere, the widest place "
            f"takes {_widest(environment, radius):g} m; give a smaller robot radius."
        )
    frontiers, on_rim = frontier_lines(environment)
    rim = shapely.multilinestrings(frontiers[on_rim])
    notes = _rim_notes(environment, rim)
    shares = [_share_of_rim(environment, rim, piece, radius) for piece in pieces]
    if start is not None:
        place = _checked_start(environment, radius, start, fits)
        floor = min(pieces, key=lambda piece: float(piece.distance(shapely.Point(place))))
        where: tuple[float, float] | None = place
    else:
        floor, where = pieces[_chosen(pieces, shares)], None
        if floor is not pieces[0]:
            notes.append(
                f"{_label(environment)}: the largest piece of floor, of {pieces[0].area:,.0f} m², "
                f"lies along {100 * shares[0]:.0f} % of the map's rim, as the margin of a page "
                f"does, so the next of {floor.area:,.0f} m² is taken; --start X Y takes another."
            )
    along_rim = [
        piece
        for piece, share in zip(pieces, shares, strict=True)
        if share >= MARGIN_SHARE and piece is not floor
    ]
    margins = shapely.union_all(along_rim)
    shapely.prepare([fits, floor, margins])
    return Reach(float(radius), where, fits, floor, margins, tuple(notes))


def room_for(environment: Environment, radius: float, within: Bounds | None = None) -> BaseGeometry:
    """Compute where the centre of a disc of `radius` metres can stand.

    The area may be empty or disconnected.

    Args:
        environment: The building.
        radius: Radius of the disc, metres.
        within: Only there; None: everywhere.
    """
    inner = radius - min(SLACK, 0.5 * radius)
    # As in planners: no occupied cell of the map is floor for a body.
    geometry = environment.collision
    free, lines = geometry.free, shapely.linestrings(geometry.thin_walls.reshape(-1, 2, 2))
    if within is not None:
        around = (*np.subtract(within[:2], 2.0 * radius), *np.add(within[2:], 2.0 * radius))
        free = shapely.clip_by_rect(free, *around)
        lines = lines[shapely.intersects(lines, shapely.box(*around))]
    fits = eroded(free, inner)
    if len(lines):
        thin = shapely.buffer(shapely.multilinestrings(lines), inner, quad_segs=QUAD_SEGS)
        fits = shapely.difference(fits, thin)
    return fits if within is None else shapely.clip_by_rect(fits, *within)


def _patched(
    environment: Environment, radius: float, fits: BaseGeometry, boxes: Sequence[Bounds]
) -> BaseGeometry:
    """Return `room_for`, taken from another building except in the given boxes."""
    for box in boxes:
        there = room_for(environment, radius, box)
        fits = shapely.union(shapely.difference(fits, shapely.box(*box)), there)
    return fits


def _pieces(fits: BaseGeometry) -> list[BaseGeometry]:
    """Return connected pieces, the largest first."""
    parts = [part for part in shapely.get_parts(fits).tolist() if part.area > 0.0]
    # Of equal pieces the one farthest to the left: the order in which they were drawn says nothing.
    return sorted(parts, key=lambda part: (-round(float(part.area), 6), part.bounds))


def _widest(environment: Environment, radius: float) -> float:
    """Return the largest radius below `radius` that fits somewhere, rounded down to two digits."""
    low, high = 0.0, radius
    while high - low > 0.005 * high:
        middle = 0.5 * (low + high)
        if middle < SLACK:
            break
        if _pieces(room_for(environment, middle)):
            low = middle
        else:
            high = middle
    if low == 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(low)) - 1)
    return float(f"{math.floor(low / unit) * unit:.2g}")


def eroded(free: BaseGeometry, radius: float) -> BaseGeometry:
    """Shrink the free space by a radius, metres; large outlines are processed in windows.

    GEOS takes time with more than the square of the corners of an outline, and near any place only
    those within the radius decide. Windows share their borders, so that what is connected stays so.
    """
    corners = int(shapely.get_num_coordinates(free))
    side = round(math.sqrt(corners / WINDOW_CORNERS))
    if side < 2:
        return shapely.buffer(free, -radius, quad_segs=QUAD_SEGS)
    xmin, ymin, xmax, ymax = free.bounds
    columns, rows = np.linspace(xmin, xmax, side + 1), np.linspace(ymin, ymax, side + 1)
    margin = 2.0 * radius
    pieces = []
    for low, high in pairwise(rows.tolist()):
        band = shapely.clip_by_rect(free, xmin, low - margin, xmax, high + margin)
        for left, right in pairwise(columns.tolist()):
            around = shapely.clip_by_rect(
                band, left - margin, low - margin, right + margin, high + margin
            )
            shrunk = shapely.buffer(around, -radius, quad_segs=QUAD_SEGS)
            pieces.append(shapely.clip_by_rect(shrunk, left, low, right, high))
    return shapely.union_all(pieces)


def frontier_lines(environment: Environment) -> tuple[NDArray[np.object_], Bools]:
    """Return frontiers to unknown space as lines, (N,), and which lie on the map's rim."""
    segments = environment.segments
    lines = shapely.linestrings(segments.xy[segments.kind == FRONTIER].reshape(-1, 2, 2))
    if environment.extent is None:
        return lines, np.zeros(len(lines), dtype=np.bool_)
    near = max(ON_RIM, environment.resolution or 0.0)
    band = shapely.buffer(environment.extent.exterior, near, cap_style="flat", join_style="mitre")
    shapely.prepare(band)
    return lines, np.asarray(shapely.covers(band, lines), dtype=np.bool_)


def _rim_notes(environment: Environment, rim: BaseGeometry) -> list[str]:
    if rim.is_empty:
        return []
    longest = max(shapely.get_parts(rim).tolist(), key=lambda line: float(line.length))
    at = longest.interpolate(0.5, normalized=True)
    return [
        f"{_label(environment)}: free floor touches the rim of the map along {rim.length:,.1f} m, "
        f"the longest stretch around x = {round(at.x, 1) + 0.0:.1f} m, "
        f"y = {round(at.y, 1) + 0.0:.1f} m: there the map ends, not the building."
    ]


def _share_of_rim(
    environment: Environment, rim: BaseGeometry, piece: BaseGeometry, radius: float
) -> float:
    """Return the share of the map's rim that a disc in this piece can touch."""
    if environment.extent is None or rim.is_empty:
        return 0.0
    near = 1.01 * radius + max(ON_RIM, environment.resolution or 0.0)
    if piece.distance(rim) > near:
        return 0.0
    beside = piece.intersection(shapely.buffer(rim, 1.1 * near))
    touched = rim.intersection(shapely.buffer(beside, near))
    return float(touched.length / environment.extent.exterior.length)


def _chosen(pieces: Sequence[BaseGeometry], shares: Sequence[float]) -> int:
    """Choose the piece of floor to use where no start is given; the pieces are sorted."""
    if shares[0] >= MARGIN_SHARE:
        least = MARGIN_RIVAL * pieces[0].area
        for i, (piece, share) in enumerate(zip(pieces, shares, strict=True)):
            if share < MARGIN_SHARE and piece.area >= least:
                return i
    return 0


def _pair(start: Sequence[float]) -> tuple[float, float]:
    """Return the start as x and y, or raise `InputError`."""
    try:
        x, y = map(float, start)
    except (TypeError, ValueError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(
            f"from {shown(start)}: give two finite numbers of metres in the map frame."
        )
    return x, y


def _checked_start(
    environment: Environment, radius: float, start: tuple[float, float], fits: BaseGeometry
) -> tuple[float, float]:
    """Return the start.

    Raises:
        InputError: the disc does not fit there; the message has the nearest place.
    """
    x, y = start
    point = shapely.Point(x, y)
    if fits.distance(point) <= SLACK:
        return x, y
    checker = CollisionChecker(environment, Footprint.disc(radius), Steering("r2"))
    why = checker.why_not(x, y) or "too near to an obstacle"
    # A little inside, so that what is offered still fits when it is rounded.
    inner, digits = shapely.buffer(fits, -INSIDE), 2
    if inner.is_empty:
        inner, digits = fits, 6
    nearest = shapely.shortest_line(point, inner).coords[1]
    raise InputError(
        f"from ({x:.10g}, {y:.10g}): a robot of radius {radius:g} m cannot stand there, for that "
        f"is {why}; the nearest place that fits is ({nearest[0]:.{digits}f}, "
        f"{nearest[1]:.{digits}f}), {math.dist((x, y), nearest):.2f} m away."
    )


def _contains(shape: BaseGeometry, x: ArrayLike, y: ArrayLike) -> Bools:
    return np.asarray(shapely.contains_xy(shape, *np.broadcast_arrays(x, y)), dtype=np.bool_)


def _label(environment: Environment) -> str:
    return str(environment.source) if environment.source is not None else environment.name
