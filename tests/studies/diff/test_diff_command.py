"""`ambinav diff` as a user meets it: what is printed, written and refused; the picture."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.studies.diff.figures import QUANTITIES
from tests.maps import synthetic
from tests.studies.diff.test_difference import block, set_cells
from tests.test_cli import PLAN, SCANNER


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Two stored maps: the hall has become better, the room worse."""
    folder = tmp_path_factory.mktemp("maps")
    first = synthetic.dataset()
    second = set_cells(first, block(first, 1.0, 3.0, 1.0, 2.0), 0.9, 3)
    second = set_cells(second, block(first, 19.0, 22.0, 4.0, 6.0), 0.2, 0)
    second.attrs["ambinav_version"] = "1 | <b>"
    AmbiguityMap(first).save(folder / "a.zarr")
    AmbiguityMap(second).save(folder / "b.zarr")
    return folder


@pytest.fixture
def folder(maps, tmp_path, monkeypatch):
    for name in ("a.zarr", "b.zarr"):
        (tmp_path / name).symlink_to(maps / name)
    (tmp_path / "plan.geojson").write_text(json.dumps(PLAN))
    (tmp_path / "scanner.yaml").write_text(SCANNER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str):
    return CliRunner().invoke(app, ["diff", *arguments])


class Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in ("src", "href")]


@pytest.mark.slow
def test_the_report_is_whole_and_stands_alone(folder):
    result = run("a.zarr", "b.zarr", "-o", "out", "--fail-if", "new open area > 1 m2")
    assert result.exit_code == 3, result.output
    assert "2.0 m² are worse by 0.1 or more, 6.0 m² better" in " ".join(result.stdout.split())
    names = {"diff.html", "diff.md", "diff.json", "difference.png"}
    assert {item.name for item in (folder / "out").iterdir()} == names
    report = json.loads((folder / "out" / "diff.json").read_text())
    assert [one["kind"] for one in report["regions"]] == ["better", "worse"]
    page = Page()
    text = (folder / "out" / "diff.html").read_text()
    page.feed(text)
    assert page.links and all(link.startswith("data:image/png;base64,") for link in page.links)
    assert "1 | &lt;b&gt;" in text
    # Every line of a table in Markdown has as many cells as its head.
    tables = re.findall(r"(?:^\|.*\n)+", (folder / "out" / "diff.md").read_text(), re.MULTILINE)
    assert len(tables) == 5
    for table in tables:
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}) == 1
    # It is a report like any other, and replaced by the next.
    assert run("b.zarr", "a.zarr", "-o", "out", "--pictures", "svg").exit_code == 0
    names = {"diff.html", "diff.md", "diff.json", "difference.svg"}
    assert {item.name for item in (folder / "out").iterdir()} == names


def test_json_is_the_document_and_nothing_else(folder):
    result = run("a.zarr", "b.zarr", "--json", "--places", "1")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert len(report["regions"]) == 1 and report["regions_in_all"] == 2
    assert not (folder / "out").exists()


def test_the_file_of_a_building_is_no_parameter_of_a_gate():
    names = ("environment", "environment_sha256", "parameters.spacing")
    report = SimpleNamespace(parameters=[SimpleNamespace(name=name) for name in names])
    (count,) = [each.read for each in QUANTITIES.values() if each.name == "differing parameters"]
    assert count(report) == 1.0


def test_identical_maps_say_so(folder):
    result = run("a.zarr", "a.zarr", "--fail-if", "differing parameters > 0")
    assert result.exit_code == 0, result.output
    assert "The maps are identical" in result.stdout


