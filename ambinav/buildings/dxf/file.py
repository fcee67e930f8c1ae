"""Floor plans from DXF: the layers of a CAD drawing."""

from __future__ import annotations

import hashlib
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.damaged_files import reading
from ambinav.buildings.dxf.layers import roles_of
from ambinav.buildings.dxf.lines import ABSENT, Drawn, Written, drawn_in, opened, swing
from ambinav.buildings.outline import outline_of
from ambinav.buildings.plan_units import LARGEST, UNITS, metres_in
from ambinav.buildings.section_floor import DOORS, GLASS, PlanSection, check_choice, environment_of
from ambinav.buildings.wall_bodies import beside, bodies_in, capped, noded
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import sha256

TOLERANCE: Final = 1e-3
"""Metres; the chords of arcs and splines lie this near to them."""
# What $INSUNITS says, as far as buildings are drawn in it, and its name.
_INSUNITS: Final = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m"}
_SPELLED: Final = {"in": "inch", "ft": "foot", "mm": "millimetre", "cm": "centimetre", "m": "metre"}
# Metres. No building is smaller; no leaf of a door narrower or wider.
_SMALLEST: Final = 2.0
_LEAF: Final = (0.5, 1.6)
# Metres; how thick the leaf of a closed door is.
_THICK: Final = 0.04
# Metres. Nearer to the middle of a leaf than this, something that is drawn is that leaf.
_BESIDE: Final = 0.06
# A part of a drawing with a smaller share of the floor of the largest is not worth a word; more
# parts than this are hardly buildings.
_PART: Final = 0.05
_BUILDINGS: Final = 2
# In a room's name.
_WORD: Final = r"[^\W\d_]{3,}"
# Radians. A door is drawn half or fully open.
_OPEN: Final = (0.6, 1.7)


def load_dxf(
    path: Path,
    *,
    unit: str | None = None,
    doors: str = "open",
    glass: str = "solid",
    furniture: bool = True,
    layers: Mapping[str, str] | None = None,
) -> Environment:
    """Read the plan in the model space of a drawing.

    Two lines that enclose up to `THICKEST` are a wall with two sides, others walls without
    thickness. Free floor is what lies within the outline of everything, openings up to `DOORWAY`
    taken for closed; what lies beyond is not known.

    Args:
        path: The file.
        unit: What the drawing is in (`UNITS`); None: what its $INSUNITS says, if it makes a
            building.
        doors: "open": they are left out; "closed": each door's arc is a wall from its hinge to
            where it shuts.
        glass: "solid": panes stop rays; "clear": they stop robots only.
        furniture: Whether furniture is there.
        layers: What is on layers (`dxf.layers.ROLES`) by their names, where those do not say it.

    Raises:
        InputError: the file cannot be read, nothing is drawn in it or no walls, its unit has to be
            stated, or an option has a value of no use.
    """
    check_choice(f"{path}", "doors", doors, DOORS)
    check_choice(f"{path}", "glass", glass, GLASS)
    scale = metres_in(unit, f"{path}")
    document = opened(path)
    drawing_unit = _INSUNITS.get(int(document.header.get("$INSUNITS", 0)))
    scale = scale if unit else UNITS.get(drawing_unit or "m", 1.0)
    skipped: Counter[str] = Counter()
    texts: list[Written] = []
    with reading(path, "DXF"):
        drawn = list(drawn_in(f"{path}", document, TOLERANCE / scale, skipped, texts))
    if not drawn:
        blocks = sum(not block.name.startswith("*") for block in document.blocks)
        lead = f"its {blocks} blocks are inserted nowhere with" if blocks else "it holds"
        remedy = "draw the plan there, or insert the block"
        if skipped:
            lead, remedy = f"beside {_counted(skipped)} it holds", "draw the plan there, or show it"
        raise InputError(f"{path}: {lead} no lines in the model space; {remedy}.")
    absent = {kind: count for kind, count in skipped.items() if kind.startswith(ABSENT)}
    if absent:
        warnings.warn(
            f"{path}: what {_counted(absent)} would show is missing; bind external references "
            "into the drawing",
            InputWarning,
            stacklevel=4,
        )
    roles, left_out = roles_of(f"{path}", (element.layer for element in drawn), layers)
    by_role: dict[str, list[Drawn]] = {}
    for element in drawn:
        if element.layer in roles:
            by_role.setdefault(roles[element.layer], []).append(element)
    arcs = [element.arc for element in by_role.get("doors", ()) if element.arc is not None]
    if unit is None:
        _check_unit(
            path, drawing_unit, [*by_role.get("walls", ()), *by_role.get("columns", ())], arcs
        )
    lines = {
        role: [
            scale * corners
            for element in elements
            if role != "doors" or element.arc is None
            for corners in element.paths
        ]
        for role, elements in by_role.items()
    }
    section, mouths = _section(lines, [scale * arc for arc in arcs], doors == "closed", furniture)
    section = replace(section, rooms=_rooms(texts, roles, scale, section.region))
    options = f"{scale=} {doors=} {glass=} {furniture=} {sorted(roles.items())}"
    return environment_of(
        section,
        path.stem,
        clear_glass=glass == "clear",
        source=path,
        checksum=hashlib.sha256(f"{sha256(path)} {options}".encode()).hexdigest(),
        notes=[*_notes(path, roles, left_out, skipped, mouths), *_parts(path, section)],
    )


