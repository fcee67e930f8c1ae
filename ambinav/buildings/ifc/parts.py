"""Parts of an IFC building that a plane at a scanner's height meets, by role."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import ifcopenshell.geom
import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.ifc.storeys import Storey, storey_of
from ambinav.buildings.mesh_section import section
from ambinav.buildings.section_floor import filled
from ambinav.runtime.array_types import Bools, Floats, Ints

# Role by class: the first match counts; other classes are solid.
ROLES: Final = {
    "IfcSpace": "space",
    "IfcOpeningElement": "opening",
    "IfcDoor": "door",
    "IfcWindow": "window",
    "IfcPlate": "window",
    "IfcFurnishingElement": "furniture",
    "IfcDistributionElement": "furniture",
    "IfcStair": "stair",
    "IfcStairFlight": "stair",
    "IfcSlab": "slab",
    "IfcWall": "wall",
    "IfcCurtainWall": "wall",
    "IfcColumn": "wall",
    "IfcBuildingElementProxy": "proxy",
    "IfcCovering": "proxy",
}
LEFT_OUT: Final = (
    "IfcAnnotation", "IfcGrid", "IfcVirtualElement", "IfcSite", "IfcGeographicElement", "IfcPort",
    "IfcSpatialZone", "IfcReinforcingElement",
)  # fmt: skip
# Classes that stand on one storey and end below the next one.
_OF_ONE_STOREY: Final = ("space", "opening", "door", "window", "furniture")
# Bodies whose hollows are no floor.
_WHOLE: Final = ("door", "leaf", "window", "furniture", "stair")

_GLASS: Final = re.compile(r"glas|glaz|cristal|crystal|vitr|verre|vetro|vidrio", re.IGNORECASE)
CLEAR: Final = 0.3
"""Materials that let through more than this share of light are glass."""
# Metres. A slab's surface within this below and above a storey's elevation is its floor.
BELOW: Final = 0.4
_ABOVE: Final = 0.1
# Metres. Below a stair that is higher than this, robots pass.
HEADROOM: Final = 2.0


class ElementMesh(NamedTuple):
    """Triangles of an element in the world's frame, curves to a millimetre.

    Attributes:
        element: Element of the file.
        vertices: Corners, shape (V, 3), metres.
        faces: Shape (F, 3).
        glass: Which faces are of glass, shape (F,).
    """

    element: Any
    vertices: Floats
    faces: Ints
    glass: Bools


@dataclass
class Parts:
    """Parts of elements that the cutting plane meets; metres, world frame.

    Attributes:
        areas: Polygons by role.
        lines: Lines of faces that enclose no body, by role.
        panes: Polygons and lines of glass, by role.
        floor: The upper sides of slabs, coverings and proxies at the storey's elevation, seen from
            above.
        barred: Stairs above the floor, seen from above.
        shapeless: Elements whose body cannot be made.
        meshes: Meshes of the elements that were cut.
        rooms: The names of spaces, and their sections.
    """

    areas: dict[str, list[BaseGeometry]] = field(default_factory=dict)
    lines: dict[str, list[BaseGeometry]] = field(default_factory=dict)
    panes: dict[str, list[BaseGeometry]] = field(default_factory=dict)
    floor: list[BaseGeometry] = field(default_factory=list)
    barred: list[BaseGeometry] = field(default_factory=list)
    shapeless: int = 0
    meshes: list[ElementMesh] = field(default_factory=list)
    rooms: list[tuple[str, BaseGeometry]] = field(default_factory=list)

    def of(self, *roles: str) -> list[BaseGeometry]:
        """Return the polygons of these roles."""
        return [area for role in roles for area in self.areas.get(role, ())]


def role_of(element: Any) -> str | None:
    """Return the role of an element in a section; None: no role."""
    if any(element.is_a(name) for name in LEFT_OUT):
        return None
    return next((role for name, role in ROLES.items() if element.is_a(name)), "solid")


def part_role(element: Any) -> str:
    """Return the role of an element with a body: "leaf", not "door", for a door in an opening."""
    role = role_of(element) or "solid"
    return "leaf" if role == "door" and element.FillsVoids else role


def elements_of(model: Any, storey: Storey, height: float, furniture: bool) -> list[Any]:
    """Return the elements that stand in a storey: its own, and those reaching in from others.

    Args:
        model: The file.
        storey: The storey; without an entity all of the building.
        height: Height of the plane above its floor, metres.
        furniture: Whether furniture is wanted.
    """
    elements, foreign = [], []
    for element in model.by_type("IfcProduct"):
        role = role_of(element) if element.Representation else None
        if role is None or (role == "furniture" and not furniture):
            continue
        home = None if storey.entity is None else storey_of(element)
        if home is None or home == storey.entity:
            elements.append(element)
        elif role not in _OF_ONE_STOREY:
            foreign.append(element)
    # Bodies without their openings are made in a hundredth of the time.
    low, high = storey.elevation - BELOW, storey.elevation + height
    for element, vertices, _, _ in meshes(model, foreign, voids=False):
        z = vertices[:, 2]
        if z.size and z.min() <= high and z.max() >= low:
            elements.append(element)
    return elements


def meshes(model: Any, elements: Sequence[Any], *, voids: bool = True) -> Iterator[ElementMesh]:
    """Yield the triangles of the elements that have a body.

    Args:
        model: The file.
        elements: Elements of it.
        voids: Whether openings are cut out of walls and slabs.
    """
    maker: Any = ifcopenshell.geom  # whose types are partly unknown
    settings = maker.settings()
    settings.set("use-world-coords", True)
    settings.set("disable-opening-subtractions", not voids)
    iterator = maker.iterator(settings, model, 1, include=list(elements))
    if not elements or not iterator.initialize():
        return
    while True:
        shape = iterator.get()
        mesh = shape.geometry
        vertices = np.array(mesh.verts, dtype=np.float64).reshape(-1, 3)
        faces = np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
        clear = np.array([_is_glass(material) for material in mesh.materials], dtype=np.bool_)
        material = np.array(mesh.material_ids, dtype=np.int64)
        glass = np.append(clear, False)[material] if len(material) else np.zeros(len(faces), bool)
        glass = np.asarray(glass, dtype=np.bool_)
        yield ElementMesh(model.by_id(shape.id), vertices, faces, glass)
        if not iterator.next():
            return


def parts_at(model: Any, elements: Sequence[Any], floor: float, height: float) -> Parts:
    """Cut elements with a plane.

    Args:
        model: The file.
        elements: See `elements_of`.
        floor: Height of the storey's floor, metres.
        height: Height of the plane above it, metres.
    """
    parts = Parts(shapeless=len(elements))
    for mesh in meshes(model, elements):
        element, vertices, faces, glass = mesh
        if not len(faces):
            continue
        role = part_role(element)
        parts.shapeless -= 1
        parts.meshes.append(mesh)
        if role in ("slab", "proxy"):
            parts.floor += _surface(vertices, faces, floor - BELOW, floor + _ABOVE, upper=True)
        if role == "stair":
            parts.barred += _surface(vertices, faces, floor + _ABOVE, floor + HEADROOM)
        for body, is_pane in bodies_of(role, vertices, faces, glass):
            area, lines = section(vertices, body, floor + height)
            if is_pane:
                panes = [*_polygons(area), *_nonempty(lines)]
                parts.panes.setdefault(role, []).extend(panes)
                continue
            area = filled(area) if role in _WHOLE and not area.is_empty else area
            parts.areas.setdefault(role, []).extend(_polygons(area))
            if role == "space" and not area.is_empty:
                words = (getattr(element, "LongName", None), element.Name)
                parts.rooms.append((next((w for w in words if w), "a space"), area))
            parts.lines.setdefault(role, []).extend(_nonempty(lines))
    return parts


def bodies_of(
    role: str, vertices: Floats, faces: Ints, glass: Bools
) -> Iterator[tuple[Ints, bool]]:
    """Yield the faces of each body of an element, (F, 3), and whether it is a pane of glass."""
    if role == "window" and not glass.any():
        glass = np.ones(len(faces), dtype=np.bool_)
    for body in _bodies(vertices, faces):
        yield faces[body], role != "space" and bool(glass[body].mean() > 0.5)


def _is_glass(material: Any) -> bool:
    name = str(getattr(material, "name", "") or "")
    clear = float(material.transparency or 0.0) if material.has_transparency else 0.0
    return clear > CLEAR or bool(_GLASS.search(name))


def _bodies(vertices: Floats, faces: Ints) -> list[Ints]:
    """Return the faces of each body of a mesh that shares no corner with another."""
    _, same = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    corners = same.reshape(-1)[faces]
    ends = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    size = int(corners.max()) + 1
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(size, size))
    _, body = connected_components(graph, directed=False)
    of_face = body[corners[:, 0]]
    return [np.flatnonzero(of_face == label) for label in np.unique(of_face)]


def _surface(
    vertices: Floats, faces: Ints, low: float, high: float, *, upper: bool = False
) -> list[BaseGeometry]:
    """Return triangles between two heights, seen from above; `upper`: only upward ones."""
    corners = vertices[faces]
    z = corners[..., 2]
    if upper:
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(a, b)
        steep = normal[:, 2] <= 0.7 * np.linalg.norm(normal, axis=1)
        taken = ~steep & (z.min(axis=1) >= low) & (z.max(axis=1) <= high)
    else:
        taken = (z.max(axis=1) > low) & (z.min(axis=1) < high)
    triangles = shapely.polygons(corners[taken][..., :2])
    return [shapely.union_all(triangles[shapely.area(triangles) > 0.0])]


def _polygons(area: BaseGeometry) -> list[BaseGeometry]:
    return [part for part in shapely.get_parts(area) if part.geom_type == "Polygon"]


def _nonempty(lines: BaseGeometry) -> list[BaseGeometry]:
    return [line for line in shapely.get_parts(lines) if line.length > 0.0]
