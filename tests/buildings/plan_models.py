"""A house in IFC, made with ifcopenshell: two rooms, a door between them, one to the outside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.api.aggregate
import ifcopenshell.api.context
import ifcopenshell.api.feature
import ifcopenshell.api.geometry
import ifcopenshell.api.project
import ifcopenshell.api.root
import ifcopenshell.api.spatial
import ifcopenshell.api.style
import ifcopenshell.api.unit
import ifcopenshell.util.unit
import numpy as np
import shapely

WEST, EAST = shapely.box(0.2, 0.2, 4.2, 3.2), shapely.box(4.4, 0.2, 10.2, 3.2)
"""The two rooms, metres, in the house's own frame."""
INNER_DOOR, OUTER_DOOR = shapely.box(4.2, 1.0, 4.4, 2.0), shapely.box(1.0, 0.0, 1.9, 0.2)
PANE = shapely.box(6.0, 3.28, 8.0, 3.32)
REVEAL = shapely.box(6.0, 3.2, 8.0, 3.4)
TABLE = shapely.box(7.0, 1.0, 8.0, 1.6)
HOLE = shapely.box(9.0, 2.0, 10.2, 3.2)
INCHES = {"length": {"is_metric": False, "raw": "INCHES"}}
MILLIMETRES = {"length": {"is_metric": True, "raw": "MILLIMETERS"}}
METRES = {"length": {"is_metric": True, "raw": "METERS"}}


