"""Zones as polygons of a Lanelet2 map, of the type Autoware's environment adaptor reads.

autoware_universe pull request 12935 takes polygons of the type `degenerate_area` and finds by their
subtype which covariance holds in them. The subtypes here are the zones' names.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import shapely

from ambinav.export.formats.zones import NO_ZONES, figures, zone_pieces
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter

TYPE: Final = "degenerate_area"
# Radii of curvature of WGS 84 where latitude and longitude are 0, metres: along the meridian and
# along the equator.
MERIDIAN, EQUATOR = 6_335_439.327, 6_378_137.0


def without_holes(polygon: shapely.Polygon) -> list[shapely.Polygon]:
    """Divide a polygon into polygons without holes, cut vertically through each hole's middle."""
    finished, todo = [], [polygon]
    while todo:
        part_polygon = todo.pop()
        if not part_polygon.interiors:
            finished.append(part_polygon)
            continue
        xmin, ymin, xmax, ymax = part_polygon.bounds
        low, _, high, _ = part_polygon.interiors[0].bounds
        cut = 0.5 * (low + high)
        for half in (shapely.box(xmin, ymin, cut, ymax), shapely.box(cut, ymin, xmax, ymax)):
            parts = shapely.get_parts(shapely.intersection(part_polygon, half))
            todo += [part for part in parts if isinstance(part, shapely.Polygon)]
    return finished


def osm(shapes: list[tuple[shapely.Polygon, dict[str, str]]]) -> bytes:
    """Return OSM XML of closed ways with tags; nodes have local_x and local_y in metres.

    Latitude and longitude, which the format asks for, are those of a map frame whose origin lies at
    0 N, 0 E; Autoware's local projector reads local_x and local_y.
    """
    root = ElementTree.Element("osm", version="0.6", generator="ambinav")
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
    """Write the zones, one polygon per piece, or several where it has holes."""
    cell = Raster.of_map(export.amap).resolution
    shapes = []
    for name, piece in zone_pieces(export):
        tags = {"type": TYPE, "subtype": name}
        tags |= {key: f"{value:g}" for key, value in figures(piece).items()}
        # The steps of the cells become straight lines; no edge moves by a whole cell.
        outline = shapely.simplify(piece.polygon, 0.75 * cell)
        shapes += [(part, tags) for part in without_holes(outline)]
    if not shapes:
        export.note_empty(path, NO_ZONES)
    path.write_bytes(osm(shapes))
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
