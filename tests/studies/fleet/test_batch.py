"""Parts that machines audit apart give the fleet that one machine makes."""

from __future__ import annotations

import errno
import sys
from dataclasses import replace
from pathlib import Path
from typing import IO

import fsspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.fleet.batch import Batch
from ambinav.studies.fleet.fleet import run_batch, run_fleet, units_of
from ambinav.studies.fleet.report import STUDY
from ambinav.studies.fleet.site import Site
from ambinav.studies.fleet.sites import read_sites
from ambinav.studies.fleet.unit import Unit
from tests.studies.fleet.conftest import SCANNERS, SETTINGS, audited
from tests.studies.fleet.test_fleet import content, files_in

LASER = RangeScanner.from_preset("rplidar-a1")


@given(st.permutations([f"{k:02d}" for k in range(13)]), st.integers(1, 16))
def test_every_unit_is_in_one_part(names: list[str], count: int) -> None:
    """Machines agree on the parts, whatever order a listing has; sizes differ by one at most."""
    units = [Unit(Site(name, "", f"{name}.wkt"), "a1", LASER) for name in names]
    parts = [Batch(number, count).of(units) for number in range(1, count + 1)]
    assert sorted(unit.file for part in parts for unit in part) == sorted(u.file for u in units)
    sizes = {len(part) for part in parts}
    assert max(sizes) - min(sizes) <= 1
    both = [replace(unit, label=label) for unit in units for label in ("a1", "s2")]
    for part in (Batch(number, count).of(both) for number in range(1, count + 1)):
        of_one = sum(unit.label == "a1" for unit in part)
        assert abs(len(part) - 2 * of_one) <= 1
    assert [Batch(k + 1, count).of(units[::-1]) for k in range(count)] == parts


@pytest.mark.slow
@pytest.mark.parametrize("place", ["folder", "bucket"])
def test_the_last_command_reads_what_the_parts_made(
    sites: Path, tmp_path: Path, place: str
) -> None:
    audited(sites, tmp_path / "whole")
    wanted = content(files_in(tmp_path / "whole"))
    units = units_of(read_sites(str(sites)), SCANNERS)
    root = "/fleet-parts"
    out = f"memory:/{root}/a" if place == "bucket" else str(tmp_path / "out")
    system = fsspec.filesystem("memory")
    try:
        for number in (4, 1, 2):  # the third never ran
            part = run_batch(units[::-1], out, SETTINGS, Batch(number, 4), workers=0)
            assert len(part) == (2 if number < 3 else 1)
        fleet = run_fleet(units, out, SETTINGS, workers=0)
        remade = {
            (done.result.site, done.result.scanner) for done in fleet.results if done.was_made
        }
        third = {(unit.site.name, unit.label) for unit in Batch(3, 4).of(units)}
        assert remade == third | {("broken", scanner) for scanner in SCANNERS}
        if place == "bucket":
            names = [path for path in system.find(root) if path.startswith(f"{root}/a/")]
            assert len(names) == len(system.find(root))  # no claim is left
            files = {name.removeprefix(f"{root}/a/"): system.cat_file(name) for name in names}
        else:
            files = files_in(tmp_path / "out")
        assert content(files) == wanted
    finally:
        if place == "bucket":
            system.rm(root, recursive=True)


def test_parts_work_beside_each_other_but_not_beside_the_whole(sites: Path, tmp_path: Path) -> None:
    units, out = units_of(read_sites(str(sites)), SCANNERS), tmp_path / "out"
    leftover = out / "results" / ".room.x8"
    with STUDY.folder.hold(out, shared=True):
        leftover.mkdir(parents=True)  # what another part is writing
        assert len(run_batch(units, out, SETTINGS, Batch(1, 3), workers=0)) == 2
        assert leftover.exists()
        with pytest.raises(InputError, match="another run is at work here"):
            run_fleet(units, out, SETTINGS, workers=0)
    with STUDY.folder.hold(out), pytest.raises(InputError, match="another run is at work here"):
        run_batch(units, out, SETTINGS, Batch(1, 3), workers=0)
    with pytest.raises(InputError, match=r"--batch: 7/7 is empty, as there are only 6 audits"):
        run_batch(units, out, SETTINGS, Batch(7, 7), workers=0)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_a_file_system_without_locks_holds_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    def flock(file: IO[bytes], kind: int) -> None:
        # NFS takes a shared lock on what may be read only.
        assert file.readable() and file.writable()
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    for shared in (True, False):
        with (
            pytest.warns(InputWarning, match="this file system has no locks"),
            STUDY.folder.hold(tmp_path / "out", shared=shared),
        ):
            assert (tmp_path / "out").is_dir()


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "1/", "-1/3", "a/b", "1/2/3", "\u0661/\u0663"])
def test_what_is_no_part_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"--batch: .* is not a part of a fleet; give its number"):
        Batch.parse(text)
