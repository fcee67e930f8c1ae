"""The report: complete, standing alone, and never half-written."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import shapely
from PIL import Image

import ambinav as an
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.reach import find_reach
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.number_text import metres2, percent
from ambinav.runtime.errors import InputError
from ambinav.studies.audit import pictures
from ambinav.studies.audit.audit import audit, axis_degrees
from ambinav.studies.audit.document import Document, document
from ambinav.studies.audit.report import STUDY, write_audit
from tests.maps import synthetic

FILES = {
    "report.html", "report.md", "report.json", "floor-zones.png", "floor-level.png",
    "place-01.png", "place-02.png", "place-03.png", "place-04.png",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(examined, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "out"
    write_audit(examined, path)
    return path


@pytest.fixture(scope="module")
def fewer(building, laser):
    """The same with one place, which is quicker to draw."""
    return audit(AmbiguityMap(synthetic.dataset()), building, laser, places=1)


@pytest.fixture
def copied(folder, tmp_path):
    """The report again, to be replaced."""
    return shutil.copytree(folder, tmp_path / "out")


class Links(HTMLParser):
    """Collects everything that a page loads or points to, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        places = ("src", "href", "data", "action")
        # An address that begins with # is a place in the page itself.
        self.links += [value for name, value in attrs if name in places and value[0] != "#"]

    def handle_data(self, data):
        self.text.append(data)


def test_all_files_are_there(folder):
    assert {item.name for item in folder.iterdir()} == FILES
    assert [item.name for item in folder.parent.iterdir()] == ["out"]
    for name in FILES:
        if name.endswith(".png"):
            with Image.open(folder / name) as picture:
                assert min(picture.size) > 500


@pytest.mark.sweep
def test_pictures_can_be_drawn_as_lines(examined, fewer, tmp_path):
    report = write_audit(examined, tmp_path / "out", image_format="svg")
    names = {name.replace(".png", ".svg") for name in FILES}
    assert {item.name for item in (tmp_path / "out").iterdir()} == names
    assert {*report.pictures, *(place.picture for place in report.places)} <= names
    assert (tmp_path / "out" / "floor-zones.svg").read_text().startswith("<?xml")
    links = Links()
    links.feed((tmp_path / "out" / "report.html").read_text())
    assert links.links
    assert all(link.startswith("data:image/svg+xml;base64,") for link in links.links)
    linked = re.findall(r"\]\(([^)]+)\)", (tmp_path / "out" / "report.md").read_text())
    assert set(linked) == {name for name in names if name.endswith(".svg")}
    # It is a report like any other, and replaced by the next.
    write_audit(fewer, tmp_path / "out")
    left = {name for name in FILES if name < "place-02" or name > "place-04.png"}
    assert {item.name for item in (tmp_path / "out").iterdir()} == left


def test_html_stands_alone(folder):
    page = (folder / "report.html").read_text()
    links = Links()
    links.feed(page)
    assert len(links.links) == 6
    assert all(link.startswith("data:image/png;base64,") for link in links.links)
    # What scripts and styles load, the policy forbids; a browser is asked in test_report_page.py.
    assert "content=\"default-src 'none'; script-src 'unsafe-inline' data:;" in page
    assert not re.search(r"url\(|@import", re.sub(r"<script.*?</script>", "", page, flags=re.S))
    assert not re.search(r"https?:|file:", re.sub(r"<script>.*?</script>", "", page, flags=re.S))
    text = " ".join(" ".join(links.text).split())
    for expected in (
        "synthetic <building>",  # escaped in the source, so that it arrives as text
        "test laser",
        "can tell its position well on 21 % of the 125 m² of explored floor that it can reach",
        "one ring was not closed",
        "ab" * 32,
        "None of the 60 beams returns an echo",
        "36 m²",
    ):
        assert expected in text, expected
    assert "<building>" not in page


