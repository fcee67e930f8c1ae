"""Square metres that each outlet of a map tells, read back from what it writes or answers."""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

import ambinav as an
from ambinav.cli.map import _figures as map_figures
from ambinav.export.formats.exporting import export_map
from ambinav.export.options import ExportOptions
from ambinav.geometry.collision.reach import Reach, reach_of
from ambinav.maps.judged_floor import REASONS
from ambinav.maps.zones import NOT_FREE, ZONES
from ambinav.plotting.maps import plot_zones
from ambinav.reports.page.map_data import map_data
from ambinav.reports.page.rasters import OUTSIDE, UNEXPLORED, UNREACHABLE
from ambinav.server.http.describe import map_detail
from ambinav.server.http.shapes import _zones
from ambinav.server.http.view import worst_places
from ambinav.server.served import ServedMap
from ambinav.server.tiles.pyramid import NOT_COUNTED, floor_values
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.document import Document, document
from ambinav.studies.audit.figures import QUANTITIES
from ambinav.studies.diff.difference import difference
from ambinav.studies.diff.document import document as diff_document

Areas = dict[str, float]
"""Square metres by zone, by reason, "judged" and "not counted"; what an outlet does not tell is
not in it."""


@dataclasses.dataclass(frozen=True)
class Made:
    """A map with what it was made of.

    Attributes:
        amap: The map.
        environment: Its building.
        scanner: Its scanner.
        folder: Where outlets may write.
    """

    amap: an.AmbiguityMap
    environment: an.Environment
    scanner: an.RangeScanner
    folder: Path

    @property
    def reach(self) -> Reach:
        """What the robot of the map reaches."""
        return reach_of(self.environment, self.amap.judged.radius, self.amap.judged.start)


def of_layer(amap: an.AmbiguityMap) -> Areas:
    """The truth: cells of the layer `judged`, and of the zones where it is 0."""
    code, zone = amap.dataset["judged"].values, np.asarray(amap.floor("zone").values)
    counts = {name: np.count_nonzero((zone == k) & (code == 0)) for k, name in enumerate(ZONES)}
    counts |= {name: np.count_nonzero(code == k) for k, name in enumerate(REASONS)}
    counts["not counted"] = np.count_nonzero((code != 0) & (code != NOT_FREE))
    return {name: float(count * amap.cell_area) for name, count in counts.items()}


def of_audit(made: Made) -> Areas:
    return _of_report(document(audit(made.amap, made.environment, made.scanner, reach=made.reach)))


def of_gates(made: Made) -> Areas:
    """What conditions such as `--fail-if "open > 2 %"` are held against."""
    report = document(audit(made.amap, made.environment, made.scanner, reach=made.reach))
    told = {name: quantity.read(report) for name, quantity in QUANTITIES.items()}
    whole = report.floor.counted_area_m2
    areas = {name: told[name] * whole / 100.0 for name in ZONES}
    outside, unexplored = told["outside area"], told["unexplored area"]
    return areas | {"outside of the building": outside, "unexplored": unexplored}


def _of_report(report: Document) -> Areas:
    floor = report.floor
    return {zone.zone: zone.area_m2 for zone in report.zones} | {
        "judged": floor.counted_area_m2, "unexplored": floor.unexplored_area_m2,
        "too close to walls": floor.beside_walls_area_m2, "not reachable": floor.cut_off_area_m2,
        "outside of the building": floor.outside_area_m2,
        "not counted": floor.free_area_m2 - floor.counted_area_m2,
    }  # fmt: skip


def of_map_json(made: Made) -> Areas:
    told = map_figures(made.amap)
    names = {
        "judged": "judged", "unexplored": "unexplored", "too close to walls": "too_close",
        "not reachable": "not_reachable", "outside of the building": "outside",
    }  # fmt: skip
    return {name: told[f"{key}_area_m2"] for name, key in names.items()}


def of_repr(made: Made) -> Areas:
    found = re.search(r"of (\d+) m\^2 judged", repr(made.amap))
    assert found is not None
    return {"judged": float(found[1])}


