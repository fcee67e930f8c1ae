"""Paths by the definition of nav_msgs/Path; routes and drives in their own formats."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import ambinav as an
from ambinav.export.formats.cdr import definition
from ambinav.export.formats.exporting import export_map
from ambinav.export.options import ExportOptions, MapExport
from ambinav.export.registry import EXPORTERS, Exporter
from ambinav.logs.drive_table import load_drive
from ambinav.logs.export import load_tum
from ambinav.routes.files import load_route
from ambinav.runtime.errors import InputError

Write = Callable[..., tuple[Path, ...]]


def fields(name: str) -> dict[str, str]:
    """Fields and types of a message, by the text that ROS defines it with."""
    whole = definition(name)
    parts = {name: whole.split("=" * 80)[0]}
    for part in whole.split("=" * 80)[1:]:
        head, _, body = part.strip().partition("\n")
        parts[head.removeprefix("MSG: ")] = body
    return {line.split()[1]: line.split()[0] for line in parts[name].split("\n") if line.strip()}


def check_message(name: str, message: Any) -> None:
    """All fields, no others, each of its type: what `ros2 topic pub` insists on."""
    declared = fields(name)
    assert set(message) == set(declared), name
    for field, kind in declared.items():
        value = message[field]
        if kind.endswith("[]"):
            for one in value:
                check_message(kind[:-2], one)
        elif "/" in kind:
            check_message(kind, value)
        elif kind.startswith("float"):
            assert isinstance(value, float)
        elif "int" in kind:
            assert isinstance(value, int)
        else:
            assert isinstance(value, str)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nav2-path-yaml", "nav2-path-json"])
def test_a_dense_path_with_headings(write: Write, route: Path, name: str) -> None:
    (path,) = write(name, f"path.{name[-4:]}", routes=(route,))
    text = path.read_text()
    message = json.loads(text) if name.endswith("json") else yaml.safe_load(text)
    check_message("nav_msgs/Path", message)
    assert message["header"]["frame_id"] == "map"
    poses = [one["pose"] for one in message["poses"]]
    at = np.array([[one["position"]["x"], one["position"]["y"]] for one in poses])
    step = np.hypot(*np.diff(at, axis=0).T)
    assert step.min() > 0.0
    assert step.max() <= 0.05 + 1e-9
    np.testing.assert_allclose(at[[0, -1]], [[2.0, 1.5], [14.0, 4.0]])
    turned = [2.0 * math.atan2(one["orientation"]["z"], one["orientation"]["w"]) for one in poses]
    course = np.arctan2(*np.diff(at, axis=0).T[::-1])
    np.testing.assert_allclose(turned[:-1], course, atol=1e-6)
    assert turned[-1] == pytest.approx(turned[-2])


def test_a_longer_step(write: Write, route: Path) -> None:
    (path,) = write("nav2-path-json", "path.json", routes=(route,), step=0.5)
    assert 26 <= len(json.loads(path.read_text())["poses"]) <= 30


def test_routes_in_their_own_formats(write: Write, route: Path) -> None:
    for kind, name in (("route-geojson", "r.geojson"), ("route-json", "r.json")):
        (path,) = write(kind, name, routes=(route,))
        np.testing.assert_array_equal(load_route(path).poses, load_route(route).poses)


def test_drives_in_their_own_formats(write: Write, drive: Path, tmp_path: Path) -> None:
    files = write("drive-tum", "out", drives=(drive,))
    assert sorted(path.name for path in files) == ["estimate.tum", "odometry.tum", "truth.tum"]
    time, truth = load_tum(tmp_path / "out" / "truth.tum")
    loaded = load_drive(drive)
    np.testing.assert_allclose(time, loaded.time)
    np.testing.assert_allclose(truth, loaded.tracks["truth"], atol=1e-9)
    (table,) = write("drive-csv", "again", drives=(drive,))
    assert table.read_text() == drive.read_text()
    with pytest.raises(InputError, match="holds the readings of a scanner"):
        write("drive-carmen", "log", drives=(drive,))
    assert not (tmp_path / "log").exists()


def test_a_drive_into_the_working_folder(
    amap: an.AmbiguityMap, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ExportOptions(drives=(drive,))
    (table,) = export_map(amap, "drive-csv", ".", options)
    assert table == Path("drive.csv")
    assert table.read_text() == drive.read_text()


def test_a_route_of_another_building(write: Write, route: Path, tmp_path: Path) -> None:
    from ambinav.geometry.motion.steering import Steering
    from ambinav.routes.evaluate import evaluate_route
    from ambinav.routes.files import save_route

    large = an.environment_from_shapes([[(0, 0), (60, 0), (60, 10), (0, 10)]])
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=8, aperture=6.28
    )
    service = an.AmbiguityService(an.build_map(large, scanner, spacing=0.5))
    for poses, message in (
        ([(2.0, 1.5, 0.0), (50.0, 1.5, 0.0)], r"pose 1 at \(50, 1\.5\) is outside of the map"),
        ([(2.0, 1.5, 0.0), (7.0, 4.0, 0.0)], r"pose 1 at \(7, 4\) is not on the free floor"),
    ):
        found = evaluate_route(service, poses, Steering("r2"), planner="test")
        save_route(found, tmp_path / "far.csv")
        with pytest.raises(InputError, match=message):
            write("nav2-path-json", "path.json", routes=(tmp_path / "far.csv",))
        assert not (tmp_path / "path.json").exists()


def test_a_drive_that_leaves_the_map(write: Write, tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("0 2 1.5 0 0 0 0 1\n1 99 1.5 0 0 0 0 1\n")
    with pytest.raises(InputError, match=r"t\.tum: pose 1 at \(99, 1\.5\) is outside of the map"):
        write("mcap", "m.mcap", drives=(tmp_path / "t.tum",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the column time is missing"),
        ("time,x\n", "the column updated is missing"),
        ("{head}\n", "there is no sample in it"),
        ("{head}\n1,2\n", "line 2 is not 19 numbers"),
        ("{head}\n{row}\n{row}\n", "line 3: time does not go forward"),
        ("{head}\n{nan}\n", "line 2 has a value that is not finite"),
    ],
)
def test_tables_that_are_no_drive(drive: Path, tmp_path: Path, text: str, message: str) -> None:
    head, row, *_ = drive.read_text().splitlines()
    nan = ",".join(["nan", *row.split(",")[1:]])
    (tmp_path / "bad.csv").write_text(text.format(head=head, row=row, nan=nan))
    count = len(head.split(","))
    with pytest.raises(InputError, match=message.replace("19", str(count))):
        load_drive(tmp_path / "bad.csv")


def test_an_exporter_of_somebody_else(
    write: Write, monkeypatch: pytest.MonkeyPatch, route: Path
) -> None:
    """Of a map, and of a route, through the same command."""

    def of_map(export: MapExport, path: Path) -> tuple[Path, ...]:
        path.write_text(f"{export.amap.spacing:g} {export.options.layer}")
        return (path,)

    def of_route(one: Any, path: Path) -> tuple[Path, ...]:
        path.write_text(f"{one.length:.2f}")
        return (path,)

    monkeypatch.setattr(EXPORTERS, "_registered", {})
    uses = frozenset({"layer"})
    EXPORTERS.register(
        Exporter(
            subject="map", format="cell", title="", write=of_map, suffixes=(".txt",), uses=uses
        )
    )
    EXPORTERS.register(Exporter(subject="route", format="len", title="", write=of_route))
    assert write("cell", "a.txt", layer="level")[0].read_text() == "0.2 level"
    assert write("route-len", "a.len", routes=(route,))[0].read_text() == "12.72"
    with pytest.raises(InputError, match=r"--seed: cell does not look at it.*--layer"):
        write("cell", "b.txt", seed=1)
