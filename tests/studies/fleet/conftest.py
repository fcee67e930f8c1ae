"""Small sites, and a fleet of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import shapely
from shapely.geometry import mapping

from ambinav.studies.fleet.fleet import Fleet, run_fleet, units_of
from ambinav.studies.fleet.sites import read_sites
from ambinav.studies.fleet.unit import FleetSettings

pytest.importorskip("pyarrow")

SCANNERS = ("turtlebot3-lds", "rplidar-a1")
SETTINGS = FleetSettings(spacing=0.5, advice=False)


def write_room(path: Path, width: float, height: float = 3.0) -> None:
    """Write a plan of one room."""
    path.parent.mkdir(parents=True, exist_ok=True)
    room = {"type": "Feature", "properties": {"kind": "room"}}
    shape = mapping(shapely.box(0.0, 0.0, width, height))
    plan = {"type": "FeatureCollection", "features": [room | {"geometry": shape}]}
    path.write_text(json.dumps(plan))


def write_sites(folder: Path) -> Path:
    """A closed room, a corridor that is longer than the range, and a file that is no plan."""
    write_room(folder / "room.geojson", 3.0)
    write_room(folder / "north" / "corridor.geojson", 30.0, 2.0)
    (folder / "broken.wkt").write_text("POLYGON((")
    return folder


@pytest.fixture
def sites(tmp_path: Path) -> Path:
    """Sites that a test may change."""
    return write_sites(tmp_path / "sites")


def audited(sites: Path, output: Path | str) -> Fleet:
    """Audit a folder of sites in this process."""
    units = units_of(read_sites(str(sites)), SCANNERS)
    return run_fleet(units, output, SETTINGS, workers=0)