@pytest.mark.slow
def test_the_picture_shows_worse_red_and_better_blue(folder):
    assert run("a.zarr", "b.zarr", "-o", "out", "--places", "0").exit_code == 0
    pixels = np.asarray(Image.open(folder / "out" / "difference.png").convert("RGB")).astype(int)
    third = pixels[2 * len(pixels) // 3 :]  # wide floors: the panels lie one below another
    red, green, blue = third[..., 0], third[..., 1], third[..., 2]
    area = {
        "red": ((red > blue + 60) & (red > green + 60)).sum(),
        "blue": ((blue > red + 60) & (blue > green + 20)).sum(),
    }
    bar = 0.06 * sum(area.values())
    assert area["blue"] > 1.5 * area["red"] > bar  # 6 m2 better, 2 m2 worse, and the colour bar


@pytest.mark.slow
def test_two_scanners_in_one_building(folder):
    (folder / "long.yaml").write_text(SCANNER.replace("max_range: 2.0", "max_range: 12.0"))
    result = run(
        "plan.geojson", "plan.geojson", "-s", "scanner.yaml", "--scanner-b", "long.yaml",
        "--spacing", "0.4", "--fail-if", "lost corridor area > 1 m2",
    )  # fmt: skip
    assert result.exit_code == 3, result.output
    assert "max_range" in result.stdout and "0 gone" not in result.stdout
    # With the same scanner nothing differs.
    build = ("map", "plan.geojson", "-s", "scanner.yaml", "--spacing", "0.4", "-o", "c.zarr")
    assert CliRunner().invoke(app, build).exit_code == 0
    beside = run("plan.geojson", "c.zarr", "-s", "scanner.yaml")
    assert "mapped as c.zarr is, with --spacing 0.4" in beside.stderr
    assert "The maps are identical" in beside.stdout
    same = run("plan.geojson", "plan.geojson", "-s", "scanner.yaml", "--spacing", "0.4")
    assert same.exit_code == 0 and "identical" in same.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.zarr", "missing.zarr"), "missing.zarr: there is no such map"),
        (("a.zarr", "plan.geojson"), "plan.geojson: this is not an ambiguity map"),
        (("a.zarr", "b.zarr", "-s", "scanner.yaml"), "leave it out"),
        (("plan.geojson", "b.zarr", "-s", "scanner.yaml", "--scanner-b", "x"), "leave it out"),
        (("a.zarr", "b.zarr", "--places", "-1"), "--places: -1 is negative"),
        (("a.zarr", "b.zarr", "--wall-tolerance", "0"), "--wall-tolerance: 0 is not above zero"),
        (("a.zarr", "b.zarr", "--robot-radius", "9"), "fits nowhere"),
        (("a.zarr", "b.zarr", "--start", "99", "99"), "99"),
        (("a.zarr", "b.zarr", "--fail-if", "open > 2 %"), "did you mean"),
        (("a.zarr", "b.zarr", "-o", "a.zarr"), "not of an earlier difference"),
        (("a.zarr", "b.zarr", "--pictures", "gif"), "'gif' is not a picture format"),
    ],
)
def test_bad_input_is_told_in_one_sentence(folder, arguments, message):
    before = {item.name for item in folder.iterdir()}
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert message in result.stderr and result.stderr.count("error:") == 1
    assert {item.name for item in folder.iterdir()} == before


def test_maps_apart_are_refused_in_one_sentence(folder):
    far = synthetic.dataset()
    AmbiguityMap(far.assign_coords(x=far["x"] + 500.0)).save("far.zarr")
    result = run("a.zarr", "far.zarr")
    assert result.exit_code == 2
    assert "does not overlap a.zarr" in result.stderr


def test_help_shows_an_example():
    text = " ".join(run("--help").stdout.split())
    assert "Example: ambinav diff before.zarr after.zarr" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        ("--spacing", "0.05"),
        ("--ambiguity-radius", "1.2"),
        ("--layers", "fisher"),
        ("--headings", "4"),
        ("--level", "3"),
    ],
)
def test_options_on_buildings_are_refused_with_maps(folder, given):
    result = run("a.zarr", "b.zarr", *given)
    assert result.exit_code == 2
    assert f"{given[0]}: this is for buildings, but A and B are maps" in result.stderr
