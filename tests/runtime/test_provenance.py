"""Stored results: found again when nothing has changed, and never when something has."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.maps.content_digest import environment_digest
from ambinav.runtime import provenance
from ambinav.runtime.errors import InputWarning
from ambinav.runtime.provenance import STAMP, Provenance, code_digest, digest_of, discard_stale
from tests.forked import ForkServer
from tests.studies.compare.conftest import SCENARIO, write

ROOT = Path(__file__).parents[2]
PLACES = {"ambinav": ".", "ambinav_envs": "envs", "ambinav_planners": "planners"}
UNLISTED = (
    "ambinav/reports/pages.py",
    "ambinav/studies/compare/plans.py",
    "ambinav/geometry/__init__.py",
    "ambinav/sensing/presets/sick-lms111.yaml",
    "ambinav/studies/compare/templates/report.md.j2",
    "envs/ambinav_envs/training/vec.py",
    "planners/ambinav_planners/__init__.py",
)
"""Files that none of the lists named by which results were kept before, or not all of them."""


class Copy:
    """A copy of the three packages, compiled kernels included.

    Attributes:
        folder: Where it lies.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name, place in PLACES.items():
            shutil.copytree(ROOT / place / name, folder / place / name)
        paths = os.pathsep.join(str(folder / place) for place in PLACES.values())
        environment = {**os.environ, "PYTHONPATH": paths, "AMBINAV_CACHE": str(folder / "cache")}
        # They are imported but once: none is edited so that it would do something else.
        names = (
            "ambinav.cli.compare", "ambinav.studies.compare.report", "ambinav_planners.planning",
            "ambinav_envs.leaderboard.store",
        )  # fmt: skip
        self.server = ForkServer(environment, *names, folder=folder)

    def run(self, folder: Path, script: str, *words: str) -> tuple[str, str]:
        """Run a script in a folder; return what it prints, and its errors."""
        (folder / "script.py").write_text(script)
        status, printed, errors = self.server(folder, "script.py", *words)
        assert status == 0, errors
        return printed, errors