def test_markdown_points_at_files_that_exist(folder):
    text = (folder / "report.md").read_text()
    linked = re.findall(r"\]\(([^)]+)\)", text)
    assert set(linked) == {name for name in FILES if name.endswith(".png")}
    assert "| corridor | 61 m² | 49 % | | 5 (11.0 m) |" in text
    assert "| all explored, reachable floor | 125 m² | 100 % | 89 % |" in text
    assert "| unexplored | 0.0 m² | | 0 % | | half of the beams" in text
    assert "| not reachable by a robot of 0.20 m | 15 m² | | 11 % | | 0.0 m² where it" in text
    assert "| all free floor | 140 m² | | 100 % | | |" in text
    assert "{{" not in text


def test_json_follows_its_schema_and_is_rounded(folder, examined):
    data = json.loads((folder / "report.json").read_text())
    assert Document.model_validate(data) == document(examined)
    assert data["format"] == "ambinav-audit/5"
    assert data["places_in_all"] == 6
    assert len(data["places"]) == 4
    worst = data["places"][0]
    assert (worst["zone"], worst["area_m2"], worst["direction_deg"]) == ("open", 36.0, None)
    assert worst["x_m"] == 20.95
    assert worst["sees"]["without_echo"] == 60
    assert {zone["zone"]: zone["area_m2"] for zone in data["zones"]}["corridor"] == 60.97
    # The corridor of 12 m less its borders of 0.5 m; rims of the hall; its middle of 6 by 6 m.
    zones = {zone["zone"]: (zone["places"], zone["longest_place_m"]) for zone in data["zones"]}
    assert zones == {
        "localizable": (0, None), "transition": (0, None), "corridor": (5, 11.0), "open": (1, 6.0)
    }  # fmt: skip
    assert data["floor"] == {
        "robot_radius_m": 0.2, "from_m": None, "counted_area_m2": 125.0, "unexplored_area_m2": 0.0,
        "unreachable_area_m2": 15.0, "beside_walls_area_m2": 15.0, "cut_off_area_m2": 0.0,
        "outside_area_m2": 0.0, "free_area_m2": 140.0, "impossible_poses": 0,
        "counted_share": 0.8929, "unexplored_share": 0.0, "unreachable_share": 0.1071,
        "outside_share": 0.0,
    }  # fmt: skip
    assert sum(zone["share"] for zone in data["zones"]) == pytest.approx(1.0, abs=1e-3)
    assert data["parameters"]["radius"] == 0.5
    assert data["environment"]["sha256"] == "ab" * 32
    for number in re.findall(r"\d+\.\d+", json.dumps(data["places"])):
        assert len(number.split(".")[1]) <= 4


def test_the_scanner_in_the_report_can_be_used_again(folder, laser):
    yaml = json.loads((folder / "report.json").read_text())["scanner"]["yaml"]
    assert type(laser).from_yaml_text(yaml) == laser


def test_places_that_are_not_listed_are_counted(examined):
    unlisted = replace(examined, findings=())
    count = examined.regions
    assert f"There are {count} bad places of notable size, not listed here." in unlisted.summary
    assert "There is one bad place" in replace(unlisted, regions=1).summary
    assert "There is no bad place" in replace(unlisted, regions=0).summary


def test_summary_in_words(examined):
    assert examined.summary == (
        # Of the cells at least 0.2 m from all walls: 2 643, 6 097 and 3 600 of 12 500.
        "With test laser a robot of radius 0.20 m can tell its position well on 21 % of the "
        "125 m² of explored floor that it can reach in synthetic <building>. On 49 % (61 m²) it "
        "can drift along a wall or corridor without noticing. On 29 % (36 m²) the scan constrains "
        "its position in no direction. Of the 140 m² of free floor, 15 m² are too close to walls "
        "for this robot: not counted. The worst of 6 places is an open area over 36 m² around "
        "x = 20.9 m, y = 5.0 m."
    )


@pytest.mark.parametrize(
    ("share", "text"), [(0.0, "0 %"), (0.0004, "less than 0.1 %"), (0.004, "0.4 %"), (0.5, "50 %")]
)
def test_small_shares_are_not_nothing(share, text):
    assert percent(share) == text
    assert metres2(1234.5) == "1,234 m²"
    # A sum of cells reads as what a document keeps of it.
    assert metres2(75 * 0.3**2 - 1e-15) == metres2(6.75) == "6.8 m²"


