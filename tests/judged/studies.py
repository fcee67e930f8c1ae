"""Square metres that each study tells of the floor of a map, read back from what it writes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable

import numpy as np
import pytest

import ambinav as an
from ambinav.maps.judged_floor import JUDGED
from ambinav.maps.zones import BAD, ZONES
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.beams.sample import draw_samples
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.document import document as place_document
from ambinav.studies.design.place.study import place_obstacles
from ambinav.studies.design.scanners.compare import compare_scanners
from ambinav.studies.design.scanners.document import document as scanners_document
from ambinav.studies.design.sweep.document import document as sweep_document
from ambinav.studies.design.sweep.sweep import sweep_scanner
from ambinav.studies.fleet import unit as fleet_unit
from ambinav.studies.fleet.fleet import run_fleet
from ambinav.studies.fleet.site import Site
from ambinav.studies.fleet.unit import FleetSettings, Unit
from tests.judged.outlets import Areas, Made, codes_at, of_layer

ALL = 1_000_000
"""Places of a sample that leaves none out."""


def of_map(amap: an.AmbiguityMap) -> Areas:
    """The truth: cells of the layer `judged`, and the mean level there."""
    areas = of_layer(amap)
    level = amap.floor("level", "mean").values[amap.dataset["judged"].values == JUDGED]
    return areas | {"bad": areas["corridor"] + areas["open"], "mean level": float(level.mean())}


def of_scanners(made: Made) -> Areas:
    amap = made.amap
    table = compare_scanners(
        made.environment, [made.scanner], spacing=amap.spacing, radius=amap.parameters["radius"],
        pairs=0, robot_radius=amap.judged.radius, store=False,
    )  # fmt: skip
    (row,) = scanners_document(table).scanners
    return {share.zone: share.area for share in table.rows[0].shares} | {
        "judged": row.counted_area_m2, "unexplored": row.unexplored_area_m2,
        "corridor": row.corridor_area_m2, "open": row.open_area_m2, "bad": row.bad_area_m2,
    }  # fmt: skip


def of_places(made: Made) -> Areas:
    """Of the placement of posts, for scanners that look all around."""
    if made.amap.has_theta:
        return {}
    rules = PlaceRules(most=4)
    placed = place_obstacles(made.environment, made.scanner, made.amap, rules, 1, made.reach)
    return {"bad": place_document(placed, 1).before.bad}


def of_sweep(made: Made) -> Areas:
    """Of the scanner as it is."""
    report = sweep_document(
        sweep_scanner(
            made.environment, made.scanner, ["max_range=2,4"], spacing=made.amap.spacing,
            radius=made.amap.parameters["radius"], robot_radius=made.amap.judged.radius, places=0,
        )
    )  # fmt: skip
    present = report.present
    areas = {name: present.areas[name] for name in ZONES}
    assert present.bad is not None and present.mean is not None and None not in areas.values()
    bad = present.bad * report.region.amount
    return {"judged": report.region.amount, "bad": bad, "mean level": present.mean} | areas  # type: ignore[return-value]


def of_beams(made: Made) -> Areas:
    """Of a sample of all floor, at the heading that a map without headings has."""
    amap = made.amap
    (sample,) = draw_samples(
        made.environment, made.scanner, ALL, np.random.default_rng(0), spacing=amap.spacing,
        radius=amap.parameters["radius"], reach=made.reach, samples=1, headings=np.zeros(1),
    )  # fmt: skip
    judged = len(sample.level) * amap.cell_area
    if amap.has_theta:
        return {"judged": judged}
    share = np.bincount(sample.zone, weights=sample.weight, minlength=len(ZONES))
    areas = {name: float(share[k]) * judged for k, name in enumerate(ZONES)}
    bad, level = float(share[list(BAD)].sum()) * judged, float(sample.weight @ sample.level)
    return areas | {"judged": judged, "bad": bad, "mean level": level}


def of_fleet(made: Made) -> Areas:
    """Of the tables, the catalogue and the page, of which the worst scanner comes first."""
    from pyarrow import parquet

    (made.folder / "made.geojson").write_text("{}")  # the building is given instead
    site = Site("made", str(made.folder), "made.geojson")
    amap = made.amap
    settings = FleetSettings(
        amap.spacing, amap.parameters["radius"], amap.judged.radius, advice=False
    )
    far = RangeScanner.from_preset("rplidar-a1")
    units = [Unit(site, "made", made.scanner), Unit(site, "other", far)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fleet_unit, "_load", lambda site, contents: made.environment)
        report = run_fleet(units, made.folder / "fleet", settings, workers=0).document
    rows = parquet.read_table(made.folder / "fleet/figures.parquet").to_pylist()
    row = rows[0]
    item = json.loads((made.folder / "fleet/items/made.json").read_text())["properties"]
    page = (made.folder / "fleet/index.html").read_text()
    shown = re.findall(r'data-scanner="(\w+)" data-bad="([\d.]+)" data-share="([\d.]+)"', page)
    ranked = sorted(rows, key=lambda row: -row["bad_m2"])
    assert shown == [(row["scanner"], str(row["bad_m2"]), str(row["bad_share"])) for row in ranked]
    assert item["ambinav:bad_m2"] == {row["scanner"]: row["bad_m2"] for row in rows}
    assert item["ambinav:bad_share"] == {row["scanner"]: row["bad_share"] for row in rows}
    assert report.mixes[0].bad_m2 == min(row["bad_m2"] for row in rows)
    if row["places"]:
        at = np.array([row["worst_x_m"]]), np.array([row["worst_y_m"]])
        assert codes_at(amap, *at)[0] == JUDGED
    areas = {name: row[f"{name}_share"] * row["counted_m2"] for name in ZONES}
    return areas | {
        "judged": row["counted_m2"], "bad": row["bad_m2"], "mean level": row["mean_level"],
    }  # fmt: skip


STUDIES: dict[str, Callable[[Made], Areas]] = {
    "design scanners": of_scanners,
    "design place": of_places,
    "design sweep": of_sweep,
    "design beams": of_beams,
    "fleet audit": of_fleet,
}