PROGRAM = """
from ambinav.cli import main
if __name__ == "__main__":
    main()
"""
KEYS = """
import os, sys
from pathlib import Path
import shapely, ambinav as an
from ambinav.runtime.provenance import code_digest
from ambinav_envs.leaderboard.store import key_of
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.map_building.stored import map_key
room = an.environment_from_shapes([shapely.box(0, 0, 4, 3)])
laser = an.RangeScanner.load("rplidar-a1")
model = AmbiguityModel(radius=0.5, map_std=0.02, tau=1.0)
assert sys.modules["ambinav"].__file__.startswith(sys.argv[1])

def tell():
    code_digest.cache_clear()  # as in a process of its own
    print(code_digest(), key_of({"a": 1}), map_key(room, laser, laser, model, 0.1, None, ()))

tell()
for name in sys.argv[2:]:
    path = Path(sys.argv[1]) / name
    content, time = path.read_bytes(), path.stat().st_mtime_ns
    for written in (content + b"\\n# edited\\n", content):
        path.write_bytes(written)
        os.utime(path, ns=(time, time))
        tell()
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Copy]:
    made = Copy(tmp_path_factory.mktemp("copy"))
    yield made
    made.server.close()


def keys(copy: Copy, *edited: str) -> list[list[str]]:
    """The keys of three results: of the copy, and with each file edited and as it was."""
    printed, _ = copy.run(copy.folder, KEYS, str(copy.folder), *edited)
    return [line.split() for line in printed.splitlines()]


@pytest.mark.slow
def test_any_edited_file_is_another_key(copy: Copy) -> None:
    (before,) = keys(copy)
    assert before[0] == code_digest()
    first, *told = keys(copy, *UNLISTED)
    assert all(restored == before for restored in (first, *told[1::2]))
    for name, after in zip(UNLISTED, told[::2], strict=True):
        assert all(a != b for a, b in zip(before, after, strict=True)), name
    assert len({after[0] for after in told[::2]}) == len(UNLISTED)


@pytest.mark.slow
def test_what_is_no_source_does_not_count(copy: Copy) -> None:
    before = code_digest()
    package = copy.folder / "ambinav"
    path = package / "reports" / "pages.py"
    content = path.read_bytes()
    path.write_bytes(content.replace(b"\n", b"\r\n"))
    (package / "__pycache__").mkdir(exist_ok=True)
    (package / "__pycache__" / "pages.cpython-3.nbi").write_bytes(b"x")
    (package / ".pages.py.swp").write_bytes(b"x")
    (package / "pages.py~").write_bytes(b"x")
    try:
        assert keys(copy)[0][0] == before
        (package / "new.py").write_bytes(b"")
        assert keys(copy)[0][0] != before
    finally:
        path.write_bytes(content)
        for name in (".pages.py.swp", "pages.py~", "new.py"):
            (package / name).unlink(missing_ok=True)


@pytest.mark.sweep
def test_a_comparison_is_made_again_by_other_code(copy: Copy, tmp_path: Path) -> None:
    scenario = write(tmp_path, {**SCENARIO, "drive": {"runs": 2, "open_loop": True}})

    def compare() -> str:
        """Compare the routes; return what is said of it."""
        words = ("compare", str(scenario), "-o", "out", "-j", "1")
        return copy.run(tmp_path, PROGRAM, *words)[1]

    def kept() -> dict[str, int]:
        work = tmp_path / "out" / "work"
        names = [*work.glob("*.npz"), *work.glob("map-*.zarr")]
        return {path.name: path.stat().st_mtime_ns for path in names}

    assert "discarded" not in compare()
    first, table = kept(), (tmp_path / "out" / "table.csv").read_bytes()
    assert len(first) == 3
    assert "discarded" not in compare()
    assert kept() == first
    # Another building under the same name, of the same size and time.
    building = tmp_path / "flat.geojson"
    time, text = building.stat().st_mtime_ns, building.read_text()
    building.write_text(text.replace("1.2", "1.3"))
    os.utime(building, ns=(time, time))
    assert "discarded" not in compare()
    assert len(set(kept()) - set(first)) == 3
    building.write_text(text)
    os.utime(building, ns=(time, time))
    path = copy.folder / "ambinav" / "studies" / "compare" / "plans.py"
    content = path.read_bytes()
    path.write_bytes(content + b"# edited\n")
    try:
        stderr = compare()
    finally:
        path.write_bytes(content)
    assert (
        "note: " in stderr and "computed by other code (ambinav" in stderr and "discarded" in stderr
    )
    assert len(kept()) == 3 and not set(kept()) & set(first)
    assert (tmp_path / "out" / "table.csv").read_bytes() == table


def test_the_content_of_a_map_counts(tmp_path: Path) -> None:
    building = ROOT / "configs" / "demo.geojson"
    one = load_environment(building)
    shutil.copy(building, tmp_path / "other.geojson")
    assert environment_digest(load_environment(tmp_path / "other.geojson")) == environment_digest(
        one
    )

    def changed(**parts: object) -> str:
        whole = {"segments": one.segments, "free": one.free, "checksum": one.checksum}
        return environment_digest(Environment(**(whole | parts)))  # type: ignore[arg-type]

    xy = one.segments.xy.copy()
    xy[0, 0] = np.nextafter(xy[0, 0], np.inf)
    digests = {
        changed(),
        changed(segments=replace(one.segments, xy=xy)),
        changed(segments=replace(one.segments, kind=1 - one.segments.kind)),
        changed(free=shapely.set_precision(one.free, 1e-9).buffer(-1e-8, join_style="mitre")),
        changed(resolution=0.05),
    }
    assert len(digests) == 5
    same = changed(name="other", notes=("repaired",), source=tmp_path, checksum="of its file")
    assert same == changed()


@dataclass(frozen=True)
class One:
    a: int = 1


@dataclass(frozen=True)
class Other:
    a: int = 1


def test_no_two_values_have_one_digest() -> None:
    square = shapely.box(0, 0, 1, 1)
    values = [
        None, True, 1, 1.0, "1", b"1", Path("1"), 0, 0.0, -0.0, float("nan"), "", (), {}, [[]],
        [1, 2], [[1], 2], [1, [2]], ["12"], ["1", "2"], {"a": 1}, {"a": "1"}, {"b": 1},
        {"a": {"b": 1}}, [{"a": 1}], One(), Other(), One(2), square, square.buffer(1),
        np.array([1, 2]), np.array([1.0, 2.0]), np.array([[1, 2]]), np.array([1, 2], dtype=np.int8),
        np.zeros(0), np.zeros((0, 2)),
    ]  # fmt: skip
    assert len({digest_of(value) for value in values}) == len(values)
    assert len({digest_of(1, 2), digest_of([1, 2]), digest_of(1, [2]), digest_of()}) == 4
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})
    assert digest_of((1, 2)) == digest_of([1, 2]) and digest_of(np.float64(1)) == digest_of(1.0)
    for strange in (object(), {1, 2}, np.array([None]), lambda: 0):
        with pytest.raises(TypeError, match="there is no digest of"):
            digest_of(strange)


def test_other_libraries_count_where_they_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    known = provenance.library_version
    with_torch, without = Provenance.here("torch"), Provenance.here()
    assert without.difference(with_torch) is None and with_torch.difference(without) is None
    monkeypatch.setattr(
        provenance, "library_version", lambda name: "0.1" if name == "torch" else known(name)
    )
    assert Provenance.here().digest == without.digest
    assert Provenance.here("torch").digest != with_torch.digest
    difference = Provenance.here("torch").difference(with_torch)
    assert (
        difference is not None
        and "other libraries: torch" in difference
        and "(here 0.1)" in difference
    )


def test_a_folder_of_other_code_is_emptied_and_says_so(tmp_path: Path) -> None:
    here = Provenance("1.0", "a" * 64, {"numpy": "2"})
    discard_stale(tmp_path, here)
    (tmp_path / "result.npz").write_text("a")
    (tmp_path / "map.zarr").mkdir()
    (tmp_path / "lock").write_text("")
    discard_stale(tmp_path, here, kept=("lock",))
    # Who uses more libraries besides makes nothing stale.
    discard_stale(tmp_path, replace(here, libraries={"torch": "1"}), kept=("lock",))
    assert len(list(tmp_path.iterdir())) == 4
    with pytest.warns(InputWarning, match="other libraries: torch 1 .here 2.*discarded"):
        discard_stale(tmp_path, replace(here, libraries={"torch": "2"}), kept=("lock",))
    assert {path.name for path in tmp_path.iterdir()} == {STAMP, "lock"}
    (tmp_path / "result.npz").write_text("b")
    with pytest.warns(InputWarning, match=r"computed by other code \(ambinav 1.0, sources aaaa"):
        discard_stale(tmp_path, replace(here, code="b" * 64), kept=("lock",))
    assert not (tmp_path / "result.npz").exists()
    assert json.loads((tmp_path / STAMP).read_text())["code"] == "b" * 64
    for left in ("", "{}", "[]", "no json"):
        (tmp_path / STAMP).write_text(left)
        (tmp_path / "result.npz").write_text("c")
        with pytest.warns(InputWarning, match="left no note of itself"):
            discard_stale(tmp_path, here, kept=("lock",))
        assert not (tmp_path / "result.npz").exists()
