"""Sites are read from tables and folders, and what is wrong in them is said."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import fsspec
import pytest

from ambinav.buildings.load import load_environment
from ambinav.demo import DEMO_BUILDING
from ambinav.runtime.errors import InputError
from ambinav.studies.fleet.fleet import units_of
from ambinav.studies.fleet.sites import read_sites
from ambinav.studies.fleet.unit import _load
from tests.studies.fleet.conftest import write_room

MAP = "image: {image}\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n" + (
    "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
)
PIXELS = b"P5 40 30 255\n" + bytes(40) + b"\0".join([b""] + [b"\xff" * 38 + b"\0"] * 28) + bytes(40)


def table(folder: Path, text: str) -> str:
    path = folder / "sites.csv"
    path.write_text(text, encoding="utf-8-sig")
    return str(path)


def test_a_table_gives_files_beside_it_and_options(tmp_path: Path) -> None:
    write_room(tmp_path / "plans" / "a.geojson", 3.0)
    text = "site, building,date,scanner,unit\nb,plans/a.geojson,2026-05-31,,\n"
    text += f"north/a,{DEMO_BUILDING},2026-05-31T12:00:00+02:00,rplidar-a1,m\n,,,,\n"
    first, second = read_sites(table(tmp_path, text))
    assert (first.name, first.moment, first.reading) == ("b", "2026-05-31T00:00:00Z", {})
    assert (second.name, second.moment) == ("north/a", "2026-05-31T10:00:00Z")
    assert second.reading == {"unit": "m"}
    assert list(first.contents()) == ["a.geojson"]
    units = units_of((first, second), ["turtlebot3-lds", "hc-sr04"])
    assert [(unit.site.name, unit.label) for unit in units] == [
        ("b", "hc-sr04"), ("b", "turtlebot3-lds"), ("north/a", "rplidar-a1"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("site,buildin\na,a.wkt\n", "column 'buildin': did you mean building"),
        ("site\na\n", "the column building is missing"),
        ("site,building\n", "there are no buildings"),
        ("site,building\na,none.wkt\n", "site 'a': the building none.wkt does not exist"),
        ("site,building\na,a.wkt\na,a.wkt\n", "2 sites are called 'a'"),
        ("site,building\n../a,a.wkt\n", r"line 2: site '\.\./a' cannot name a file"),
        ("site,building\na.json,a.wkt\n", "cannot name a file"),
        ("site,building\n.a,a.wkt\n", "cannot name a file"),
        ("site,building\na//b,a.wkt\n", "cannot name a file"),
        ("site,building\n,a.wkt\n", "line 2: site is empty"),
        ("site,building\na\n", "line 2: it has not 2 values"),
        ("site,building,height\na,a.wkt,low\n", "height 'low' is not a number"),
        ("site,building,doors\na,a.wkt,opne\n", "line 2: doors 'opne': did you mean open"),
        ("site,building,unit\na,a.wkt,miles\n", "line 2: unit 'miles': choose from cm, ft"),
        ("site,building,date\na,a.wkt,May\n", "date 'May' is not an ISO 8601 date"),
        ("site,building,date\na,a.wkt,0001-01-01T00:00+14:00\n", "is not an ISO 8601 date"),
        ("site,building,site\na,a.wkt,b\n", "the column site is given twice"),
    ],
)
def test_what_is_wrong_in_a_table_is_said(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.wkt").touch()
    with pytest.raises(InputError, match=said):
        read_sites(table(tmp_path, text))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_tables_of_spreadsheets_with_other_separators_are_read(
    tmp_path: Path, separator: str
) -> None:
    (tmp_path / "a,1.wkt").touch()
    text = separator.join(("site", "building", "height")) + "\n"
    text += separator.join(("a", "a,1.wkt", "0.3")) + "\n"
    (site,) = read_sites(table(tmp_path, text))
    assert (site.building, site.reading) == ("a,1.wkt", {"height": 0.3})


def test_a_table_says_its_separator_and_has_commas_in_numbers(tmp_path: Path) -> None:
    (tmp_path / "a.wkt").touch()
    text = "sep=;\r\nsite;building;height\r\nBu\u0308ro/हिन्दी;a.wkt;0,3\r\n"
    (site,) = read_sites(table(tmp_path, text))
    assert (site.name, site.reading) == ("Büro/हिन्दी", {"height": 0.3})
    with pytest.raises(InputError, match="line 3: height 'low'"):
        read_sites(table(tmp_path, text.replace("0,3", "low")))


def test_names_of_files_keep_their_letters_and_marks(tmp_path: Path) -> None:
    for name in ("Büro", unicodedata.normalize("NFD", "Höhle"), "हिन्दी"):
        write_room(tmp_path / f"{name}.wkt", 3.0)
    names = [site.name for site in read_sites(str(tmp_path))]
    assert names == ["Büro", "Höhle", "हिन्दी"]


def test_a_folder_gives_its_buildings_and_nothing_else(tmp_path: Path) -> None:
    for name in ("a/hall.geojson", "b/hall.geojson", "b/hall.wkt", "odd (1)#.geojson", ".x/a.wkt"):
        write_room(tmp_path / name, 3.0)
    (tmp_path / "map.yaml").write_text(MAP.format(image="map.pgm"))
    (tmp_path / "map.pgm").write_bytes(PIXELS)
    (tmp_path / "nav2_params.yaml").write_text("amcl: {alpha1: 0.2}\n")
    (tmp_path / "scanner.yaml").write_text("parts: []\n")
    (tmp_path / "item.json").write_text('{"type": "Feature"}')
    names = [site.name for site in read_sites(str(tmp_path))]
    assert names == ["a/hall", "b/hall-geojson", "b/hall-wkt", "map", "odd__1__"]


def test_scanners_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    write_room(tmp_path / "a.geojson", 3.0)
    from ambinav.sensing.scanner import RangeScanner

    files = [tmp_path / name / "own.yaml" for name in "xy"]
    for path in files:
        path.parent.mkdir()
        RangeScanner.from_preset("rplidar-a1").to_yaml(path)
    with pytest.raises(InputError, match="both called own"):
        units_of(read_sites(str(tmp_path)), list(map(str, files)))
    with pytest.raises(InputError, match="site 'a' has none"):
        units_of(read_sites(str(tmp_path)), [])
    (tmp_path / "s.csv").write_text("site,building,scanner\nb,a.geojson,rplidar-z9\n")
    with pytest.raises(InputError, match=r"site 'b': .*rplidar-z9"):
        units_of(read_sites(str(tmp_path / "s.csv")), [])


def test_a_map_at_a_url_is_read_with_its_image(tmp_path: Path) -> None:
    system = fsspec.filesystem("memory")
    try:
        text = MAP.format(image="../images/map.pgm").encode()
        system.pipe_file("/fleet-maps/north/map.yaml", text)
        system.pipe_file("/fleet-maps/north/good.yaml", MAP.format(image="map.pgm").encode())
        system.pipe_file("/fleet-maps/north/map.pgm", PIXELS)
        system.pipe_file("/fleet-maps/images/map.pgm", PIXELS)
        good, outside = read_sites("memory://fleet-maps")
        assert (good.name, outside.name) == ("north/good", "north/map")
        contents = good.contents()
        assert list(contents) == ["good.yaml", "map.pgm"] and good.moment.endswith("Z")
        (tmp_path / "good.yaml").write_bytes(contents["good.yaml"])
        (tmp_path / "map.pgm").write_bytes(PIXELS)
        here = load_environment(tmp_path / "good.yaml")
        assert _load(good, contents).free.equals(here.free)
        with pytest.raises(InputError, match="is not in the folder of the map"):
            outside.contents()
        with pytest.raises(InputError, match=r"north/good\.yaml: "):
            _load(good, {"good.yaml": b"image: map.pgm"})
    finally:
        system.rm("/fleet-maps", recursive=True)
