"""The store on the command line: what is said, what is opened, what can be looked after."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from ambinav.cli import app
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.store.map_store import MapStore
from tests.inline import inline_drives
from tests.store.scenes import ROOT, build, python, room
from tests.studies.compare.conftest import SCENARIO, write

PLAN = {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}
BUILDING = ("plan.geojson", "-s", "rplidar-a1", "--spacing", "0.4")
MAP = ("map", *BUILDING, "-o", "out.zarr")
AUDIT = ("audit", *BUILDING, "-o", "report", "--no-aliasing", "--posts", "0")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "cache"))
    (tmp_path / "plan.geojson").write_text(json.dumps(PLAN))
    return tmp_path


def run(*words: str, status: int = 0) -> Result:
    result = CliRunner().invoke(app, words)
    assert result.exit_code == status, result.output
    return result


def store_json(*words: str, status: int = 0):
    return json.loads(run("store", *words, "--json", status=status).stdout)


@pytest.mark.slow
def test_map_and_audit_share_what_they_compute(folder, computes) -> None:
    assert "store" not in run(*MAP).stderr
    first = AmbiguityMap.open("out.zarr").dataset
    stderr = run(*AUDIT, "--save-map", "other.zarr").stderr
    assert stderr.count("note: the map of plan for rplidar-a1 is opened from the store (") == 1
    assert AmbiguityMap.open("other.zarr").dataset.identical(first)
    (folder / "again.geojson").write_text(json.dumps(PLAN))  # the map is kept under another name
    stderr = run("map", "again.geojson", *MAP[2:]).stderr
    assert "note: the map of again for rplidar-a1 is opened from the store (" in stderr
    result = run(*MAP, "--json")
    assert "opened from the store" in result.stderr and json.loads(result.stdout)["cells"] > 0
    assert len(computes) == 1
    assert "store" not in run(*MAP, "--no-store").stderr
    assert len(computes) == 2
    plain = AmbiguityMap.open("out.zarr").dataset
    assert plain.assign_attrs(created="").identical(first.assign_attrs(created=""))


@pytest.mark.slow
def test_it_can_be_switched_off(folder, computes, monkeypatch) -> None:
    monkeypatch.setenv("AMBINAV_CACHE", "")
    for _ in range(2):
        assert "store" not in run(*MAP).stderr
    assert len(computes) == 2 and not (folder / "cache").exists()
    assert "no map is kept: AMBINAV_CACHE is empty" in run("store", "list", status=2).stderr


@pytest.mark.sweep
def test_compare_opens_too(folder, computes) -> None:
    scenario = write(folder, {**SCENARIO, "routes": ["shortest"], "drive": {"runs": 2}})
    words = ("compare", str(scenario), "-j", "1", "-o")
    with inline_drives():
        assert "store" not in run(*words, "one").stderr
        assert "opened from the store" in run(*words, "two").stderr
        assert len(computes) == 1
        run(*words, "three", "--no-store")
    assert len(computes) == 2
    tables = {(folder / name / "table.csv").read_bytes() for name in ("one", "two", "three")}
    assert len(tables) == 1


@pytest.mark.slow
def test_list_and_show(folder) -> None:
    assert store_json("list")["maps"] == []
    assert "0 in " in run("store", "list").stdout
    run(*MAP)
    run(*MAP, "--layers", "fisher")
    found = store_json("list")
    assert found["folder"] == str(folder / "cache" / "ambinav-maps")
    newest, oldest = found["maps"]
    assert newest["layers"] == ["fisher"] and oldest["layers"] == []
    assert found["bytes"] == newest["bytes"] + oldest["bytes"] < found["limit_bytes"]
    amap = AmbiguityMap.open("out.zarr")
    assert newest["cells"] == amap.possible.size and newest["state"] == "current"
    assert newest["parameters"] == json.loads(amap.dataset.attrs["parameters"])
    assert Path(newest["path"]).stat().st_size == newest["bytes"]
    text = run("store", "list").stdout
    assert newest["key"][:8] in text and "rplidar-a1" in text and "2 in " in text
    assert store_json("show", newest["key"][:12]) == newest
    shown = run("store", "show", newest["key"]).stdout
    assert "environment: plan" in shown and "layers: fisher" in shown and newest["path"] in shown
    for begun, words in (("zz", "no map begins so"), ("", "no map begins so")):
        stderr = run("store", "show", begun, status=2).stderr
        assert words in stderr and stderr.count("\n") == 1


@pytest.mark.slow
def test_verify_sets_aside(folder) -> None:
    run(*MAP)
    (one,) = store_json("list")["maps"]
    assert store_json("verify") == {"whole": [one["key"]], "damaged": {}}
    path = Path(one["path"])
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    found = store_json("verify", one["key"][:8], status=3)
    assert found == {"whole": [], "damaged": {one["key"]: "its checksum does not match"}}
    (aside,) = store_json("list")["maps"]
    assert aside["state"] == "damaged" and not path.exists() and "plan" in aside["environment"]
    assert "0 intact, 0 damaged" in run("store", "verify").stdout
    path.write_bytes(content)
    assert "damaged (its checksum does not match), set aside" in run(
        "store", "verify", status=3
    ).stdout.replace("\n", "")


def test_what_is_newer_or_unreadable_is_listed(folder) -> None:
    run(*MAP)
    path = Path(store_json("list")["maps"][0]["path"])
    content = path.read_bytes()
    path.write_bytes(content.replace(b"ambinav-map 1 ", b"ambinav-map 7 ", 1))
    (path.parent / f"{'a' * 32}.map").write_bytes(b"")
    changed = content.replace(b'"environment_source"', b'"envhronment_source"')
    (path.parent / f"{'b' * 32}.map").write_bytes(changed)
    states = {one["key"]: one["state"] for one in store_json("list")["maps"]}
    assert states == {path.stem: "newer format", "a" * 32: "damaged", "b" * 32: "damaged"}
    run("store", "list")
    assert store_json("show", "bbb")["state"] == "damaged"
    assert store_json("verify", status=3)["whole"] == []
    assert store_json("prune", "--all")["left"] == 1 and path.exists()


@pytest.mark.slow
def test_prune(folder) -> None:
    run(*MAP)
    run(*MAP, "--layers", "fisher")
    newest, oldest = store_json("list")["maps"]
    gone = store_json("prune")
    assert (gone["removed"], gone["left"]) == (0, 2)
    gone = store_json("prune", "--limit", f"{newest['bytes']} B")
    assert gone["removed"] == 1 and gone["removed_bytes"] == oldest["bytes"]
    assert [one["key"] for one in store_json("list")["maps"]] == [newest["key"]]
    path = Path(newest["path"])
    other = path.with_name("b" * 32 + ".map")
    digest = MapStore.of_user().path(newest["key"]).read_bytes()
    at = digest.index(b'"code": "') + 9
    other.write_bytes(digest[:at] + b"f" * 64 + digest[at + 64 :])
    assert {one["state"] for one in store_json("list")["maps"]} == {"current", "other code"}
    assert store_json("prune", "--other-code")["removed"] == 1 and not other.exists()
    assert "1 removed" in run("store", "prune", "--all").stdout
    assert store_json("list")["maps"] == []
    stderr = run("store", "prune", "--limit", "lots", status=2).stderr
    assert "--limit: 'lots' is not a size; give e.g. 500 MB or 2 GB." in stderr


@pytest.mark.parametrize("command", ["list", "show", "verify", "prune"])
def test_help_shows_an_example(command) -> None:
    text = run("store", command, "--help").stdout
    assert f"Example: ambinav store {command}" in " ".join(text.split())


PROCESS = """
from tests.store.scenes import build
print(build(True, spacing=0.1).dataset["level"].values.tobytes().hex())
"""


@pytest.mark.slow
def test_two_processes_build_the_same(folder) -> None:
    started = [python(PROCESS) for _ in range(2)]
    try:
        outputs = [process.communicate(timeout=120) for process in started]
    finally:
        for process in started:
            process.kill()
    assert [process.returncode for process in started] == [0, 0], outputs
    wanted = build(False, room(), spacing=0.1).dataset["level"].values.tobytes().hex()
    assert [out.strip() for out, _ in outputs] == [wanted] * 2
    assert len(list((folder / "cache" / "ambinav-maps").glob("*.map"))) == 1


@pytest.mark.sweep
def test_some_kills(tmp_path) -> None:
    """`benchmarks/kill_store.py` with fewer; its report is benchmarks/results/store.md."""
    words = ("--kills", "3", "--seed", "1", "--folder", str(tmp_path / "maps"), "--json")
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "benchmarks" / "kill_store.py"), *words],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=240)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # and the processes that it started
    assert process.returncode == 0, out + err
    outcome = json.loads(out)
    assert outcome["good"] and outcome["kills"] == 3
    assert outcome["taken"]["built"] > 3 and outcome["taken"]["opened"] > 0
