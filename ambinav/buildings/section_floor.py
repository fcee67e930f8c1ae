"""Environment of a building that was cut at a scanner's height."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.coverage import Coverage
from ambinav.buildings.mesh_section import GRAIN
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.edit import HALF_WALL, polygons_of
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

DOORS: Final = ("open", "closed")
GLASS: Final = ("solid", "clear")
GAP: Final = 0.005
"""Metres; narrower gaps between walls are closed."""
SPECK: Final = 1e-5
"""Square metres; smaller solids are left out."""
NARROWEST: Final = 0.1
"""Metres; floor that is nowhere as wide is a cavity in a wall."""
LEAST_FLOOR: Final = 0.25
"""Square metres; a smaller piece of floor, behind a pane say, is left out."""
STRAIGHT: Final = 3.0 * GRAIN
"""Metres; a corner of the floor this near to the line between its neighbours is rounding."""
PANE: Final = 0.01
"""Metres; how thick a pane is to a robot that is drawn as a line."""
# Metres. A border that is bare for less is a corner's rounding; see `environment_from_shapes`.
_BARE: Final = 1e-2
_NEAR: Final = 1e-3
_CAVITY: Final = f"they are nowhere {NARROWEST:g} m wide, cavities in walls"
_BEYOND: Final = (
    "they lie behind openings in the outline, or between buildings, and count as outdoors; draw a "
    "line across each opening on a layer of the role floor to have them"
)
_DOUBTFUL: Final = f"several openings lead there, but {_BEYOND}"


@dataclass(frozen=True)
class PlanSection:
    """Section of a storey as a plan shows it; metres, map frame.

    Attributes:
        solids: Polygons that rays and robots do not pass.
        walls: Lines without thickness that they do not pass.
        panes: Polygons and lines of glass.
        region: Where floor can be: polygons; what is beyond is not known.
        within: Floor counts if more than half of it lies in these polygons; empty: all does.
        barred: Polygons that rays pass and robots do not: stairs, holes of the floor.
        beyond: Spaces that are enclosed but for an opening and count as outdoors, polygons.
        doubtful: Those of them that several openings lead into.
        doors: Each a line where it shuts.
        rooms: Their names, and the polygons that they fill or points in them.
        remedy: What to do where there is no floor.
    """

    solids: Sequence[BaseGeometry]
    walls: Sequence[BaseGeometry] = ()
    panes: Sequence[BaseGeometry] = ()
    region: BaseGeometry = field(default_factory=shapely.MultiPolygon)
    within: BaseGeometry = field(default_factory=shapely.MultiPolygon)
    barred: Sequence[BaseGeometry] = ()
    beyond: Sequence[BaseGeometry] = ()
    doubtful: Sequence[BaseGeometry] = ()
    doors: Sequence[BaseGeometry] = ()
    rooms: Sequence[tuple[str, BaseGeometry]] = ()
    remedy: str = "check the storey, the height of the section and the unit"


def check_choice(where: str, name: str, value: object, choices: Sequence[str]) -> None:
    """Check an option that allows only certain values.

    Raises:
        InputError: it has another.
    """
    if value not in choices:
        raise InputError(f"{where}: {name} is {value!r}; it must be {' or '.join(choices)}.")


def environment_of(
    plan: PlanSection,
    name: str,
    *,
    clear_glass: bool,
    source: Path,
    checksum: str,
    notes: Iterable[str],
) -> Environment:
    """Make the environment of a section.

    Args:
        plan: The section.
        name: Name in reports.
        clear_glass: Whether rays pass glass; robots never do.
        source: The file.
        checksum: Checksum of the file and the options.
        notes: What was chosen or left out.

    Raises:
        InputError: no floor is left.
    """
    solid = merged(plan.solids)
    panes = [pane for pane in plan.panes if pane.geom_type.endswith("Polygon")]
    sheets = [pane for pane in plan.panes if not pane.geom_type.endswith("Polygon")]
    opaque = solid if clear_glass else merged([solid, *panes])
    walls = [*plan.walls, *([] if clear_glass else sheets)]
    free = shapely.difference(plan.region, opaque, grid_size=GRAIN)
    covered = Coverage(f"{source}", expected=(_CAVITY, _BEYOND), doors=plan.doors)
    covered.rooms += plan.rooms
    covered.walls = [*shapely.get_parts(solid), *walls, *sheets, *panes]
    why = [_why_no_floor(part, plan.within) for part in shapely.get_parts(free)]
    for reason in sorted({reason for reason in why if reason}):
        covered.leave_out(shapely.get_parts(free)[[cause == reason for cause in why]], reason)
    covered.leave_out(plan.beyond, _BEYOND)
    covered.leave_out(plan.doubtful, _DOUBTFUL)
    parts = shapely.get_parts(free)[[not reason for reason in why]]
    if not len(parts):
        raise InputError(
            f"{source}: no floor is left in {name!r} between its walls; {plan.remedy}."
        )
    free = polygons_of(shapely.union_all([straightened(part) for part in parts]))
    glass: list[BaseGeometry] = []
    barred = list(plan.barred)
    if clear_glass:
        barred += [*panes, *(shapely.buffer(sheet, 0.5 * PANE) for sheet in sheets)]
    else:
        glass = [*sheets, *(shapely.boundary(pane) for pane in panes)]
    return environment_from_shapes(
        rooms=shapely.get_parts(free),
        walls=[line for line in walls if line.length > 0.0],
        openings=_bare_stretches(free, [opaque, *walls]),
        name=name,
        glass=[line for line in glass if shapely.dwithin(free, line, _NEAR)],
        drivable=_drivable(free, barred, walls),
        source=source,
        checksum=checksum,
        notes=[*notes, *covered.notes(free, stacklevel=6)],
    )


def merged(shapes: Sequence[BaseGeometry]) -> BaseGeometry:
    """Return the union of polygons, without gaps narrower than `GAP`, and without specks.

    What is already there stays where it is: only what fills the gaps is added.
    """
    union = shapely.union_all(list(shapes), grid_size=GRAIN)
    patches = shapely.difference(closed(union, GAP), union, grid_size=GRAIN)
    union = shapely.union_all([union, *shapely.get_parts(polygons_of(patches))], grid_size=GRAIN)
    solid = [part for part in shapely.get_parts(union) if _is_solid(part)]
    return shapely.MultiPolygon(solid)


def closed(shape: BaseGeometry, gap: float) -> BaseGeometry:
    """Fill gaps up to a width in polygons and lines; corners stay."""
    # GEOS divides by zero where a mitre has no tip, and cuts it off then; its result is right.
    with np.errstate(invalid="ignore"):
        wide = shapely.buffer(shape, 0.5 * gap, join_style="mitre", cap_style="square")
        return shapely.buffer(wide, -0.5 * gap, join_style="mitre")


def straightened(part: shapely.Polygon) -> shapely.Polygon:
    """Remove corners at which the border of a polygon does not bend.

    Shapely's `simplify` keeps a corner that, by rounding, is the furthest from a line elsewhere.
    """
    rings = [
        _bends(shapely.get_coordinates(ring)[:-1]) for ring in (part.exterior, *part.interiors)
    ]
    return shapely.Polygon(rings[0], rings[1:])


def filled(shape: BaseGeometry) -> BaseGeometry:
    """Return polygons without their holes."""
    parts = shapely.get_parts(polygons_of(shape))
    return shapely.union_all([shapely.Polygon(part.exterior) for part in parts])


def opened(shape: BaseGeometry, width: float) -> BaseGeometry:
    """Return the pieces of polygons that are at least this wide somewhere."""
    inner = shapely.buffer(shape, -0.5 * width, join_style="mitre")
    return polygons_of(shapely.buffer(inner, 0.5 * width, join_style="mitre"))


def _bends(corners: Floats) -> Floats:
    """Return the corners of a ring, shape (n, 2), without those on a straight line."""
    while len(corners) > 3:
        before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        chords = shapely.linestrings(np.stack([before, after], axis=1))
        flat = shapely.distance(chords, shapely.points(corners)) < STRAIGHT
        # Remove only one of two neighbours at a time.
        flat &= ~np.roll(flat, 1) | (np.arange(len(flat)) % 2 == 0)
        flat &= ~np.roll(flat, 1)
        if not flat.any():
            break
        corners = corners[~flat]
    return corners


def _is_solid(part: BaseGeometry) -> bool:
    return isinstance(part, shapely.Polygon) and part.area > SPECK


def _why_no_floor(part: BaseGeometry, within: BaseGeometry) -> str:
    """Return why a part between walls is no floor; "" if it is floor."""
    if part.geom_type != "Polygon" or part.area < LEAST_FLOOR:
        return f"each is smaller than {LEAST_FLOOR:g} m²"
    if shapely.buffer(part, -0.5 * NARROWEST).is_empty:
        return _CAVITY
    if within.is_empty or shapely.intersection(part, within).area > 0.5 * part.area:
        return ""
    return "they lie on no slab and in no space of the storey"


def _bare_stretches(free: BaseGeometry, walls: Sequence[BaseGeometry]) -> list[BaseGeometry]:
    """Return the stretches of the floor's border without a wall."""
    near = shapely.buffer(shapely.geometrycollections([w for w in walls if not w.is_empty]), _NEAR)
    bare = shapely.line_merge(shapely.difference(free.boundary, near))
    return [line for line in shapely.get_parts(bare) if line.length > 2.0 * _BARE]


def _drivable(
    free: BaseGeometry, barred: Sequence[BaseGeometry], walls: Sequence[BaseGeometry]
) -> BaseGeometry | None:
    """Return the floor without areas closed to robots only; None if there are none.

    Its border is all that footprints look at, so that walls without thickness get a little.
    """
    barred = [shape for shape in barred if shape.area > 0.0 and shape.intersects(free)]
    if not barred:
        return None
    solid = [*barred, *(shapely.buffer(wall, HALF_WALL) for wall in walls)]
    left = shapely.difference(free, shapely.union_all(solid, grid_size=GRAIN), grid_size=GRAIN)
    return opened(left, 2.0 * PANE)