def _check_unit(
    path: Path, drawing_unit: str | None, walls: Sequence[Drawn], arcs: Sequence[Floats]
) -> None:
    """Raise `InputError` if the unit is missing, or gives no plausible building.

    Raises:
        InputError: it has to be stated.
    """
    ask = f"say with --unit whether its numbers are {', '.join([*UNITS][:-1])} or {[*UNITS][-1]}."
    corners = np.concatenate([corners for wall in walls for corners in wall.paths])
    width, height = np.ptp(corners, axis=0).tolist()
    leaves = [radius for radius, turn in map(swing, arcs) if _OPEN[0] <= turn <= _OPEN[1]]
    leaf = float(np.median(leaves)) if leaves else None
    if drawing_unit is None:
        doors = "" if leaf is None else f", its doors {leaf:.4g} wide"
        raise InputError(
            f"{path}: $INSUNITS says no unit that buildings are drawn in; its walls are "
            f"{width:.4g} by {height:.4g} in all{doors}; {ask}"
        )
    scale = UNITS[drawing_unit]
    fits = _SMALLEST <= scale * max(width, height) <= LARGEST
    doors = ""
    if leaf is not None:
        fits &= _LEAF[0] <= scale * leaf <= _LEAF[1]
        doors = f" and its doors {scale * leaf:.2g} m wide"
    if not fits:
        raise InputError(
            f"{path}: $INSUNITS says {_SPELLED[drawing_unit]}, but then its walls are "
            f"{scale * width:.3g} by {scale * height:.3g} m in all{doors}; {ask}"
        )


def _section(
    lines: Mapping[str, Sequence[Floats]],
    arcs: Sequence[Floats],
    doors_closed: bool,
    furniture: bool,
) -> tuple[PlanSection, list[BaseGeometry]]:
    """Build the bounds and the area of the floor from corners in metres.

    Return wide openings to outdoors too.
    """
    net = capped(noded(lines.get("walls", ())))
    walls = bodies_in(net)
    columns = noded(lines.get("columns", ()))
    solids = [*walls, *bodies_in(columns, None)]
    thin = [*beside(net, solids), *beside(columns, solids)]
    standing = shapely.union_all([*solids, *thin])
    # A pane may end at a wall without a line of its own there.
    panes: list[BaseGeometry] = []
    if lines.get("glass"):
        glazing = noded(lines["glass"])
        both = shapely.union_all([glazing, shapely.boundary(shapely.union_all(solids))])
        panes = [
            body for body in bodies_in(both) if not standing.contains(body.representative_point())
        ]
        panes += beside(glazing, [*panes, *solids])
    drawn = shapely.union_all([shapely.LineString(line) for line in lines.get("doors", ())])
    leaves = _leaves(arcs, drawn, shapely.union_all([standing, *panes]))
    glazed = [pane for pane in panes if pane.geom_type.endswith("Polygon")]
    outline = outline_of(
        [*solids, *glazed],
        [*thin, *(pane for pane in panes if not pane.geom_type.endswith("Polygon"))],
        leaves,
        [shapely.LineString(line) for line in lines.get("floor", ())],
    )
    if doors_closed:
        solids += [shapely.buffer(leaf, 0.5 * _THICK, cap_style="flat") for leaf in leaves]
    if furniture and lines.get("furniture"):
        inside = noded(lines["furniture"])
        pieces = bodies_in(inside, None)
        solids.append(shapely.union_all(pieces))
        thin += beside(inside, pieces)
    section = PlanSection(
        solids=solids,
        walls=thin,
        panes=panes,
        region=outline.region,
        beyond=outline.outside,
        doubtful=outline.doubtful,
        doors=leaves,
        remedy="draw a line across each opening of the outline on a layer of the role floor, or "
        "check the layers and the unit",
    )
    return section, outline.mouths


