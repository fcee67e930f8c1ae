"""The command line as a user meets it: exit status, what goes to stdout, what is left on disk."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import ambinav
from ambinav.cli import app
from ambinav.cli.map_options import MapOptions
from ambinav.geometry.lattice import Lattice
from ambinav.maps.ambiguity_map import AmbiguityMap

ROOT = Path(__file__).parents[1]
COMMANDS = ("audit", "map", "plugins", "presets", "calibrate sensor", "calibrate localizer")

# A room with a corridor 8 m long, as polygons.
PLAN = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"kind": "room", "name": "all"},
            "geometry": {
                "type": "Polygon",
                "coordinates": [
                    [[0, 0], [3, 0], [3, 1], [11, 1], [11, 2.5], [3, 2.5], [3, 3], [0, 3], [0, 0]]
                ],
            },
        }
    ],
}
SCANNER = """
name: short laser
parts:
  - sensor: {max_range: 2.0, std: 0.02, resolution: 0.01}
    planar: {beams: 36, aperture_deg: 360}
"""


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A working folder with a plan and a scanner."""
    (tmp_path / "plan.geojson").write_text(json.dumps(PLAN))
    (tmp_path / "scanner.yaml").write_text(SCANNER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


AUDIT = (
    "audit", "plan.geojson", "-s", "scanner.yaml", "-o", "out", "--spacing", "0.2", "--posts", "0"
)  # fmt: skip
MAP = ("map", "plan.geojson", "-s", "scanner.yaml", "-o", "plan.zarr", "--spacing", "0.2")


@pytest.mark.slow
def test_audit_writes_a_report(runner, folder):
    result = runner.invoke(app, AUDIT)
    assert result.exit_code == 0, result.output
    assert "can tell its position well on" in " ".join(result.stdout.split())
    assert "out/report.html" in result.stdout
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["places"][0]["zone"] == "corridor"
    direction = report["places"][0]["direction_deg"]
    assert min(direction, 180 - direction) < 2.0
    assert files(folder) == {"plan.geojson", "scanner.yaml", "out"}


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
def test_audit_counts_what_the_robot_reaches(runner, folder):
    result = runner.invoke(app, [*AUDIT, "--robot-radius", "0.25", "--start", "1", "1", "--json"])
    assert result.exit_code == 0, result.output
    floor = json.loads(result.stdout)["floor"]
    assert (floor["robot_radius_m"], floor["from_m"]) == (0.25, [1.0, 1.0])
    # Cells of 0.2 m: 13 x 13 of the room, 40 x 5 of the corridor.
    assert floor["counted_area_m2"] == pytest.approx((13 * 13 + 40 * 5) * 0.04)
    assert floor["free_area_m2"] == pytest.approx(21.0, abs=1.0)
    text = runner.invoke(app, [*AUDIT, "--robot-radius", "0.8"]).output
    assert "not reachable by a robot of 0.80 m" in " ".join(text.split())


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
def test_the_scanner_says_how_large_its_robot_is(runner, folder):
    (folder / "scanner.yaml").write_text(SCANNER + "robot_radius: 0.35\n")
    result = runner.invoke(app, [*AUDIT, "--json"])
    assert json.loads(result.stdout)["floor"]["robot_radius_m"] == 0.35
    result = runner.invoke(app, [*AUDIT, "--json", "--robot-radius", "0.1"])
    assert json.loads(result.stdout)["floor"]["robot_radius_m"] == 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot-radius", "0"], "--robot-radius: 0 is not above zero"),
        (["--robot-radius", "nan"], "--robot-radius: nan is not above zero"),
        (["--robot-radius", "3"], "fits nowhere, the widest place takes 1.5 m"),
        (["--start", "0.1", "1.5"], "0.10 m from a wall, the footprint needs 0.2 m; the nearest"),
        (["--start", "5", "2.8"], "the nearest place that fits is (5.00, 2.29), 0.51 m away"),
        (["--start", "-40", "2"], "outside of the map"),
        (["--start", "nan", "2"], "two finite numbers"),
        (["--robot-radius", "1", "--start", "8", "1.7"], "the footprint needs 1 m"),
    ],
)
def test_what_no_robot_can_do_is_refused(runner, folder, options, message):
    result = runner.invoke(app, [*AUDIT, *options])
    assert result.exit_code == 2
    text = result.stderr.strip()
    assert message in text and text.startswith("ambinav: error: ") and "\n" not in text
    assert not (folder / "out").exists()


