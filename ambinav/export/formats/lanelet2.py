"""Zones as polygons of a Lanelet2 map, of the type Autoware's environment adaptor reads.

autoware_universe pull request 12935 takes polygons of the type `degenerate_area` and finds by their
subtype which covariance holds in them. The subtypes here are the zones' names.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.export.formats.zones import (
    NO_ZONES,
    area_left_out,
    figures,
    least_area,
    note_no_pieces,
    zone_pieces,
)
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.runtime.errors import InputWarning

TYPE: Final = "degenerate_area"
# Radii of curvature of WGS 84 where latitude and longitude are 0, metres: along the meridian and
# along the equator.
MERIDIAN, EQUATOR = 6_335_439.327, 6_378_137.0
GRID: Final = 1e-4
"""Metres to which coordinates are written."""


def without_holes(polygon: shapely.Polygon) -> list[shapely.Polygon]:
    """Divide a polygon into polygons without holes, cut vertically through each hole's middle.

    Their corners lie on `GRID`, so that the rings are simple as they are written.
    """
    finished, todo = [], _polygons(shapely.set_precision(polygon, GRID))
    while todo:
        part = todo.pop()
        # No cut on the grid divides a hole this narrow.
        holes = [hole for hole in part.interiors if hole.bounds[2] - hole.bounds[0] > 2.0 * GRID]
        if not holes:
            finished.append(shapely.Polygon(part.exterior))
            continue
        xmin, ymin, xmax, ymax = part.bounds
        low, _, high, _ = holes[0].bounds
        cut = 0.5 * (low + high)
        for half in (shapely.box(xmin, ymin, cut, ymax), shapely.box(cut, ymin, xmax, ymax)):
            todo += _polygons(shapely.intersection(part, half, grid_size=GRID))
    return finished


def ways(polygon: shapely.Polygon, cell: float) -> tuple[list[shapely.Polygon], float]:
    """Return polygons without holes for a piece of floor, and the area that is left out, m².

    Left out are slivers of less than a cell, which the cuts make.

    Args:
        polygon: The piece: whole cells.
        cell: Edge of a cell, metres.
    """
    # The steps of the cells become straight lines; no edge moves by a whole cell. Of pieces of a
    # few cells, or a cell wide, this could leave half: they stay as they are.
    smooth = shapely.simplify(polygon, 0.75 * cell)
    kept_area = abs(smooth.area - polygon.area) <= 0.1 * polygon.area
    parts = without_holes(smooth if kept_area else polygon)
    least = (cell - 2.0 * GRID) ** 2  # a cell whose corners are rounded
    large = [part for part in parts if part.area >= least]
    return large, sum(part.area for part in parts if part.area < least)


def _polygons(geometry: BaseGeometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(geometry) if isinstance(part, shapely.Polygon)]


def osm(shapes: list[tuple[shapely.Polygon, dict[str, str]]], left_out: float) -> bytes:
    """Return OSM XML of closed ways with tags; nodes have local_x and local_y in metres.

    The root has the area that no way stands for as `left_out_m2`; readers pass over it.

    Latitude and longitude, which the format asks for, are those of a map frame whose origin lies at
    0 N, 0 E; Autoware's local projector reads local_x and local_y.
    """
    root = ElementTree.Element("osm", version="0.6", generator="ambinav")
    root.set("left_out_m2", f"{left_out:g}")
    ElementTree.SubElement(root, "MetaInfo", format_version="1", map_version="1")
    rings = []
    number = 0
    for polygon, tags in shapes:
        ring = shapely.orient_polygons(polygon).exterior.coords[:-1]
        refs = []
        for x, y in ring:
            number += 1
            refs.append(number)
            lat, lon = math.degrees(y / MERIDIAN), math.degrees(x / EQUATOR)
            node = ElementTree.SubElement(
                root, "node", id=str(number), version="1", visible="true",
                lat=f"{lat:.11f}", lon=f"{lon:.11f}",
            )  # fmt: skip
            for key, value in (("local_x", x), ("local_y", y), ("ele", 0.0)):
                ElementTree.SubElement(node, "tag", k=key, v=f"{value:.4f}")
        rings.append((refs, tags))
    for refs, tags in rings:
        number += 1
        way = ElementTree.SubElement(root, "way", id=str(number), version="1", visible="true")
        for ref in refs:
            ElementTree.SubElement(way, "nd", ref=str(ref))
        # Lanelet2 takes a way for a polygon, closed by itself, by this tag.
        for key, value in {"area": "yes", **tags}.items():
            ElementTree.SubElement(way, "tag", k=key, v=value)
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True))


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the zones, one polygon per piece, or several where it has holes; each with its area."""
    cell = Raster.of_map(export.amap).resolution
    written = zone_pieces(export)
    left_out = area_left_out(export, written)
    shapes = []
    for name, piece in written:
        parts, slivers = ways(piece.polygon, cell)
        left_out += slivers
        for part in parts:
            values = {**figures(piece), "area_m2": round(part.area, 3)}
            tags = {key: f"{value:.9g}" for key, value in values.items()}
            shapes.append((part, {"type": TYPE, "subtype": name, **tags}))
    if not shapes:
        note_no_pieces(export, path, left_out, NO_ZONES)
    elif left_out >= export.amap.cell_area and export.options.least_area is None:
        warnings.warn(
            f"{path.name}: {left_out:.3g} m² of the zones are in pieces below "
            f"{least_area(export):g} m² and left out; give --least-area to choose.",
            InputWarning,
            stacklevel=2,
        )
    path.write_bytes(osm(shapes, round(left_out, 3)))
    return (path,)


LANELET2: Final = Exporter(
    subject="map",
    format="zones-lanelet2",
    title="corridor and open floor as degenerate_area polygons, OSM XML",
    reader="Autoware, environment adaptor (autoware_universe PR 12935); Lanelet2",
    write=write,
    suffixes=(".osm",),
    uses=frozenset({"zones", "least_area", "heading"}),
)
