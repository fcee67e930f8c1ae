"""`ambinav export` as a user meets it: files, JSON, and what it says to bad input."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.export.formats.exporting import export_map
from ambinav.export.options import ExportOptions
from ambinav.export.registry import EXPORTERS
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError

ENDS = ("--start", "1", "1", "--goal", "10", "2")


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


def files(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


def test_files_and_json(runner: CliRunner, plan_folder: Path) -> None:
    command = ("export", "map.zarr", "--to", "nav2-speed", "-o", "new/mask.yaml")
    result = runner.invoke(app, [*command, "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert (document["kind"], document["map"]) == ("nav2-speed", "map.zarr")
    ends = (".yaml", ".pgm", "_params.yaml", "_launch.py")
    names = [f"new/mask{end}" for end in ends]
    assert [file["path"] for file in document["files"]] == names
    assert all(Path(file["path"]).stat().st_size == file["bytes"] for file in document["files"])
    assert files(plan_folder) == {"map.zarr", "notes.txt", "new"}
    assert files(plan_folder / "new") == {f"mask{end}" for end in ends}


@pytest.mark.slow
def test_a_route_becomes_a_path(runner: CliRunner, plan_folder: Path) -> None:
    assert runner.invoke(app, ["plan", "map.zarr", *ENDS, "-o", "route.csv"]).exit_code == 0
    path = ("export", "map.zarr", "--to", "nav2-path-yaml", "--route", "route.csv", "-o")
    result = runner.invoke(app, [*path, "path.yaml"])
    assert result.exit_code == 0, result.output
    assert "nav2-path-yaml: path.yaml" in result.stdout


def test_the_list_names_every_kind(runner: CliRunner) -> None:
    result = runner.invoke(app, ["export", "--list-kinds"])
    assert result.exit_code == 0
    listed = [line.split()[0] for line in result.stdout.splitlines()]
    assert listed == list(EXPORTERS.names())
    for name in listed:
        entry = EXPORTERS.get(name)
        if entry.subject == "map":
            assert entry.title
            assert entry.reader
            assert entry.suffixes


def test_help_has_an_example(runner: CliRunner) -> None:
    result = runner.invoke(app, ["export", "--help"])
    assert "Example" in result.stdout
    assert "--to nav2-speed" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "nav2-keepuot", "-o", "m.yaml"), "'nav2-keepuot'; did you mean nav2-keepout"),
        (("--to", "mqap", "-o", "m.mcap"), "there is no exporter 'mqap'"),
        (("--to", "nav2-speed", "-o", "m.png"), "nav2-speed writes a file that ends in .yaml"),
        (
            ("--to", "nav2-speed", "-o", "m.yaml", "--layer", "levle"),
            "the map has no layer 'levle'",
        ),
        (("--to", "geotiff", "-o", "m.tif", "--layer", "fisher"), "the map has no layer 'fisher'"),
        (
            ("--to", "nav2-speed", "-o", "m.yaml", "--route", "r.csv"),
            "--route: nav2-speed does not",
        ),
        (("--to", "npz", "-o", "m.npz", "--layer", "level"), "--layer: npz does not look at it"),
        (("--to", "nav2-path-json", "-o", "m.json"), "--route is given 0 times"),
        (("--to", "nav2-path-json", "-o", "m.json", "--route", "no.csv"), "no.csv: "),
        (("--to", "nav2-keepout", "-o", "m.yaml", "--zone", "opne"), "'opne' is not a zone"),
        (
            ("--to", "nav2-keepout", "-o", "m.yaml", "--zone", "open", "--threshold", "0.5"),
            "give one",
        ),
        (
            ("--to", "nav2-keepout", "-o", "m.yaml", "--layer", "level"),
            "--layer is for --threshold",
        ),
        (("--to", "nav2-speed", "-o", "m.yaml", "--slowest", "120"), "give a number from 0 to 100"),
        (("--to", "nav2-speed", "-o", "m.yaml", "--slowest", "0.3"), "give percent, e.g. 30"),
        (
            ("--to", "nav2-speed", "-o", "m.yaml", "--max-speed", "nan"),
            "--max-speed is nan; give a finite",
        ),
        (("--to", "nav2-speed", "-o", "m.yaml", "--layer", "clearance"), "a mask needs 0 to 1"),
        (("--to", "map-server", "-o", "m.yaml", "--resolution", "0"), "0 is not above zero"),
        (("--to", "map-server", "-o", "m.yaml", "--resolution", "0.0001"), "give a larger one"),
        (("--to", "zones-autoware", "-o", "m.geojson"), "radius is 0.5 m"),
        (("--to", "nav2-route-graph", "-o", "m.geojson", "--seed", "-1"), "--seed: -1"),
        (("--to", "nav2-route-graph", "-o", "m.geojson", "--milestones", "1"), "give 2 or more"),
        (("--to", "npz", "-o", "notes.txt/m.npz"), "notes.txt is a file, not a folder"),
        (("--to", "drive-tum", "-o", "out"), "--drive is given 0 times"),
        (
            ("--to", "drive-tum", "-o", "out", "--drive", "notes.txt"),
            "this is not a drive of ambinav",
        ),
    ],
)
def test_bad_input(
    runner: CliRunner, plan_folder: Path, arguments: tuple[str, ...], message: str
) -> None:
    result = runner.invoke(app, ["export", "map.zarr", *arguments])
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert files(plan_folder) == {"map.zarr", "notes.txt"}


def test_not_a_map(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(app, ["export", "notes.txt", "--to", "npz", "-o", "m.npz"])
    assert result.exit_code == 2
    assert "notes.txt: not an ambiguity map" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("there", ["mask.yaml", "mask.pgm", "mask_params.yaml"])
def test_what_is_there_is_kept(runner: CliRunner, plan_folder: Path, there: str) -> None:
    (plan_folder / there).write_text("mine")
    command = ["export", "map.zarr", "--to", "nav2-keepout", "-o", "mask.yaml"]
    result = runner.invoke(app, command)
    assert result.exit_code == 2
    assert f"{there}: this is there already" in result.stderr
    assert (plan_folder / there).read_text() == "mine"
    assert files(plan_folder) == {"map.zarr", "notes.txt", there}
    result = runner.invoke(app, [*command, "--overwrite"])
    assert result.exit_code == 0, result.output
    assert (plan_folder / there).read_bytes() != b"mine"


def test_links_stay(plan_folder: Path) -> None:
    """Of every other output a link is followed too."""
    (plan_folder / "real").mkdir()
    link, target = plan_folder / "map.npz", plan_folder / "real" / "floor.npz"
    link.symlink_to(target)
    amap = AmbiguityMap.open(plan_folder / "map.zarr")
    for overwrite in (False, True):
        export_map(amap, "npz", link, overwrite=overwrite)
        assert link.is_symlink() and np.load(target)["level"].size
    assert files(target.parent) == {"floor.npz"}


def test_no_folder_is_replaced(runner: CliRunner, plan_folder: Path) -> None:
    """Neither for the file that names the others, nor for those: all of it stays as it is."""
    (plan_folder / "mask.pgm").write_text("mine")
    (plan_folder / "mask.yaml").mkdir()
    command = ["export", "map.zarr", "--to", "nav2-keepout", "-o", "mask.yaml", "--overwrite"]
    result = runner.invoke(app, command)
    assert result.exit_code == 2
    assert "mask.yaml: this is a folder" in result.stderr
    assert (plan_folder / "mask.pgm").read_text() == "mine"
    assert files(plan_folder) == {"map.zarr", "notes.txt", "mask.pgm", "mask.yaml"}


def test_a_missing_package_is_named(
    runner: CliRunner, plan_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ambinav.runtime import packages

    monkeypatch.setattr(packages, "find_spec", lambda name: None)
    result = runner.invoke(app, ["export", "map.zarr", "--to", "mcap", "-o", "m.mcap"])
    assert result.exit_code == 2
    assert 'mcap needs mcap; run: pip install "ambinav[mcap]"' in result.stderr


def test_a_full_disk_leaves_nothing(
    runner: CliRunner, plan_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ambinav.export.formats.npz.np.savez_compressed", full)
    result = runner.invoke(app, ["export", "map.zarr", "--to", "npz", "-o", "m.npz"])
    assert result.exit_code == 2
    assert "m.npz: it cannot be written (No space left on device)" in result.stderr
    assert files(plan_folder) == {"map.zarr", "notes.txt"}


@pytest.mark.sweep
def test_a_terminated_export_leaves_nothing(plan_folder: Path) -> None:
    """Terminated while it writes: no half a file, no scratch."""
    code = (
        "import time, ambinav.export.formats.npz as npz\n"
        "from ambinav.cli import main\n"
        "save = npz.np.savez_compressed\n"
        "def slow(file, **arrays):\n"
        "    file.write(b'half'); file.flush(); print('writing', flush=True); time.sleep(60)\n"
        "npz.np.savez_compressed = slow\n"
        "main()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, "export", "map.zarr", "--to", "npz", "-o", "m.npz"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=plan_folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        begun = time.monotonic()
        assert process.stdout.readline() == "writing\n"
        assert any(name.startswith(".m.npz.") for name in files(plan_folder))
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
        assert time.monotonic() - begun < 60
    finally:
        process.kill()
        process.wait(timeout=60)
    assert process.returncode != 0
    assert files(plan_folder) == {"map.zarr", "notes.txt"}


def test_numbers_of_numpy_are_options(plan_folder: Path) -> None:
    amap = AmbiguityMap.open(plan_folder / "map.zarr")
    level = float(np.nanquantile(amap.floor("level").values, 0.9))
    masks = []
    for k, threshold in enumerate((level, np.float64(level))):
        export_map(amap, "nav2-keepout", f"m{k}.yaml", ExportOptions(threshold=threshold))
        masks.append(Path(f"m{k}.pgm").read_bytes())
    assert masks[0] == masks[1]
    with pytest.raises(InputError, match="--threshold is 'x'; give a finite number"):
        export_map(amap, "nav2-keepout", "m.yaml", ExportOptions(threshold="x"))  # type: ignore[arg-type]