class House:
    """A model that bodies are put into; all lengths are metres.

    Args:
        units: What the file is in; see `ifcopenshell.api.unit.assign_unit`.
        angle: The house is turned by so many radians,
        shift: and then moved.
    """

    def __init__(
        self,
        units: dict[str, Any] = METRES,
        angle: float = 0.0,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.model: Any = ifcopenshell.api.project.create_file()
        self.project = ifcopenshell.api.root.create_entity(self.model, "IfcProject")
        ifcopenshell.api.unit.assign_unit(self.model, **units)
        whole = ifcopenshell.api.context.add_context(self.model, context_type="Model")
        self.body = ifcopenshell.api.context.add_context(
            self.model, "Model", "Body", "MODEL_VIEW", parent=whole
        )
        self.per_metre = 1.0 / ifcopenshell.util.unit.calculate_unit_scale(self.model)
        c, s = np.cos(angle), np.sin(angle)
        self.frame = np.array(
            [[c, -s, 0, shift[0]], [s, c, 0, shift[1]], [0, 0, 1, 0], [0, 0, 0, 1.0]]
        )
        self.building = ifcopenshell.api.root.create_entity(self.model, "IfcBuilding")
        ifcopenshell.api.aggregate.assign_object(
            self.model, products=[self.building], relating_object=self.project
        )

    def storey(self, name: str, elevation: float) -> Any:
        one = ifcopenshell.api.root.create_entity(self.model, "IfcBuildingStorey", name=name)
        ifcopenshell.api.aggregate.assign_object(
            self.model, products=[one], relating_object=self.building
        )
        place = np.eye(4)
        place[2, 3] = elevation
        ifcopenshell.api.geometry.edit_object_placement(self.model, one, place)
        one.Elevation = elevation * self.per_metre
        return one

    def prism(
        self,
        kind: str,
        storey: Any,
        shape: shapely.Polygon,
        low: float,
        high: float,
        clear: float | None = None,
    ) -> Any:
        """An element with vertical sides between two heights; `clear`: how transparent it is."""
        model = self.model
        one = ifcopenshell.api.root.create_entity(model, kind)
        points = self.per_metre * np.array(shape.exterior.coords)
        holes = [self._curve(self.per_metre * np.array(ring.coords)) for ring in shape.interiors]
        profile: dict[str, Any] = {"ProfileType": "AREA", "OuterCurve": self._curve(points)}
        name = "IfcArbitraryClosedProfileDef"
        if holes:
            profile["InnerCurves"], name = holes, "IfcArbitraryProfileDefWithVoids"
        solid = model.create_entity(
            "IfcExtrudedAreaSolid",
            SweptArea=model.create_entity(name, **profile),
            Position=model.create_entity(
                "IfcAxis2Placement3D", model.create_entity("IfcCartesianPoint", (0.0, 0.0, 0.0))
            ),
            ExtrudedDirection=model.create_entity("IfcDirection", (0.0, 0.0, 1.0)),
            Depth=(high - low) * self.per_metre,
        )
        shown = model.create_entity(
            "IfcShapeRepresentation", self.body, "Body", "SweptSolid", [solid]
        )
        ifcopenshell.api.geometry.assign_representation(model, one, shown)
        if clear is not None:
            style = ifcopenshell.api.style.add_style(model, name="pane")
            ifcopenshell.api.style.add_surface_style(
                model,
                style,
                "IfcSurfaceStyleShading",
                {
                    "SurfaceColour": {"Name": None, "Red": 0.5, "Green": 0.5, "Blue": 1.0},
                    "Transparency": clear,
                },
            )
            ifcopenshell.api.style.assign_representation_styles(model, shown, [style])
        place = np.eye(4)
        place[2, 3] = low
        ifcopenshell.api.geometry.edit_object_placement(model, one, self.frame @ place)
        if storey is not None and kind == "IfcSpace":
            ifcopenshell.api.aggregate.assign_object(model, products=[one], relating_object=storey)
        elif kind != "IfcOpeningElement":
            ifcopenshell.api.spatial.assign_container(
                model, products=[one], relating_structure=storey or self.building
            )
        return one

    def opening(
        self, wall: Any, storey: Any, shape: shapely.Polygon, low: float, high: float
    ) -> Any:
        hole = self.prism("IfcOpeningElement", storey, shape, low, high)
        ifcopenshell.api.feature.add_feature(self.model, feature=hole, element=wall)
        return hole

    def door(
        self, wall: Any, storey: Any, shape: shapely.Polygon, low: float, clear: float | None = None
    ) -> Any:
        """A door with a leaf of 4 cm in the middle of its opening."""
        hole = self.opening(wall, storey, shape, low, low + 2.0)
        x0, y0, x1, y1 = shape.bounds
        leaf = shapely.box(x0, (y0 + y1) / 2 - 0.02, x1, (y0 + y1) / 2 + 0.02)
        if x1 - x0 < y1 - y0:
            leaf = shapely.box((x0 + x1) / 2 - 0.02, y0, (x0 + x1) / 2 + 0.02, y1)
        one = self.prism("IfcDoor", storey, leaf, low, low + 2.0, clear)
        ifcopenshell.api.feature.add_filling(self.model, opening=hole, element=one)
        return one

    def floor(self, storey: Any, low: float, *, spaces: bool = True) -> None:
        """Two rooms with all that is in them, on a floor at a height."""
        outer = shapely.box(0.0, 0.0, 10.4, 3.4) - shapely.box(0.2, 0.2, 10.2, 3.2)
        walls = self.prism("IfcWall", storey, outer, low, low + 2.5)
        partition = shapely.box(4.2, 0.2, 4.4, 3.2)
        parted = self.prism("IfcWall", storey, partition, low, low + 2.5)
        self.door(walls, storey, OUTER_DOOR, low)
        self.door(parted, storey, INNER_DOOR, low)
        frame = self.opening(walls, storey, REVEAL, low, low + 2.2)
        pane = self.prism("IfcWindow", storey, PANE, low, low + 2.2, clear=0.8)
        ifcopenshell.api.feature.add_filling(self.model, opening=frame, element=pane)
        self.prism("IfcFurnishingElement", storey, TABLE, low, low + 0.8)
        self.prism("IfcSlab", storey, shapely.box(0.0, 0.0, 10.4, 3.4) - HOLE, low - 0.3, low)
        if spaces:
            for room in (WEST, EAST):
                self.prism("IfcSpace", storey, room, low, low + 2.5)

    def write(self, path: Path) -> Path:
        self.model.write(str(path))
        return path

    def _curve(self, points: Any) -> Any:
        corners = [
            self.model.create_entity("IfcCartesianPoint", tuple(map(float, p))) for p in points
        ]
        corners[-1] = corners[0]
        return self.model.create_entity("IfcPolyline", corners)


def two_storeys(path: Path, **options: Any) -> Path:
    house = House(**options)
    for name, low in (("Ground", 0.0), ("Upper", 3.0)):
        house.floor(house.storey(name, low), low)
    return house.write(path)