def _rooms(
    texts: Sequence[Written], roles: Mapping[str, str], scale: float, region: BaseGeometry
) -> list[tuple[str, BaseGeometry]]:
    """Return the texts that may be names of rooms: words within the building."""
    hull = shapely.convex_hull(region)
    return [
        (text.text, point)
        for text in texts
        if roles.get(text.layer, "floor") == "floor" and re.search(_WORD, text.text)
        if hull.contains(point := shapely.Point(scale * np.array(text.at)))
    ]


def _leaves(
    arcs: Sequence[Floats], drawn: BaseGeometry, bounds: BaseGeometry
) -> list[BaseGeometry]:
    """Return shut doors as lines, each from its arc's hinge to one end of the arc.

    It is the end to which no leaf is drawn, since leaves are drawn open; else the one that is
    nearer to a wall, a pane or another door's end.

    Args:
        arcs: Their centres, starts and ends, each of shape (3, 2), metres.
        drawn: The other lines of the layer.
        bounds: Walls and panes.
    """
    leaves = []
    for k, arc in enumerate(arcs):
        others = [end for j, other in enumerate(arcs) if j != k for end in other[1:]]
        near = shapely.union(bounds, shapely.MultiPoint(others))
        both = [shapely.LineString([arc[0], end]) for end in arc[1:]]
        bare = [leaf for leaf in both if not _is_drawn(leaf, drawn)]
        if len(bare) != 1:
            bare = both
        leaves.append(min(bare, key=lambda leaf: near.distance(shapely.Point(leaf.coords[-1]))))
    return leaves


def _is_drawn(leaf: BaseGeometry, drawn: BaseGeometry) -> bool:
    return bool(shapely.dwithin(leaf.interpolate(0.5, normalized=True), drawn, _BESIDE))


def _parts(path: Path, section: PlanSection) -> list[str]:
    """Note that a drawing shows several buildings, or a plan beside its elevations."""
    solid = shapely.union_all(list(section.solids))
    parts = [part.difference(solid).area for part in shapely.get_parts(section.region)]
    parts = sorted((area for area in parts if area > _PART * max(parts)), reverse=True)
    if len(parts) < 2:
        return []
    sizes = ", ".join(f"{area:.3g}" for area in parts)
    note = (
        f"{path}: {len(parts)} parts of it do not touch, of {sizes} m² of floor; if they are a "
        "plan beside its elevations or another storey, put the plan alone into the model space."
    )
    if len(parts) > _BUILDINGS:
        warnings.warn(note, InputWarning, stacklevel=4)
    return [note]


def _notes(
    path: Path,
    roles: Mapping[str, str],
    left_out: Sequence[str],
    skipped: Mapping[str, int],
    mouths: Sequence[BaseGeometry],
) -> list[str]:
    """List the role of each layer and everything that was left out."""
    taken = ", ".join(f"{name}: {role}" for name, role in sorted(roles.items()))
    notes = [f"{path}: layers are taken for {taken}."]
    if left_out:
        notes.append(f"{path}: the layers {', '.join(left_out)} are left out.")
    if skipped:
        notes.append(f"{path}: left out without lines: {_counted(skipped)}.")
    if mouths:
        widths = ", ".join(f"{width:.3g}" for width in sorted(line.length for line in mouths))
        notes.append(f"{path}: openings to outdoors wider than a door, in metres: {widths}.")
    return notes


def _counted(kinds: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