def of_page(made: Made) -> Areas:
    """What a report embeds: classes of the cells in the third byte of a pixel."""
    data = map_data(made.amap, made.scanner)
    image = Image.open(io.BytesIO(base64.b64decode(data["rasters"]["level"]["png"].split(",")[1])))
    codes = np.asarray(image)[..., 2]
    assert data["map"]["block"] == 1
    area = data["map"]["spacing"] ** 2
    areas = {name: np.count_nonzero(codes == k) * area for k, name in enumerate(ZONES)}
    areas["judged"] = sum(areas.values())
    areas["unexplored"] = np.count_nonzero(codes == UNEXPLORED) * area
    areas["outside of the building"] = np.count_nonzero(codes == OUTSIDE) * area
    left = np.count_nonzero(codes == UNREACHABLE) * area
    areas["not counted"] = left + areas["unexplored"] + areas["outside of the building"]
    return areas


def of_service(made: Made) -> Areas:
    detail = map_detail(ServedMap("a", made.amap, "a"))
    told = detail.figures
    return {zone.zone: zone.area_m2 for zone in detail.zones} | {
        "judged": told.judged_area_m2, "unexplored": told.unexplored_area_m2,
        "too close to walls": told.too_close_area_m2, "not reachable": told.not_reachable_area_m2,
        "outside of the building": told.outside_area_m2,
        "not counted": told.free_area_m2 - told.judged_area_m2,
    }  # fmt: skip


def of_tiles(made: Made) -> Areas:
    values = floor_values(made.amap, "zone" if not made.amap.has_theta else "zone_mean", None)
    area = made.amap.cell_area
    areas = {name: np.count_nonzero(values == k) * area for k, name in enumerate(ZONES)}
    return areas | {"not counted": np.count_nonzero(values == NOT_COUNTED) * area}


def of_mask(kind: str) -> Callable[[Made], Areas]:
    """Of a mask for Nav2 that marks zones."""

    def areas(made: Made) -> Areas:
        told = {}
        for name in ZONES:
            files = written(made, kind, f"{kind}-{name}.yaml", zones=(name,))
            pixels = np.asarray(Image.open(files[1]))
            told[name] = np.count_nonzero(pixels == 100) * made.amap.cell_area
        return told

    return areas


def of_geojson(made: Made) -> Areas:
    file = written(made, "zones-geojson", "z.geojson", zones=ZONES, least_area=0.0)[0]
    areas = dict.fromkeys(ZONES, 0.0)
    for one in json.loads(file.read_text())["features"]:
        areas[one["properties"]["zone"]] += shape_of(one).area
    return areas


def of_lanelet2(made: Made) -> Areas:
    """Of the closed ways; a piece with holes is cut into several."""
    file = written(made, "zones-lanelet2", "z.osm", zones=ZONES, least_area=0.0)[0]
    root = ElementTree.parse(file).getroot()
    nodes = {
        node.get("id"): [
            float(tag.get("v") or "nan")
            for name in ("local_x", "local_y")
            for tag in node.iter("tag")
            if tag.get("k") == name
        ]
        for node in root.iter("node")
    }
    areas = dict.fromkeys(ZONES, 0.0)
    for way in root.iter("way"):
        tags = {tag.get("k"): tag.get("v") for tag in way.iter("tag")}
        ring = [nodes[end.get("ref")] for end in way.iter("nd")]
        areas[str(tags["subtype"])] += shapely.Polygon(ring).area
    return areas


def of_served_zones(made: Made) -> Areas:
    """Of the polygons that the service answers with."""
    told = json.loads(_zones(None, ServedMap("a", made.amap, "a")))  # type: ignore[arg-type]
    areas = dict.fromkeys(ZONES, 0.0)
    for one in told["features"]:
        areas[one["properties"]["zone"]] += shape_of(one).area
    return areas


def of_mcap(made: Made) -> Areas:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with written(made, "mcap", "m.mcap")[0].open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        grids = {
            channel.topic: np.array(message.data)
            for _, channel, _, message in reader.iter_decoded_messages(["/zones", "/ambiguity"])
        }
    area = made.amap.cell_area
    areas = {n: np.count_nonzero(grids["/zones"] == 33 * k) * area for k, n in enumerate(ZONES)}
    return areas | {"judged": np.count_nonzero(grids["/ambiguity"] >= 0) * area}


