"""Storey of an IFC building in three dimensions: its bodies as prisms between heights."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.damaged_files import reading
from ambinav.buildings.ifc.file import StoreyPlan, carries, read_storey
from ambinav.buildings.ifc.parts import BELOW, bodies_of, elements_of, meshes, part_role
from ambinav.buildings.mesh_prisms import SLICE, slabs_of
from ambinav.buildings.section_floor import SPECK
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.edit import polygons_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, GLASS, WALL
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputWarning

# Metres. What bounds the known building stands this far outside of it: walls are met before.
_BEYOND: Final = 0.005
# Metres; how thick what bounds it from below and above is.
_LID: Final = 0.1


def load_ifc_in_space(
    path: Path, level: str | int | None, *, height: float, doors: str, glass: str, furniture: bool
) -> Environment:
    """Read a storey as a building in space: the plan of `read_storey`, and prisms for rays.

    Bodies stand between the heights that the file gives them: lintels above open doors, parapets
    below windows, beams, table tops, and the slabs below and above. Parts that slope are cut into
    slices (`slabs_of`). What lies beyond the region that the plan knows, and beyond the slabs of
    the storey and of the next one, is a frontier.

    Args:
        path: The file; the options are those of `read_storey`.
        level: The storey.
        height: At which the plan is cut: where a robot can be, metres.
        doors: "open" or "closed".
        glass: "solid" or "clear".
        furniture: Whether furniture and appliances are there.

    Raises:
        InputError: as `read_storey`.
    """
    plan = read_storey(path, level, height=height, doors=doors, glass=glass, furniture=furniture)
    with reading(path, "IFC"):
        bodies = _bodies(plan, height, doors == "closed", glass == "clear", furniture)
    notes = _notes(path, plan, bodies)
    if bodies.open_slopes:
        note = (
            f"{path}: {bodies.open_slopes} elements have sloping faces that enclose no body; rays "
            "pass between their slices."
        )
        warnings.warn(note, InputWarning, stacklevel=4)
        notes.append(note)
    made = plan.environment.in_space(_prisms(plan, bodies), plan.storey.elevation)
    made.notes = (*made.notes, *notes)
    return made


@dataclass
class _Bodies:
    """Bodies and walls that stand in a storey.

    Attributes:
        low: z from which on it is known, metres.
        high: z up to which it is known, metres.
        solids: Solids of bodies.
        lines: Walls without thickness, ax, ay, bx, by each, metres,
        heights: their lowest and highest z, metres,
        kinds: and what they are.
        sliced: Elements that were cut into slices.
        open_slopes: Those of them with faces that enclose no body.
    """

    low: float
    high: float
    solids: list[Solid] = field(default_factory=list)
    lines: list[Floats] = field(default_factory=list)
    heights: list[tuple[float, float]] = field(default_factory=list)
    kinds: list[int] = field(default_factory=list)
    sliced: int = 0
    open_slopes: int = 0

    def add_lines(
        self, lines: BaseGeometry | Sequence[BaseGeometry], low: float, high: float, kind: int
    ) -> None:
        """Add walls along lines."""
        for line in shapely.get_parts(lines):
            xy = shapely.get_coordinates(line)
            edges = np.hstack([xy[:-1], xy[1:]])
            self.lines += list(edges)
            self.heights += [(low, high)] * len(edges)
            self.kinds += [kind] * len(edges)


def _bodies(
    plan: StoreyPlan, height: float, doors_closed: bool, clear_glass: bool, furniture: bool
) -> _Bodies:
    floor = plan.storey.elevation
    # A storey reaches from within its own slab to within that of the next one.
    bodies = _Bodies(low=floor - BELOW, high=plan.next_floor + BELOW)
    left_out = {"space", "opening"} if doors_closed else {"space", "opening", "door", "leaf"}
    elements = [
        element
        for element in elements_of(plan.model, plan.storey, bodies.high - floor, furniture)
        if part_role(element) not in left_out
    ]
    ids = {element.id() for element in elements}
    made = [mesh for mesh in plan.meshes if mesh.element.id() in ids]
    others = ids.difference(mesh.element.id() for mesh in made)
    more = meshes(plan.model, [element for element in elements if element.id() in others])
    for element, vertices, faces, glass in chain(made, more):
        if not len(faces):
            continue
        exact = closed = True
        for body, is_pane in bodies_of(part_role(element), vertices, faces, glass):
            if is_pane and clear_glass:
                continue
            kind = GLASS if is_pane else WALL
            for slab in slabs_of(vertices, body, bodies.low, bodies.high, floor + height):
                exact &= slab.exact
                closed &= slab.exact or slab.lines.is_empty
                bodies.solids += [
                    Solid(area, slab.low, slab.high, kind) for area in _outlines(slab.area)
                ]
                bodies.add_lines(slab.lines, slab.low, slab.high, kind)
        bodies.sliced += not exact
        bodies.open_slopes += not closed
    if math.isinf(bodies.high):
        tops = [solid.top for solid in bodies.solids] + [top for _, top in bodies.heights]
        bodies.high = max(tops, default=floor + height)
    return bodies


def _notes(path: Path, plan: StoreyPlan, bodies: _Bodies) -> list[str]:
    floor = plan.storey.elevation
    notes = [
        f"{path}: in space: {len(bodies.solids)} solids and {len(bodies.heights)} walls without "
        f"thickness from {bodies.low - floor:.3g} to {bodies.high - floor:.3g} m above the floor."
    ]
    if bodies.sliced:
        notes.append(
            f"{path}: {bodies.sliced} elements have sloping sides and are cut into slices of "
            f"{SLICE:g} m."
        )
    if not carries(plan.slab, plan.section.within):
        notes.append(
            f"{path}: slabs carry less than half of the floor; a plane at {floor:.4g} m replaces "
            "it."
        )
    return notes


def _outlines(area: BaseGeometry) -> Iterator[shapely.Polygon]:
    for part in shapely.get_parts(area):
        if isinstance(part, shapely.Polygon) and part.area > SPECK:
            yield part


def _prisms(plan: StoreyPlan, bodies: _Bodies) -> Prisms:
    """Make prisms of the bodies, within the known bounds of the building."""
    section = shapely.buffer(plan.section.region, _BEYOND, join_style="mitre")
    outlines = list(_outlines(polygons_of(section)))
    segments = plan.environment.segments
    frontiers = shapely.linestrings(segments.xy[~segments.walls].reshape(-1, 2, 2))
    rings = [ring for outline in outlines for ring in (outline.exterior, *outline.interiors)]
    low, high = bodies.low, bodies.high
    bodies.add_lines([*frontiers, *rings], low, high, FRONTIER)
    lids = [
        Solid(outline, bottom, bottom + _LID, FRONTIER)
        for outline in outlines
        for bottom in (low - _LID, high)
    ]
    return Prisms(
        bodies.lines,
        bodies.heights,
        bodies.kinds,
        solids=[*bodies.solids, *lids],
        floor=None if carries(plan.slab, plan.section.within) else plan.storey.elevation,
        free=plan.section.region,
    )
