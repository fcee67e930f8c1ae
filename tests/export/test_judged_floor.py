"""All outlets judge the same floor: exports mark what the zones of the explored floor are."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

import ambinav as an
from ambinav.errors import InputWarning
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.server.describe import map_detail
from ambinav.server.served import ServedMap

Write = Callable[..., tuple[Path, ...]]


def log_map() -> an.AmbiguityMap:
    """A hall whose far half was never seen: rays that end there end in unknown space."""
    hall = shapely.box(0.0, 0.0, 14.0, 4.0)
    rims = [shapely.LineString([(7.0, y), (14.0, y)]) for y in (0.0, 4.0)]
    rims.append(shapely.LineString([(14.0, 0.0), (14.0, 4.0)]))
    env = an.environment_from_shapes([hall], openings=rims, name="seen in part")
    sensor = an.RangeSensor(max_range=3.0, std=0.02, resolution=0.01)
    scanner = an.RangeScanner.planar(sensor=sensor, beams=36, aperture=math.tau)
    return an.build_map(env, scanner, spacing=0.25)


def areas(amap: an.AmbiguityMap, write: Write) -> dict[str, tuple[float, float]]:
    """Square metres of open floor, and of corridor and open floor, at each outlet."""
    folder = str(amap.dataset.attrs["environment"])
    zone = np.asarray(amap.floor("zone").values)
    counted = amap.judged.counted
    cells = [np.isin(zone, codes) & counted for codes in ((OPEN,), (CORRIDOR, OPEN))]
    found = {"map": tuple(float(mask.sum()) * amap.cell_area for mask in cells)}
    pixels = [
        np.asarray(Image.open(write(kind, f"{folder}/{kind}.yaml", of=amap)[1]))
        for kind in ("nav2-keepout", "nav2-binary")
    ]
    found["masks"] = tuple(float((mask == 100).sum()) * amap.cell_area for mask in pixels)
    file = write("zones-geojson", f"{folder}/zones.geojson", of=amap, least_area=0.0)[0]
    shapes: dict[str, float] = {"corridor": 0.0, "open": 0.0}
    for one in json.loads(file.read_text())["features"]:
        shapes[one["properties"]["zone"]] += shapely.from_geojson(json.dumps(one["geometry"])).area
    found["geojson"] = shapes["open"], sum(shapes.values())
    served = {one.zone: one.area_m2 for one in map_detail(ServedMap("a", amap, "a")).zones}
    found["http"] = served["open"], served["open"] + served["corridor"]
    return found


def hold(amap: an.AmbiguityMap, write: Write) -> None:
    found = areas(amap, write)
    for outlet, values in found.items():
        assert values == pytest.approx(found["map"], abs=0.5 * amap.cell_area), outlet


@pytest.mark.filterwarnings("ignore:.*it is empty")
def test_outlets_agree_where_the_map_ends(write: Write, amap: an.AmbiguityMap) -> None:
    unexplored = log_map()
    assert unexplored.judged.unexplored.sum() > 30
    hold(unexplored, write)
    hold(amap, write)


def test_an_empty_export_says_so(write: Write, amap: an.AmbiguityMap) -> None:
    closet = an.environment_from_shapes([shapely.box(0.0, 0.0, 2.0, 1.5)], name="closet")
    good = an.build_map(closet, an.RangeScanner.from_preset("rplidar-a1"), spacing=0.25)
    for kind, name in (
        ("nav2-keepout", "k.yaml"), ("nav2-binary", "b.yaml"), ("zones-geojson", "z.geojson"),
        ("zones-lanelet2", "z.osm"),
    ):  # fmt: skip
        with pytest.warns(InputWarning, match=rf"^{name[0]}\.\w+: it is empty, for no explored"):
            assert write(kind, name, of=good)[0].is_file()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*it is empty")
@pytest.mark.parametrize("part", range(4))
def test_outlets_agree_on_all_maps(data_dir: Path, write: Write, part: int) -> None:
    files = sorted(file for folder in data_dir.glob("*maps*") for file in folder.glob("*.yaml"))
    sensor = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    scanner = an.RangeScanner.planar(sensor=sensor, beams=36, aperture=math.tau)
    for file in files[part::4]:
        if "tiled" not in file.stem:
            env = an.load_environment(file)
            spacing = max(0.4, math.sqrt(env.free.area / 20_000))
            hold(an.build_map(env, scanner, spacing=spacing, radius=2 * spacing), write)