@pytest.mark.slow
def test_map_says_what_its_shares_are_of(runner, folder):
    arguments = ["map", "plan.geojson", "-s", "scanner.yaml", "--spacing", "0.2", "-o", "m.zarr"]
    data = json.loads(runner.invoke(app, [*arguments, "--json"]).stdout)
    kinds = ("judged", "unexplored", "too_close", "not_reachable", "outside")
    areas = [data[f"{kind}_area_m2"] for kind in kinds]
    assert sum(areas) == pytest.approx(data["free_area_m2"], abs=0.02)
    assert areas[0] > areas[2] > 0.0 and data["robot_radius_m"] == 0.2
    assert "m^2 judged: localizable" in runner.invoke(app, arguments).output


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
def test_audit_stores_the_map_that_map_makes(runner, folder):
    result = runner.invoke(app, [*AUDIT, "--save-map", "audit.zarr", "--no-store"])
    assert result.exit_code == 0 and "map: audit.zarr" in result.output
    runner.invoke(app, ["map", *AUDIT[1:4], "-o", "map.zarr", "--spacing", "0.2", "--no-store"])
    one, other = AmbiguityMap.open("audit.zarr"), AmbiguityMap.open("map.zarr")
    assert one.dataset.equals(other.dataset)
    (folder / "notes").mkdir()
    (folder / "notes" / "a.txt").write_text("mine")
    result = runner.invoke(app, [*AUDIT, "--save-map", "notes"])
    assert result.exit_code == 2 and "not an ambiguity map" in result.output