@pytest.mark.parametrize(
    ("axis", "text"), [(None, "none"), (0.0, "0°"), (90.4, "90°"), (179.4, "179°"), (179.6, "0°")]
)
def test_a_direction_has_no_sense(axis, text):
    assert axis_degrees(axis) == text


@pytest.mark.slow
def test_headings_are_reported(building, laser, tmp_path):
    found = audit(AmbiguityMap(synthetic.dataset(headings=4)), building, laser, places=1)
    report = write_audit(found, tmp_path / "out")
    assert report.headings.startswith("all: zones of half or more of the headings")
    assert [zone.share_best_heading for zone in report.zones][2] == pytest.approx(0.4878)
    assert (report.places[0].best_heading_deg, report.places[0].worst_heading_deg) == (0.0, 180.0)
    assert report.places[0].sees.heading_deg == 180.0
    level = {row.heading_deg: row.level for row in report.by_heading}
    assert sorted(level) == [0.0, 90.0, 180.0, 270.0]
    assert min(level, key=level.__getitem__) == 0.0  # the made-up map is best there everywhere
    assert {"floor-best.png", "floor-worst.png"} <= {p.name for p in (tmp_path / "out").iterdir()}
    assert all(sum(row.shares.values()) == pytest.approx(1, abs=1e-3) for row in report.by_heading)
    assert "Best heading 0° (level " in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.slow
def test_no_places_at_all(building, laser, tmp_path):
    found = audit(AmbiguityMap(synthetic.dataset()), building, laser, places=0)
    write_audit(found, tmp_path / "out")
    assert "6 places were found, none is listed" in (tmp_path / "out" / "report.md").read_text()
    with pytest.raises(InputError, match="places: -1"):
        audit(AmbiguityMap(synthetic.dataset()), building, laser, places=-1)


@pytest.mark.sweep
def test_an_earlier_report_is_replaced_whole(fewer, copied):
    assert (copied / "place-02.png").exists()
    write_audit(fewer, copied)
    assert not (copied / "place-02.png").exists()


@pytest.mark.slow
def test_a_failed_report_leaves_the_earlier_one(examined, copied, tmp_path, monkeypatch):
    before = (copied / "report.json").stat().st_mtime_ns

    def fail(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pictures, "plot_finding", fail)
    # In this process: a drawing process, if threads have not begun yet, would be killed by it.
    with pytest.raises(KeyboardInterrupt):
        write_audit(examined, copied, draw=pictures.save_pictures)
    assert {item.name for item in copied.iterdir()} == FILES
    assert (copied / "report.json").stat().st_mtime_ns == before
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


@pytest.mark.slow
def test_a_report_of_an_older_version_is_replaced(fewer, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text('{"format": "ambinav-audit/1"}')
    assert write_audit(fewer, tmp_path / "out").format == "ambinav-audit/5"


def test_other_folders_are_never_replaced(tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"thesis\.tex.*choose a new folder"):
        STUDY.folder.check(tmp_path / "home")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "place-of-birth.png").write_bytes(b"")
    with pytest.raises(InputError, match="not of an earlier audit"):
        STUDY.folder.check(tmp_path / "pictures")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        STUDY.folder.check(tmp_path / "file")
    (tmp_path / "empty").mkdir()
    assert STUDY.folder.check(tmp_path / "empty") == tmp_path / "empty"


def test_headings_that_are_impossible_here_and_there_do_not_count():
    # A laser of 180 degrees 0.3 m ahead of the centre: near a wall some headings are impossible.
    sensor = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    fan = an.RangeScanner.planar(sensor, 20, math.pi, mount=(0.3, 0.0, 0.0))
    room = environment_from_shapes([shapely.box(0, 0, 3, 2)])
    amap = an.build_map(room, fan, spacing=0.2, radius=0.4, headings=4)
    found = audit(amap, room, fan, reach=find_reach(room, 0.05))
    assert (found.parts.counted[:, :, np.newaxis] & ~amap.possible).any()

    report = document(found)
    assert len(report.by_heading) == 4
    level = amap.dataset["level"].values
    for k, part in enumerate(report.by_heading):
        here = level[..., k][found.parts.counted]
        assert part.level == pytest.approx(np.nanmean(here), abs=1e-4)
        assert sum(part.shares.values()) == pytest.approx(1.0, abs=5e-4)