def of_geotiff(made: Made) -> Areas:
    import tifffile

    bands = tifffile.imread(written(made, "geotiff", "m.tif")[0])
    return _of_codes(bands[5], bands[4], made.amap.cell_area)


def of_npz(made: Made) -> Areas:
    with np.load(written(made, "npz", "m.npz")[0]) as arrays:
        zone = arrays["zone_mean" if made.amap.has_theta else "zone"]
        return _of_codes(arrays["judged"], zone, made.amap.cell_area)


def _of_codes(judged: NDArray[Any], zone: NDArray[Any], area: float) -> Areas:
    areas = {n: np.count_nonzero((zone == k) & (judged == 0)) * area for k, n in enumerate(ZONES)}
    return areas | {n: np.count_nonzero(judged == k) * area for k, n in enumerate(REASONS)}


def of_diff(made: Made) -> Areas:
    """Of the map against itself: what it was and what it became are one."""
    report = diff_document(difference(made.amap, made.amap), 5)
    assert report.first.counted_area_m2 == report.second.counted_area_m2
    assert [zone.before_m2 for zone in report.zones] == [zone.after_m2 for zone in report.zones]
    areas = {zone.zone: zone.after_m2 for zone in report.zones}
    return areas | {"judged": report.second.counted_area_m2}


def of_picture(made: Made) -> Areas:
    """Of the legend: whole square metres, to a digit below 10."""
    axes = plot_zones(made.amap)
    legend = axes.get_legend()
    assert legend is not None
    areas = {}
    for text in legend.get_texts():
        found = re.fullmatch(r"(\w+)\n(?:.*, )?([\d.,]+) m²", text.get_text())
        if found:
            areas[found[1]] = float(found[2].replace(",", ""))
    assert set(ZONES) <= set(areas)
    return areas


OUTLETS: dict[str, Callable[[Made], Areas]] = {
    "audit": of_audit,
    "gates": of_gates,
    "map --json": of_map_json,
    "repr": of_repr,
    "page": of_page,
    "service": of_service,
    "zones of the service": of_served_zones,
    "tiles": of_tiles,
    "nav2-keepout": of_mask("nav2-keepout"),
    "nav2-binary": of_mask("nav2-binary"),
    "zones-geojson": of_geojson,
    "zones-lanelet2": of_lanelet2,
    "mcap": of_mcap,
    "geotiff": of_geotiff,
    "npz": of_npz,
    "diff": of_diff,
    "picture": of_picture,
}
ROUNDED = {"repr": 0.5, "picture": 0.5, "audit": 0.01, "gates": 0.01, "diff": 0.01,
           "map --json": 0.01, }  # fmt: skip
"""Square metres by which outlets may be off since they round; shares to a hundredth of a percent
of the floor beside these."""


def written(made: Made, kind: str, name: str, **options: object) -> tuple[Path, ...]:
    """Export a map."""
    chosen = ExportOptions(**options)  # type: ignore[arg-type]
    return export_map(made.amap, kind, made.folder / name, chosen, overwrite=True)


def shape_of(feature: dict[str, Any]) -> Any:
    """The polygon of a GeoJSON Feature."""
    return shapely.from_geojson(json.dumps(feature["geometry"]))


def codes_at(amap: an.AmbiguityMap, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.uint8]:
    """Codes of the layer `judged` in the cells that hold places."""
    left, low, *_ = amap.bounds
    row, column = (
        np.floor((values - edge) / amap.spacing).astype(int)
        for values, edge in ((np.asarray(y), low), (np.asarray(x), left))
    )
    return np.asarray(amap.dataset["judged"].values[row, column])


def places_of(made: Made) -> Iterator[tuple[str, float, float]]:
    """Worst places with who tells them."""
    found = audit(made.amap, made.environment, made.scanner, reach=made.reach, places=100)
    yield from (("audit", one.place.x, one.place.y) for one in found.findings)
    for place in worst_places(ServedMap("a", made.amap, "a")):
        yield "service", place.x, place.y
    for region in diff_document(difference(made.amap, made.amap), 5).regions:
        yield "diff", region.x_m, region.y_m
