"""Whatever is wrong with the input: one sentence, exit status 2, and nothing written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

from ambinav.cli import app

ROOT = Path(__file__).parents[1]
HEADER: dict[str, object] = {
    "image": "map.pgm",
    "resolution": 0.1,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
ROOM = [[0, 0], [3, 0], [3, 2], [0, 2], [0, 0]]
SCANNER = {
    "name": "short laser",
    "parts": [
        {
            "sensor": {"max_range": 2.0, "std": 0.02, "resolution": 0.01},
            "planar": {"beams": 12, "aperture_deg": 360},
        }
    ],
}
FROM_MAP = ("map", "map.yaml", "-s", "scanner.yaml", "-o", "new/out.zarr", "--spacing", "0.5")
FROM_PLAN = ("audit", "plan.geojson", "-s", "scanner.yaml", "-o", "new/out", "--spacing", "0.5")
CALIBRATE = (
    "calibrate", "sensor", "pairs.csv", "-o", "new/s.yaml", "--max-range", "5", "--resolution"
)  # fmt: skip
Change = Callable[[Path], object]


def pgm(pixels: np.ndarray) -> bytes:
    return b"P5 %d %d 255\n" % pixels.shape[::-1] + pixels.astype(np.uint8).tobytes()


def cells(value: int = 254) -> np.ndarray:
    return np.pad(np.full((20, 30), value, dtype=np.uint8), 1)


def plan(*geometries: object, level: Sequence[object] = (), **members: object) -> str:
    features = [
        {"type": "Feature", "properties": {"level": floor} if level else {}, "geometry": geometry}
        for geometry, floor in zip_longest(geometries, level)
    ]
    return json.dumps({"type": "FeatureCollection", "features": features, **members})


def polygon(ring: list[list[float]]) -> dict[str, object]:
    return {"type": "Polygon", "coordinates": [ring]}


def fill(folder: Path) -> None:
    """A map, a plan, a scanner and measured pairs that are all in order."""
    (folder / "map.yaml").write_text(yaml.safe_dump(HEADER))
    (folder / "map.pgm").write_bytes(pgm(cells()))
    (folder / "plan.geojson").write_text(plan(polygon(ROOM)))
    (folder / "scanner.yaml").write_text(yaml.safe_dump(SCANNER))
    rows = "".join(f"{d / 10},{d / 10 + 0.01}\n" for d in range(1, 41))
    (folder / "pairs.csv").write_text(f"true_range,reading\n{rows}")


def header(**changes: object) -> Change:
    """The map's YAML with some keys changed; those set to ... left out."""
    kept = {key: value for key, value in (HEADER | changes).items() if value is not ...}
    return lambda folder: (folder / "map.yaml").write_text(yaml.safe_dump(kept))


def sensor(**changes: object) -> Change:
    fields = SCANNER["parts"][0]["sensor"] | changes  # type: ignore[index]
    part = SCANNER["parts"][0] | {"sensor": fields}  # type: ignore[index]
    text = yaml.safe_dump(SCANNER | {"parts": [part]})
    return lambda folder: (folder / "scanner.yaml").write_text(text)


def text(name: str, content: str | bytes) -> Change:
    data = content.encode() if isinstance(content, str) else content
    return lambda folder: (folder / name).write_bytes(data)


