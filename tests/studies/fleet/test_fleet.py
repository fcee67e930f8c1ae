"""The results of a fleet are those of single audits, however it is made."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import signal
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import fsspec
import pytest

import ambinav as an
from ambinav.maps.address import Address
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.runtime.errors import InputError
from ambinav.studies.fleet.fleet import Fleet, FleetQueue, run_fleet, units_of
from ambinav.studies.fleet.report import STUDY
from ambinav.studies.fleet.sites import read_sites
from ambinav.studies.fleet.unit import FleetWork
from tests.studies.fleet.conftest import SCANNERS, SETTINGS, audited, write_room, write_sites

APART = ("runs.parquet", "work/lock")
"""Files that differ from run to run."""


def content(files: dict[str, bytes]) -> dict[str, bytes]:
    """Files without what differs from run to run."""
    kept = {name: text for name, text in files.items() if name not in APART}
    for name, text in kept.items():
        if name.startswith("results/") and name.endswith(".json"):
            plain = json.loads(text)
            del plain["run"]
            kept[name] = json.dumps(plain).encode()
    return kept


def files_in(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@dataclass(frozen=True)
class Undisturbed:
    """Sites, and what one process makes of them in one go."""

    sites: Path
    output: Path
    fleet: Fleet

    @property
    def content(self) -> dict[str, bytes]:
        return content(files_in(self.output))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("undisturbed")
    sites = write_sites(folder / "sites")
    return Undisturbed(sites, folder / "out", audited(sites, folder / "out"))


@pytest.mark.slow
def test_figures_are_those_of_maps_built_apart(undisturbed: Undisturbed) -> None:
    from pyarrow import parquet

    sites, fleet = undisturbed.sites, undisturbed.fleet
    rows = parquet.read_table(undisturbed.output / "figures.parquet").to_pylist()
    names = ("broken", "north/corridor", "room")
    keys = [(site, scanner) for site in names for scanner in sorted(SCANNERS)]
    assert [(row["site"], row["scanner"]) for row in rows] == keys
    for row in rows[:2]:
        assert row["status"] == "failed" and row["bad_m2"] is None and "broken.wkt" in row["error"]
    for row in rows[2:]:
        env = an.load_environment(sites / row["building"])
        scanner = an.RangeScanner.from_preset(row["scanner"])
        amap = an.build_map(env, scanner, spacing=0.5, store=False)
        zone, counted = amap.floor("zone").values, amap.judged.counted
        bad = float((counted & ((zone == CORRIDOR) | (zone == OPEN))).sum()) * 0.25
        assert row["bad_m2"] == pytest.approx(bad) and row["counted_m2"] == counted.sum() * 0.25
        assert row["bad_share"] == pytest.approx(bad / row["counted_m2"], abs=2e-4)
        level = amap.floor("level", "mean").values[counted].mean()
        assert row["mean_level"] == pytest.approx(level, abs=1e-4)
    by_key = {(row["site"], row["scanner"]): row for row in rows}
    assert by_key["north/corridor", "turtlebot3-lds"]["bad_share"] > 0.5
    assert by_key["room", "turtlebot3-lds"]["bad_m2"] == 0.0
    assert fleet.document.figures[0].model_dump() == rows[0]


@pytest.mark.slow
def test_order_and_place_change_no_byte(undisturbed: Undisturbed) -> None:
    units = [*units_of(read_sites(str(undisturbed.sites)), SCANNERS)]
    random.Random(1).shuffle(units)
    system = fsspec.filesystem("memory")
    try:
        run_fleet(units, "memory://fleet-out/a", SETTINGS, workers=0)
        root = "/fleet-out/a/"
        files = {
            path.removeprefix(root): system.cat_file(path) for path in system.find("/fleet-out")
        }
        assert content(files) == undisturbed.content
        again = run_fleet(units, "memory://fleet-out/a", SETTINGS, workers=0)
        assert again.made == 2  # the broken ones
    finally:
        system.rm("/fleet-out", recursive=True)


@pytest.mark.slow
def test_only_what_is_missing_changed_or_damaged_is_made(sites: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert audited(sites, out).made == 6
    wanted = content(files_in(out))
    (sites / "broken.wkt").unlink()
    assert audited(sites, out).made == 0
    result = out / "results" / "room" / "rplidar-a1.json"
    text = result.read_text()
    result.write_text(text[: len(text) // 2])
    (out / "results" / "north" / "corridor" / "rplidar-a1.png").unlink()
    (out / "results" / "room" / ".rplidar-a1.json.x8").mkdir()  # what a killed process leaves
    assert audited(sites, out).made == 2
    there = content(files_in(out))
    assert all(wanted[name] == there[name] for name in there if name.startswith("results/"))
    write_room(sites / "room.geojson", 4.0)
    fleet = audited(sites, out)
    assert {done.result.site for done in fleet.results if done.was_made} == {"room"}
    assert not [path for path in out.rglob(".*")]


def test_another_folder_is_refused(sites: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match="not of an earlier fleet audit"):
        audited(sites, tmp_path)
    with (
        STUDY.folder.hold(tmp_path / "out"),
        pytest.raises(InputError, match="another run is at work here"),
    ):
        audited(sites, tmp_path / "out")


def test_a_unit_whose_workers_are_killed_fails_at_the_third(sites: Path, tmp_path: Path) -> None:
    unit = units_of(read_sites(str(sites)), SCANNERS)[-1]
    work = FleetWork(Address.of(tmp_path / "out"), SETTINGS, "")
    queue = FleetQueue(work, deque([unit]), lambda share: None, 1)
    for _ in range(3):
        assert queue.take() is unit
        queue.lost(unit)
    assert queue.take() is None
    (done,) = queue.results.values()
    assert done.result.status == "failed" and "killed again and again" in done.result.error
    assert json.loads((tmp_path / "out" / f"{unit.file}.json").read_text())["status"] == "failed"


@pytest.mark.slow(minutes=0.3)
def test_killed_workers_change_no_byte(undisturbed: Undisturbed, tmp_path: Path) -> None:
    killed: list[int] = []

    def kill(share: float) -> None:
        if len(killed) < 2:
            child = multiprocessing.active_children()[0]
            killed.append(child.pid or 0)
            os.kill(child.pid or 0, signal.SIGKILL)

    units = units_of(read_sites(str(undisturbed.sites)), SCANNERS)
    run_fleet(units, tmp_path / "killed", SETTINGS, workers=2, progress=kill)
    assert len(killed) == 2 and not multiprocessing.active_children()
    assert content(files_in(tmp_path / "killed")) == undisturbed.content


@pytest.mark.slow(minutes=0.3)
@pytest.mark.usefixtures("dask_forks")
def test_a_cluster_writes_the_same_bytes(undisturbed: Undisturbed, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    units = units_of(read_sites(str(undisturbed.sites)), SCANNERS)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        address = cluster.scheduler_address
        fleet = run_fleet(units, tmp_path / "cluster", SETTINGS, scheduler=address)
    assert fleet.made == 6
    assert content(files_in(tmp_path / "cluster")) == undisturbed.content