def test_audit_keeps_map_and_report_apart(runner, folder):
    for place in ("out", "out/map.zarr"):
        result = runner.invoke(app, [*AUDIT, "--save-map", place])
        assert result.exit_code == 2 and "must not contain each other" in result.output
    assert files(folder) == {"plan.geojson", "scanner.yaml"}


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
def test_audit_as_json_prints_nothing_else(runner, folder):
    result = runner.invoke(app, [*AUDIT, "--json", "--places", "0"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout) == json.loads((folder / "out" / "report.json").read_text())


@pytest.mark.slow
def test_map_can_be_opened(runner, folder):
    result = runner.invoke(app, [*MAP, "--json"])
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    amap = AmbiguityMap.open(folder / report["output"])
    assert report["cells"] == int(amap.dataset["free"].sum())
    assert amap.spacing == pytest.approx(0.2)
    assert sum(zone["share"] for zone in report["zones"]) == pytest.approx(1.0, abs=1e-3)
    again = runner.invoke(app, MAP)  # replaces its own
    assert again.exit_code == 0
    assert "plan.zarr" in again.stdout


@pytest.mark.slow
def test_a_map_for_a_body_leaves_out_where_it_does_not_fit(runner, folder):
    cells = []
    for radius in ("0", "0.3"):
        result = runner.invoke(app, [*MAP, "--json", "--robot-radius", radius])
        assert result.exit_code == 0, result.output
        cells.append(json.loads(result.stdout)["cells"])
    amap = AmbiguityMap.open(folder / json.loads(result.stdout)["output"])
    assert cells[1] < cells[0]
    assert float(np.nanmin(amap.dataset["clearance"])) >= 0.3 - 1e-6
    assert json.loads(amap.dataset.attrs["parameters"])["robot_radius"] == 0.3


BAD = {
    "no such map": (["audit", "none.yaml", "-s", "scanner.yaml", "-o", "out"], "none.yaml"),
    "unknown suffix": (["map", "scanner.odt", "-s", "scanner.yaml", "-o", "out"], "suffix"),
    "no point cloud": (["map", "house.laz", "-s", "scanner.yaml", "-o", "out"], "no such file"),
    "unknown preset": (["audit", "plan.geojson", "-s", "hokuyo-urg-04", "-o", "out"], "hokuyo"),
    "no such scanner": (["audit", "plan.geojson", "-s", "my.yaml", "-o", "out"], "my.yaml"),
    "spacing 0": ([*AUDIT, "--spacing", "0"], "--spacing: 0"),
    "spacing nan": ([*AUDIT, "--spacing", "nan"], "--spacing: nan"),
    "spacing too large": ([*AUDIT, "--spacing", "50"], "larger than the building"),
    "radius negative": ([*MAP, "--ambiguity-radius", "-1"], "--ambiguity-radius: -1"),
    "radius inf": ([*MAP, "--ambiguity-radius", "inf"], "--ambiguity-radius: inf"),
    "map-std negative": ([*MAP, "--map-std", "-0.1"], "--map-std: -0.1"),
    "map-std too large": ([*MAP, "--map-std", "1e308"], "--map-std: 1e+308 is too large"),
    "height in a plan": ([*MAP, "--scanner-height", "1.2"], "in which no height counts"),
    "beacons as a layer": ([*MAP, "--layers", "fisher,beacons"], "needs the places of beacons"),
    "no headings": ([*MAP, "--headings", "0"], "--headings: 0"),
    "robot radius negative": ([*MAP, "--robot-radius", "-0.2"], "--robot-radius: -0.2"),
    "negative places": ([*AUDIT, "--places", "-3"], "--places: -3"),
    "output is a file": ([*AUDIT, "-o", "plan.geojson"], "is a file"),
    "output is in use": ([*AUDIT, "-o", "."], "plan.geojson"),
    "map output is in use": ([*MAP, "-o", "."], "not an ambiguity map"),
    "unknown preset shown": (["presets", "sick"], "sick"),
    "no such pairs": (
        [
            "calibrate",
            "sensor",
            "no.csv",
            "-o",
            "s.yaml",
            "--max-range",
            "5",
            "--resolution",
            "0.01",
        ],
        "no.csv",
    ),
    "resolution 0": (
        ["calibrate", "sensor", "no.csv", "-o", "s.yaml", "--max-range", "5", "--resolution", "0"],
        "--resolution",
    ),
}


@pytest.mark.parametrize(("arguments", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence_and_status_2(runner, folder, arguments, message):
    before = files(folder)
    result = runner.invoke(app, arguments)
    assert result.exit_code == 2, result.output
    errors = [line for line in result.stderr.splitlines() if "note:" not in line]
    assert len(errors) == 1
    assert errors[0].startswith("ambinav: error: ")
    assert message in errors[0]
    assert result.stdout == ""
    assert files(folder) == before


@pytest.mark.parametrize("inner", [("map", "-o", "a.zarr/b.zarr"), ("audit", "-o", "a.zarr/out")])
def test_nothing_is_written_into_a_map(runner, folder, inner):
    """The map is replaced as a whole: what stands in it would be gone with the next one."""
    (folder / "a.zarr").mkdir()
    command, *output = inner
    result = runner.invoke(app, [command, "plan.geojson", "-s", "scanner.yaml", *output])
    assert result.exit_code == 2
    assert "this is inside of the map" in result.stderr
    assert not any((folder / "a.zarr").iterdir())


def test_the_output_is_checked_before_the_long_work(runner, folder, monkeypatch):
    def never(*arguments: object, **options: object) -> None:
        raise AssertionError("the map was built for nothing")

    monkeypatch.setattr(MapOptions, "build", never)
    for arguments in ([*AUDIT, "-o", "plan.geojson/out"], [*MAP, "-o", "plan.geojson/a.zarr"]):
        result = runner.invoke(app, arguments)
        assert result.exit_code == 2, result.output
        assert "is a file, not a folder" in result.stderr


def test_bad_input_makes_no_folders(runner, folder):
    result = runner.invoke(app, ["audit", "none.yaml", "-s", "scanner.yaml", "-o", "a/b/out"])
    assert result.exit_code == 2
    assert not (folder / "a").exists()


def test_wrong_usage_is_status_2(runner, folder):
    for arguments in (["audit"], ["audit", "plan.geojson"], ["nonsense"], ["map", "--spacing"]):
        assert runner.invoke(app, arguments).exit_code == 2


def test_our_own_fault_is_status_1(runner, folder, monkeypatch):
    def broken(*arguments: object, **options: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(MapOptions, "build", broken)
    result = runner.invoke(app, MAP)
    assert result.exit_code == 1
    assert "internal error" in result.stderr
    assert "a bug" in result.stderr
    assert "ambinav: error:" not in result.stderr


@pytest.mark.parametrize("arguments", [AUDIT, MAP])
def test_interrupted_is_status_130_and_leaves_nothing(runner, folder, monkeypatch, arguments):
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(MapOptions, "build", interrupted)
    before = files(folder)
    assert runner.invoke(app, arguments).exit_code == 130
    assert files(folder) == before


def test_repairs_are_reported_as_notes(runner, folder):
    crossing = json.loads(json.dumps(PLAN))
    ring = crossing["features"][0]["geometry"]["coordinates"][0]
    ring[3], ring[4] = ring[4], ring[3]
    (folder / "plan.geojson").write_text(json.dumps(crossing))
    result = runner.invoke(app, [*MAP, "--json"])
    assert result.exit_code == 0, result.output
    assert "ambinav: note: " in result.stderr
    json.loads(result.stdout)


@pytest.mark.slow
def test_presets(runner):
    listed = runner.invoke(app, ["presets", "--json"])
    rows = json.loads(listed.stdout)
    assert {"hokuyo-urg-04lx", "polaroid-6500-ring"} <= {row["name"] for row in rows}
    assert all(row["max_range_m"] > 0 and row["source"] for row in rows)
    table = runner.invoke(app, ["presets"])
    assert all(row["name"] in table.stdout for row in rows)
    text = runner.invoke(app, ["presets", "hokuyo-urg-04lx"]).stdout
    scanner = ambinav.RangeScanner.from_yaml_text(text)
    assert scanner == ambinav.RangeScanner.from_preset("hokuyo-urg-04lx")
    shown = json.loads(runner.invoke(app, ["presets", "hokuyo-urg-04lx", "--json"]).stdout)
    assert shown["name"] == scanner.name


def test_calibrate_sensor(runner, folder):
    rng = np.random.default_rng(3)
    true = np.linspace(0.2, 4.8, 200)
    rows = np.column_stack([true, true + 0.02 + 0.01 * rng.standard_normal(200)])
    np.savetxt(folder / "pairs.csv", rows, delimiter=",", header="true_range,reading", comments="")
    arguments = ("calibrate", "sensor", "pairs.csv", "-o", "s.yaml", "--max-range", "5")
    result = runner.invoke(app, [*arguments, "--resolution", "0.01"])
    assert result.exit_code == 0, result.output
    assert "residuals" in result.stdout
    sensor = ambinav.RangeSensor.from_yaml(folder / "s.yaml")
    assert sensor.bias_at(2.0) == pytest.approx(0.02, abs=0.003)
    report = json.loads(runner.invoke(app, [*arguments, "--resolution", "0.01", "--json"]).stdout)
    assert report["pairs"] == 200
    assert report["residual_rms_m"] == pytest.approx(0.01, rel=0.15)
    (folder / "pairs.csv").write_text("true_range,reading\n1,1.01\n2,two\n")
    bad = runner.invoke(app, [*arguments, "--resolution", "0.01"])
    assert bad.exit_code == 2
    assert "pairs.csv: line 3" in bad.stderr
    before = (folder / "pairs.csv").read_bytes()
    same = ("pairs.csv", "-o", f"{folder}/pairs.csv", "--max-range", "5", "--resolution", "0.01")
    over = runner.invoke(app, ["calibrate", "sensor", *same])
    assert over.exit_code == 2
    assert "pairs.csv is also the input; name another file" in over.stderr
    assert (folder / "pairs.csv").read_bytes() == before


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(runner, command):
    text = runner.invoke(app, [*command.split(), "--help"]).stdout
    assert f"Example: ambinav {command}" in " ".join(text.split())


def run(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
        **options,
    )


@pytest.mark.slow
def test_as_a_program(folder):
    assert run("-m", "ambinav.cli", "--version").stdout == f"ambinav {ambinav.__version__}\n"
    assert "Usage: ambinav plan" in run("-m", "ambinav", "plan", "--help").stdout
    assert run("-m", "ambinav.cli", "audit", "none.yaml", "-s", "x", "-o", "out").returncode == 2


@pytest.mark.slow(kept=("SIGKILL",))
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_killed_run_leaves_the_older_map(folder, name):
    assert CliRunner().invoke(app, MAP).exit_code == 0
    before = AmbiguityMap.open(folder / "plan.zarr").dataset
    number = getattr(signal, name)
    process = subprocess.Popen(
        [sys.executable, "-m", "ambinav.cli", *MAP],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while process.poll() is None and not any(folder.glob(".plan.zarr.*")):
        time.sleep(0.001)
    process.send_signal(number)  # while the new map is being written
    assert process.wait(60) == {"SIGKILL": -9, "SIGTERM": 143, "SIGINT": 130}[name]
    assert AmbiguityMap.open(folder / "plan.zarr").dataset.identical(before)
    if name != "SIGKILL":  # which nobody can clean up after
        assert files(folder) == {"plan.geojson", "scanner.yaml", "plan.zarr"}


@pytest.mark.slow
def test_help_computes_nothing():
    heavy = ("numpy", "numba", "xarray", "matplotlib", "shapely", "scipy", "torch", "ompl")
    code = f"import ambinav.cli, sys; print([m for m in {heavy} if m in sys.modules])"
    assert run("-c", code).stdout.strip() == "[]"


@pytest.mark.parametrize("arguments", [AUDIT, MAP])
def test_a_giant_map_says_what_it_costs_before_it_starts(runner, folder, monkeypatch, arguments):
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Lattice, "over", interrupted)  # the first step of the work
    campus = {"type": "Polygon", "coordinates": [[[0, 0], [900, 0], [900, 800], [0, 0]]]}
    (folder / "plan.geojson").write_text(json.dumps(campus))
    small = [*arguments, "--spacing", "0.05", "--json"]
    result = runner.invoke(app, small)
    assert result.exit_code == 130 and result.stdout == ""
    (note,) = [line for line in result.stderr.splitlines() if "note" in line]
    # 900 * 800 / 2 / 0.05^2 poses.
    assert "144" in note and "million poses" in note
    assert re.search(r"this map takes about \d+ (minute|hour)s? and [\d.]+ GB", note)
    assert re.search(r"with --spacing 0\.\d+ .* GB\.$", note)
    coarse = runner.invoke(app, [*arguments, "--spacing", "0.5"])
    assert "note" not in coarse.stderr


@pytest.mark.slow
def test_floors_and_units(runner, folder):
    """A house of two floors in millimetres."""
    ring = [[0, 0], [3000, 0], [3000, 2000], [0, 2000], [0, 0]]
    features = [
        {"type": "Feature", "properties": {"level": name},
         "geometry": {"type": "Polygon", "coordinates": [[[x * k, y] for x, y in ring]]}}
        for k, name in ((1, "EG"), (2, "OG"))
    ]  # fmt: skip
    house = json.dumps({"type": "FeatureCollection", "features": features})
    (folder / "plan.geojson").write_text(house)
    for level, area in (("EG", 6.0), ("1", 12.0)):
        result = runner.invoke(app, [*MAP, "--json", "--unit", "mm", "--level", level])
        assert result.exit_code == 0, result.output
        assert json.loads(result.stdout)["free_area_m2"] == pytest.approx(area, rel=0.2)
    assert "plan OG" in AmbiguityMap.open("plan.zarr").dataset.attrs["title"]