def png(folder: Path) -> None:
    """A PNG that breaks off in the middle."""
    (folder / "map.yaml").write_text(yaml.safe_dump(HEADER | {"image": "map.png"}))
    noise = np.random.default_rng(1).integers(0, 255, (80, 80), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "map.png")
    data = (folder / "map.png").read_bytes()
    (folder / "map.png").write_bytes(data[: len(data) // 2])


@dataclass(frozen=True)
class Case:
    """A command, what is spoilt before it, and what its one sentence must name."""

    arguments: tuple[str, ...]
    change: Change
    named: tuple[str, ...]


def case(arguments: tuple[str, ...], change: Change, *named: str) -> Case:
    return Case(arguments, change, named)


def nothing(folder: Path) -> None:
    """The input is as it should be; the arguments are not."""


SCENARIO_FILE = text(
    "scenario.yaml",
    "environment: plan.geojson\nscanner: scanner.yaml\n"
    "pairs: [{start: [1, 1], goal: [2, 1]}]\nroutes: [{kind: shortest}]\n",
)


def scanner_option(name: str) -> tuple[str, ...]:
    return (*FROM_PLAN[:3], name, *FROM_PLAN[4:])


CASES = {
    "no such map": case(("map", "no.yaml", *FROM_MAP[2:]), nothing, "no.yaml"),
    "no such plan": case(("audit", "no.geojson", *FROM_PLAN[2:]), nothing, "no.geojson"),
    "a folder for a map": case(("map", "sub.yaml", *FROM_MAP[2:]),
                               lambda f: (f / "sub.yaml").mkdir(), "sub.yaml"),
    "a folder with a map": case(("map", "sub", *FROM_MAP[2:]), lambda f: (f / "sub").mkdir(),
                                "sub", "folder"),
    "yaml broken": case(FROM_MAP, text("map.yaml", "image: [map.pgm\nresolution: :"),
                        "map.yaml", "YAML"),
    "yaml empty": case(FROM_MAP, text("map.yaml", ""), "map.yaml", "empty"),
    "yaml not text": case(FROM_MAP, text("map.yaml", b"\xff\xfe\x00image"), "map.yaml"),
    "yaml a list": case(FROM_MAP, text("map.yaml", "- 1\n- 2\n"), "map.yaml"),
    "key missing": case(FROM_MAP, header(resolution=...), "map.yaml", "resolution", "missing"),
    "key of wrong type": case(FROM_MAP, header(origin="here"), "map.yaml", "origin", "'here'"),
    "yaw in degrees": case(FROM_MAP, header(origin=[0.0, 0.0, 90.0]), "map.yaml", "origin",
                           "radians, not 90 degrees"),
    "image of wrong type": case(FROM_MAP, header(image=5), "map.yaml", "image", "5"),
    "image missing": case(FROM_MAP, lambda f: (f / "map.pgm").unlink(), "map.yaml", "map.pgm"),
    "image truncated": case(FROM_MAP, text("map.pgm", pgm(cells())[:300]), "map.pgm"),
    "png truncated": case(FROM_MAP, png, "map.png"),
    "not an image": case(FROM_MAP, text("map.pgm", "hello"), "map.pgm"),
    "image empty": case(FROM_MAP, text("map.pgm", ""), "map.pgm"),
    "image 0 x 0": case(FROM_MAP, text("map.pgm", "P5 0 0 255\n"), "map.pgm"),
    "resolution 0": case(FROM_MAP, header(resolution=0), "map.yaml", "resolution", "0"),
    "resolution negative": case(FROM_MAP, header(resolution=-0.05), "resolution", "-0.05"),
    "resolution nan": case(FROM_MAP, header(resolution=float("nan")), "resolution", "nan"),
    "thresholds swapped": case(FROM_MAP, header(free_thresh=0.65, occupied_thresh=0.196),
                               "map.yaml", "free_thresh", "occupied_thresh", "0.65", "0.196"),
    "no free cell": case(FROM_MAP, text("map.pgm", pgm(cells(0))), "map.pgm", "free"),
    "geojson broken": case(FROM_PLAN, text("plan.geojson", '{"type": '), "plan.geojson", "JSON"),
    "geojson empty": case(FROM_PLAN, text("plan.geojson", ""), "plan.geojson"),
    "geojson without feature": case(FROM_PLAN, text("plan.geojson", plan()), "plan.geojson"),
    "geojson without geometry": case(FROM_PLAN, text("plan.geojson", plan(None)),
                                     "plan.geojson", "feature 1", "geometry"),
    "geojson with nan": case(
        FROM_PLAN, text("plan.geojson", plan(polygon([[0, 0], [float("nan"), 0], *ROOM[2:]]))),
        "plan.geojson", "feature 1", "nan"),
    "geojson points only": case(
        FROM_PLAN, text("plan.geojson", plan({"type": "Point", "coordinates": [1, 2]})),
        "plan.geojson"),
    "unknown preset": case(scanner_option("hokuyo-urg-04"), nothing,
                           "hokuyo-urg-04", "hokuyo-urg-04lx"),
    "no such scanner": case(scanner_option("my.yaml"), nothing, "my.yaml"),
    "scanner empty": case(FROM_PLAN, text("scanner.yaml", ""), "scanner.yaml", "empty"),
    "scanner with a typing error": case(FROM_PLAN, sensor(max_rnge=3.0), "scanner.yaml",
                                        "max_rnge", "max_range"),
    "max range below min": case(FROM_PLAN, sensor(min_range=3.0), "scanner.yaml", "max_range",
                                "min_range", "3", "2"),
    "max range at min": case(FROM_PLAN, sensor(min_range=2.0), "max_range", "min_range"),
    "std negative": case(FROM_PLAN, sensor(std=-0.1), "scanner.yaml", "std", "-0.1"),
    "sensor resolution 0": case(FROM_PLAN, sensor(resolution=0), "scanner.yaml", "resolution"),
    "std a word": case(FROM_PLAN, sensor(std="small"), "scanner.yaml", "std", "small"),
    "pairs with text": case((*CALIBRATE, "0.01"),
                            text("pairs.csv", "true_range,reading\n1,1.01\n2,two\n3,3.01\n"),
                            "pairs.csv", "line 3", "two"),
    "too few pairs": case((*CALIBRATE, "0.01"), text("pairs.csv", "true_range,reading\n1,1.0\n"),
                          "pairs.csv", "1"),
    "pairs empty": case((*CALIBRATE, "0.01"), text("pairs.csv", ""), "pairs.csv"),
    "pairs with nan": case((*CALIBRATE, "0.01"),
                           text("pairs.csv", "true_range,reading\n1,nan\n2,2\n"),
                           "pairs.csv", "line 2", "nan"),
    "calibration with max range below min": case((*CALIBRATE, "0.01", "--min-range", "6"),
                                                 nothing, "--min-range", "6", "5"),
    "a file in place of the folder": case((*FROM_PLAN, "-o", "map.pgm/out"), nothing,
                                          "map.pgm/out", "is a file"),
    "a file in place of the output": case((*FROM_MAP, "-o", "map.pgm"), nothing, "map.pgm",
                                          "is a file"),
    "a map called as another kind of file": case((*FROM_MAP, "-o", "out.npz"), nothing, "out.npz",
                                                 "ends in .zarr"),
    "a plan in degrees": case((*FROM_PLAN, "-o", "out.zarr"), lambda f: text(
                                  "plan.geojson", plan(polygon([[8.5, 47.37], [8.5004, 47.37],
                                                       [8.5004, 47.3703], [8.5, 47.37]])))(f),
                              "plan.geojson", "0.0004 by 0.0003 m", "degrees"),
    "a plan in degrees by its name": case(
        FROM_PLAN, text("plan.geojson", plan(polygon(ROOM), crs={
            "type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::4326"}})),
        "plan.geojson", "EPSG::4326", "degrees", "project"),
    "a plan in millimetres": case(
        FROM_PLAN, text("plan.geojson", plan(polygon([[1000 * v for v in p] for p in ROOM]))),
        "plan.geojson", "3000 by 2000 m", "--unit", "mm"),
    "no such unit": case((*FROM_PLAN, "--unit", "feet"), nothing, "plan.geojson", "'feet'", "mm"),
    "several levels": case(
        FROM_PLAN, text("plan.geojson", plan(polygon(ROOM), polygon(ROOM), level=["EG", "OG"])),
        "plan.geojson", "2 levels (EG, OG)", "--level"),
    "no such level": case(
        (*FROM_PLAN, "--level", "OK"),
        text("plan.geojson", plan(polygon(ROOM), polygon(ROOM), level=["EG", "OG"])),
        "plan.geojson", "'OK'", "OG"),
    "a level of a plan without": case((*FROM_PLAN, "--level", "EG"), nothing, "plan.geojson",
                                      "'EG'", "leave it out"),
    "a level of an occupancy map": case((*FROM_MAP, "--level", "EG"), nothing, "map.yaml",
                                        "level", "leave it out"),
    "a unit without a plan": case(("benchmark", "--unit", "mm"), nothing, "--unit", "--map"),
    "a map's image": case(("map", "map.pgm", *FROM_MAP[2:]), nothing, "map.pgm", "map.yaml"),
    "a map's image of another name": case(
        ("map", "map.pgm", *FROM_MAP[2:]), lambda f: (f / "map.yaml").rename(f / "other.yaml"),
        "map.pgm", "give other.yaml"),
    "an image alone": case(("map", "map.pgm", *FROM_MAP[2:]), lambda f: (f / "map.yaml").unlink(),
                           "map.pgm", "write map.yaml", "resolution"),
    "no such image": case(("map", "no.png", *FROM_MAP[2:]), nothing, "no.png", ".yaml"),
    "a scenario for a map": case(("audit", "scenario.yaml", *FROM_PLAN[2:]), SCENARIO_FILE,
                                 "scenario.yaml", "a scenario", "`ambinav compare`"),
    "a scenario for a scanner": case(scanner_option("scenario.yaml"), SCENARIO_FILE,
                                     "scenario.yaml", "a scenario", "`ambinav compare`"),
    "a scanner for a map": case(("audit", "scanner.yaml", *FROM_PLAN[2:]), nothing,
                                "scanner.yaml", "a scanner, not a map", "--scanner"),
    "a preset for a map": case(("audit", "rplidar-a1", *FROM_PLAN[2:]), nothing,
                               "rplidar-a1", "a scanner preset", "--scanner"),
    "a map for a scanner": case(scanner_option("map.yaml"), nothing, "map.yaml",
                                "an occupancy map, not a scanner", "`ambinav audit`"),
    "an image for a scanner": case(scanner_option("map.pgm"), nothing, "map.pgm",
                                   "not a scanner"),
    "a plan for a scanner": case(scanner_option("plan.geojson"), nothing, "plan.geojson",
                                 "a floor plan, not a scanner"),
    "a sensor for a scanner": case(
        scanner_option("sensor.yaml"),
        text("sensor.yaml", yaml.safe_dump(SCANNER["parts"][0]["sensor"])),
        "sensor.yaml", "a sensor, not a scanner", "parts"),
    "a plan for a scenario": case(("compare", "plan.geojson", "-o", "new"), nothing,
                                  "plan.geojson", "a floor plan, not a scenario"),
    "a scanner for a scenario": case(("compare", "scanner.yaml", "-o", "new"), nothing,
                                     "scanner.yaml", "a scanner, not a scenario"),
    "a scenario for a configuration": case(("train", "scenario.yaml", "-o", "new"), SCENARIO_FILE,
                                           "scenario.yaml", "not a training configuration"),
    "a plan for a stored map": case(
        ("plan", "plan.geojson", "--start", "1", "1", "--goal", "2", "1", "-o", "r.csv"), nothing,
        "plan.geojson", "a floor plan, not an ambiguity map", "`ambinav map`"),
    "a folder that cannot be written": case((*FROM_PLAN, "-o", "/proc/ambinav/out"), nothing,
                                            "/proc"),
    "a map that cannot be written": case((*FROM_MAP, "-o", "/proc/out.zarr"), nothing, "/proc"),
    "a sensor that cannot be written": case((*CALIBRATE, "0.01", "-o", "/proc/s.yaml"), nothing,
                                            "/proc"),
    "a sensor over a folder": case((*CALIBRATE, "0.01", "-o", "."), nothing, "folder"),
    "spacing larger than the building": case((*FROM_MAP, "--spacing", "40"), nothing,
                                             "--spacing", "40", "map.yaml"),
    "spacing larger than the plan": case((*FROM_PLAN, "--spacing", "2.9",
                                          "--ambiguity-radius", "3"),
                                         lambda f: text("plan.geojson", plan(polygon(
                                             [[0.1, 0.1], [2, 0.1], [2, 0.3], [0.1, 0.1]])))(f),
                                         "--spacing", "2.9", "plan.geojson"),
    "radius below spacing": case((*FROM_PLAN, "--spacing", "1"), nothing, "radius", "0.5", "1"),
    "radius of too many cells": case((*FROM_PLAN, "--ambiguity-radius", "1000"), nothing,
                                     "radius is 1000 m", "at most 100 cells, 50 m"),
}  # fmt: skip


def inventory(folder: Path) -> dict[str, bytes]:
    """Names and contents of everything in the folder."""
    found = sorted(folder.rglob("*"))
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else b"" for p in found}


