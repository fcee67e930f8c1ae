"""The catalogue of a fleet: SpatioTemporal Asset Catalog (STAC) 1.1.0, an item for each site.

A floor plan has a frame of its own and no place on the globe, so that items have no geometry, which
the specification allows (item-spec.md, "geometry").
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, Final

from ambinav.studies.fleet.document import FleetFigures, figures_of
from ambinav.studies.fleet.unit import RESULTS, UnitDone

CATALOGUE: Final = "catalog.json"
ITEMS: Final = "items"
VERSION: Final = "1.1.0"
PREFIX: Final = "ambinav:"
"""Prefix of the properties that STAC does not define."""
PROPERTIES: Final = ("status", "bad_m2", "bad_share", "advice")
"""Figures that are properties, each by scanner."""


def catalogue(results: Sequence[UnitDone]) -> Iterator[tuple[str, str]]:
    """Yield the files of the catalogue, the catalogue itself last: path in the output, and text.

    Args:
        results: By site.
    """
    links = [_link("root", CATALOGUE)]
    for site, group in groupby(results, key=lambda done: done.result.site):
        path = f"{ITEMS}/{site}.json"
        yield path, _text(_item(site, [*group]))
        links.append(_link("item", path) | {"type": "application/geo+json", "title": site})
    yield (
        CATALOGUE,
        _text(
            {
                "type": "Catalog",
                "stac_version": VERSION,
                "id": "ambinav-fleet",
                "title": "Audited buildings",
                "description": "Where each building leaves a scanner lost, found by ambinav.",
                "links": links,
            }
        ),
    )


def _item(site: str, results: Sequence[UnitDone]) -> dict[str, Any]:
    up = "../" * (site.count("/") + 1)
    rows = [figures_of(done.result) for done in results]
    assets: dict[str, Any] = {}
    for row in rows:
        place = f"{up}{RESULTS}/{site}/{row.scanner}"
        assets[row.scanner] = _asset(f"{place}.json", "application/json", row, "data")
        if row.status == "done":
            name = f"{row.scanner}-thumbnail"
            assets[name] = _asset(f"{place}.png", "image/png", row, "thumbnail")
    return {
        "type": "Feature",
        "stac_version": VERSION,
        "id": site,
        "geometry": None,
        "properties": {
            "datetime": results[0].moment or results[0].result.run.created.replace("+00:00", "Z"),
            "title": site,
            f"{PREFIX}building": rows[0].building,
            **{
                f"{PREFIX}{name}": {row.scanner: getattr(row, name) for row in rows}
                for name in PROPERTIES
            },
        },
        "links": [_link(kind, f"{up}{CATALOGUE}") for kind in ("root", "parent")],
        "assets": assets,
    }


def _asset(href: str, media: str, row: FleetFigures, role: str) -> dict[str, Any]:
    title = f"{'Zones' if role == 'thumbnail' else 'Audit'} for {row.scanner}"
    return {"href": href, "type": media, "title": title, "roles": [role]}


def _link(kind: str, path: str) -> dict[str, str]:
    href = path if path.startswith(".") else f"./{path}"
    return {"rel": kind, "href": href, "type": "application/json"}


def _text(plain: object) -> str:
    return json.dumps(plain, indent=1, ensure_ascii=False) + "\n"
