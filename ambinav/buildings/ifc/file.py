"""Floor plans from IFC: a storey, cut at a scanner's height."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import ifcopenshell
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.damaged_files import reading
from ambinav.buildings.ifc.parts import (
    HEADROOM,
    ElementMesh,
    Parts,
    elements_of,
    meshes,
    part_role,
    parts_at,
)
from ambinav.buildings.ifc.storeys import WHOLE, Storey, base_of, chosen_storey, storeys_of
from ambinav.buildings.plan_levels import chosen_level
from ambinav.buildings.plan_units import LARGEST
from ambinav.buildings.section_floor import (
    DOORS,
    GLASS,
    PlanSection,
    check_choice,
    closed,
    environment_of,
    filled,
    opened,
)
from ambinav.config import as_number
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import ends_with, sha256

HIGHEST: Final = 20.0
"""Metres; no scanner is mounted higher."""
# Metres. The outline of a space runs this near to the walls around it, at least.
_REVEAL: Final = 0.3
# Metres. A hole in the floor is as wide; narrower ones are joints and thresholds.
_HOLE: Final = 0.6
# Metres. Between a slab and the walls around it rays cross what is up to this wide without floor:
# a stairwell, a small court, a pool.
_VOID: Final = 5.0
# Metres; the grid of slabs seen from above, whose edges bound nothing that a ray meets.
_ROUGH: Final = 1e-4
# Metres. No building's walls are all so low.
_LOWEST: Final = 0.1
# First bytes of an IFC file.
_BEGINNING: Final = 256
# Metres above the floor. Where a door has no part as low, it is a hatch.
_SILL: Final = 0.5
# Slabs that cover less of the floor than this share are not all of what robots drive on.
_COVERED: Final = 0.5


class StoreyPlan(NamedTuple):
    """Storey read from a file.

    Attributes:
        environment: Its plan.
        section: What the plan is made of.
        slab: The upper sides of its slabs, seen from above, metres.
        model: The file.
        storey: Which storey it is.
        next_floor: Elevation of the storey above it, metres; inf: it is the highest.
        meshes: Meshes of the elements that the plan was cut of.
    """

    environment: Environment
    section: PlanSection
    slab: BaseGeometry
    model: Any
    storey: Storey
    next_floor: float
    meshes: Sequence[ElementMesh]


def read_storey(
    path: Path, level: str | int | None, *, height: float, doors: str, glass: str, furniture: bool
) -> StoreyPlan:
    """Read a storey of a building: everything solid at a height above its floor.

    Free floor is within the IfcSpaces of the storey and the openings between them; without
    spaces above its slabs, and without those within the outline of its walls. What lies beyond is
    not known. Stairs and holes in the slab stop robots, not rays (`Environment.drivable`).

    Args:
        path: The file.
        level: Name of the storey, or its position from 0, the lowest, on; None: the only one.
        height: Height of the scanner above the storey's elevation, metres.
        doors: "open": leaves and frames are left out; "closed": they are walls.
        glass: "solid": panes stop rays; "clear": they stop robots only.
        furniture: Whether furniture and appliances are there.

    Returns:
        The plan, with the parts that it is made of.

    Raises:
        InputError: the file cannot be read, has no walls at the height, there are several storeys
            and none is chosen, or an option has a value of no use.
    """
    check_choice(f"{path}", "doors", doors, DOORS)
    check_choice(f"{path}", "glass", glass, GLASS)
    height = as_number(height, f"{path}: height")
    if not 0.0 < height <= HIGHEST:
        raise InputError(
            f"{path}: height is {height:g}; give metres above the floor, above 0 and up to "
            f"{HIGHEST:g}."
        )
    model = _opened(path)
    with reading(path, "IFC"):
        storeys = storeys_of(model)
    if not model.by_type("IfcWall") and not model.by_type("IfcCurtainWall"):
        raise InputError(
            f"{path}: there is no IfcWall in it; export the architect's model, with walls."
        )
    if storeys:
        storey = chosen_storey(f"{path}", storeys, level)
    else:
        chosen_level(f"{path}", [WHOLE], level)
        storey = Storey(WHOLE, _base(path, model), None)
    with reading(path, "IFC"):
        elements = elements_of(model, storey, height, furniture)
        parts = parts_at(model, elements, storey.elevation, height)
    _check_size(path, parts)
    if not (parts.of("wall") or parts.lines.get("wall") or parts.panes.get("window")):
        raise InputError(
            f"{path}: no wall stands {height:g} m above the floor of {storey.name!r} (elevation "
            f"{storey.elevation:.4g} m); choose another storey with --level, or another height."
        )
    options = f"level={storey.name} height={height!r} {doors=} {glass=} {furniture=}"
    notes = [
        f"{path}: storey {storey.name} at {storey.elevation:.4g} m, cut {height:g} m above it; "
        f"doors {doors}, glass {glass}, furniture {'in' if furniture else 'out'}."
    ]
    if parts.shapeless:
        note = (
            f"{path}: {parts.shapeless} of {len(elements)} elements have no sound body and are "
            "left out."
        )
        warnings.warn(note, InputWarning, stacklevel=5)
        notes.append(note)
    slab = closed(shapely.union_all(parts.floor, grid_size=_ROUGH), _REVEAL)
    cut = replace(
        _section(parts, slab, doors == "closed"),
        doors=_doors(parts, storey.elevation),
        rooms=parts.rooms,
    )
    environment = environment_of(
        cut,
        path.stem if len(storeys) < 2 else f"{path.stem} {storey.name}",
        clear_glass=glass == "clear",
        source=path,
        checksum=hashlib.sha256(f"{sha256(path)} {options}".encode()).hexdigest(),
        notes=notes,
    )
    above = [upper.elevation for upper in storeys if upper.elevation >= storey.elevation + HEADROOM]
    next_floor = min(above, default=math.inf)
    return StoreyPlan(environment, cut, slab, model, storey, next_floor, parts.meshes)


def _opened(path: Path) -> Any:
    try:
        if not path.stat().st_size:
            raise InputError(f"{path}: the file is empty; export it again.")
        is_whole = ends_with(path, b"END-ISO-10303-21;")
        with path.open("rb") as file:
            is_step = file.read(_BEGINNING).lstrip().startswith(b"ISO-10303-21;")
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}); name an IFC file.") from (
            error
        )
    # A missing part would be read as if it were never built.
    if is_step and not is_whole:
        raise InputError(
            f"{path}: this IFC file is cut off (END-ISO-10303-21 is missing at its end); "
            "export it again."
        )
    try:
        return ifcopenshell.open(str(path))
    except (ifcopenshell.Error, OSError, RuntimeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise InputError(f"{path}: this is not an IFC file ({reason}); export it again.") from error


def _check_size(path: Path, parts: Parts) -> None:
    """Check that the walls make a building: some programs write another unit than they name.

    Raises:
        InputError: they do not.
    """
    walls = [mesh.vertices for mesh in parts.meshes if part_role(mesh.element) == "wall"]
    if not walls:
        return
    width, depth, _ = np.ptp(np.concatenate(walls), axis=0).tolist()
    height = max(float(np.ptp(vertices[:, 2])) for vertices in walls)
    if max(width, depth) > LARGEST or height < _LOWEST:
        raise InputError(
            f"{path}: in the unit that the file names (IfcUnitAssignment) the walls of the storey "
            f"stand on {width:.3g} x {depth:.3g} m and are up to {height:.2g} m high, as those of "
            "no building; export it with the unit of its numbers."
        )


def _base(path: Path, model: Any) -> float:
    """Return the floor height of a building without storeys."""
    walls = [wall for wall in model.by_type("IfcWall") if wall.Representation]
    with reading(path, "IFC"):
        lows = [float(vertices[:, 2].min()) for _, vertices, _, _ in meshes(model, walls)]
    base = base_of(lows)
    if math.isnan(base):
        raise InputError(f"{path}: its walls have no shape; export it again, with bodies.")
    return base


def carries(slab: BaseGeometry, within: BaseGeometry) -> bool:
    """Return whether slabs cover enough of the area to be the floor on which robots drive."""
    return bool(shapely.intersection(slab, within).area > _COVERED * within.area)


def _doors(parts: Parts, floor: float) -> list[BaseGeometry]:
    """Return lines along the doors, in the middle of their walls."""
    lines = []
    for element, vertices, _, _ in parts.meshes:
        if part_role(element) not in ("door", "leaf"):
            continue
        low = vertices[vertices[:, 2] <= floor + _SILL]
        box = shapely.oriented_envelope(shapely.MultiPoint(low[:, :2]))
        if box.geom_type != "Polygon":
            continue
        corners = shapely.get_coordinates(box)
        middles = (corners[:-1] + corners[1:]) / 2.0
        across = np.hypot(*(corners[1:3] - corners[:2]).T)
        first = int(across[1] > across[0])
        lines.append(shapely.LineString(middles[[1 - first, 3 - first]]))
    return lines


def _section(parts: Parts, slab: BaseGeometry, doors_closed: bool) -> PlanSection:
    """Build the bounds and the area of the floor."""
    left_out = {"space", "opening"} if doors_closed else {"space", "opening", "door", "leaf"}
    solids = parts.of(*sorted(parts.areas.keys() - left_out))
    lines = [line for role in sorted(parts.lines.keys() - left_out) for line in parts.lines[role]]
    panes = [pane for role in sorted(parts.panes.keys() - left_out) for pane in parts.panes[role]]
    glass = [pane for pane in panes if pane.geom_type == "Polygon"]
    # A door that fills no opening stands in its own.
    around = [*solids, *glass, *parts.of("opening", "door")]
    outline = filled(closed(shapely.union_all(around), _REVEAL))
    spaces = shapely.union_all(parts.of("space"))
    if slab.is_empty:
        within = outline if spaces.is_empty else spaces
    else:
        within = filled(closed(shapely.union_all([slab, *solids]), _VOID))
        if not spaces.is_empty:
            within = shapely.union(spaces, shapely.intersection(within, outline))
    barred = list(parts.barred)
    if carries(slab, within):
        barred.append(opened(shapely.difference(within, slab), _HOLE))
    return PlanSection(
        solids=solids,
        walls=lines,
        panes=panes,
        region=closed(shapely.union_all([within, *around]), _REVEAL),
        within=within,
        barred=barred,
    )