def check_refusal(stderr: str, stdout: str, named: tuple[str, ...]) -> None:
    errors = [line for line in stderr.splitlines() if not line.startswith("ambinav: note: ")]
    assert len(errors) == 1, stderr
    sentence = errors[0].removeprefix("ambinav: error: ")
    assert sentence != errors[0]
    assert sentence.endswith((".", "?"))  # "did you mean ...?"
    assert ";" in sentence, f"no remedy in: {sentence}"
    for word in named:
        assert word in sentence
    assert stdout == ""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    fill(tmp_path)
    return tmp_path


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_bad_input(folder, case):
    case.change(folder)
    before = inventory(folder)
    result = CliRunner().invoke(app, case.arguments)
    assert result.exit_code == 2, result.output
    check_refusal(result.stderr, result.stdout, case.named)
    assert inventory(folder) == before


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [FROM_MAP, FROM_PLAN, (*CALIBRATE, "0.01")])
def test_the_same_input_unspoilt_is_accepted(folder, arguments):
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "error" not in result.stderr
    assert len(list((folder / "new").iterdir())) == 1


@pytest.mark.slow
def test_a_crossing_polygon_is_repaired_and_said_so(folder):
    bow = [[0, 0], [3, 0], [0, 2], [3, 2], [0, 0]]
    (folder / "plan.geojson").write_text(plan(polygon(bow)))
    result = CliRunner().invoke(app, FROM_PLAN)
    assert result.exit_code == 0, result.output
    notes = [line for line in result.stderr.splitlines() if "plan.geojson" in line]
    assert len(notes) == 1
    assert notes[0].startswith("ambinav: note: plan.geojson: feature 1")
    report = json.loads((folder / "new" / "out" / "report.json").read_text())
    assert len(report["environment"]["notes"]) == 1


@pytest.mark.slow(kept=("pairs with text",))
@pytest.mark.parametrize("name", ["unknown preset", "pairs with text"])
def test_bad_input_to_the_program(folder, name):
    case = CASES[name]
    case.change(folder)
    before = inventory(folder)
    result = subprocess.run(
        [sys.executable, "-m", "ambinav.cli", *case.arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert result.returncode == 2
    check_refusal(result.stderr, result.stdout, case.named)
    assert inventory(folder) == before
