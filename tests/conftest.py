"""Fixtures that several parts of the tests share."""

from __future__ import annotations

import functools
import gc
import math
import multiprocessing
import os
import pickle
import random
import shutil
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import numpy.random.bit_generator
import pytest
import typer.main
import typer.testing
from hypothesis import HealthCheck, settings

from tests.forked import ForkServer

# No clock decides: a machine with other work to do is slow, not wrong.
settings.register_profile("tests", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# The gate draws the same examples each time, so that what fails there is what a change has broken;
# whoever runs the tests by hand draws new ones, and so looks further.
settings.register_profile("gate", settings.get_profile("tests"), derandomize=True)
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "tests")
settings.load_profile(PROFILE)

# Tests run side by side: threads that spin while they wait take the time of the others' work.
# This is read when the threads are first started, here and in all that the tests start.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

# Maps are computed, here and in all that the tests start: two that are compared must not be one
# map and its copy. Nor is anything kept in the user's folder. Tests of what is kept name a folder.
os.environ["AMBINAV_CACHE"] = ""

# Each of the processes that tests start would import for two seconds what is imported there once.
multiprocessing.set_forkserver_preload(["tests.workers_at_hand"])

# Modules stay until the end: to look for garbage among them takes a tenth of the collection.
gc.disable()

# `CliRunner` would make all commands anew in each of a thousand calls, which takes 50 ms each time.
typer.testing._get_command = functools.cache(typer.main.get_command)

# A shell's background jobs ignore interrupts, and so would all that the tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


NO_DATA = "AMBINAV_DATA is not set"
ROOT = Path(__file__).parents[1]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests that read the recorded maps and logs, and the cases of a sweep that are not kept;
    sort the longest first, so that at the end no worker is left alone with one.
    """
    missing = set()
    for item in items:
        if "data_dir" in getattr(item, "fixturenames", ()):
            item.add_marker("data_dir")
        if kept := _slow(item, "kept", ()):
            missing |= {(item.originalname, name) for name in kept}
    for item in items:
        if kept := _slow(item, "kept", ()):
            missing.discard((item.originalname, item.callspec.id))
            if item.callspec.id not in kept:
                item.add_marker("sweep")
    if missing and not any("::" in name for name in config.args):
        raise pytest.UsageError(f"slow(kept=...) names cases that are not there: {missing}")
    items.sort(key=lambda item: -_slow(item, "minutes", 0.0))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """In the gate, generators without a seed too draw the same in each run of a test."""
    if PROFILE == "gate":
        numpy.random.bit_generator.randbits = random.Random(item.nodeid).getrandbits


def pytest_collection_finish() -> None:
    """From here on look for garbage, but not among what all tests share."""
    gc.freeze()
    gc.enable()


def _slow(item: pytest.Item, name: str, default: Any) -> Any:
    """Return an argument of the mark `slow`, or the default where there is none."""
    mark = item.get_closest_marker("slow")
    return mark.kwargs.get(name, default) if mark else default


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Where there are no recorded maps and logs, say how many tests of which files did not run."""
    skipped = terminalreporter.stats.get("skipped", ())
    files = Counter(
        report.nodeid.partition("::")[0] for report in skipped if NO_DATA in str(report.longrepr)
    )
    if files:
        terminalreporter.section(f"{NO_DATA}: {files.total()} skipped")
        for name, count in sorted(files.items()):
            terminalreporter.line(f"{count:4} {name}")


@pytest.fixture
def coarse_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw a quarter of the dots, in less than half of the time."""
    from ambinav.plotting import canvas

    monkeypatch.setattr(canvas, "DPI", canvas.DPI // 2)


@pytest.fixture
def dask_forks() -> Iterator[None]:
    """Let the workers of a cluster be copies of a process too."""
    dask = pytest.importorskip("dask")
    pytest.importorskip("distributed")  # first, as it sets defaults
    forkserver.ensure_running()  # before Dask sets modules of its own to preload

    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        yield


@pytest.fixture
def computes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the maps that are computed."""
    from ambinav.map_building import build as build_module

    calls: list[int] = []
    compute = build_module._compute

    def counted(*arguments):
        calls.append(1)
        return compute(*arguments)

    monkeypatch.setattr(build_module, "_compute", counted)
    return calls


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of recorded maps and logs; without AMBINAV_DATA the test is skipped.

    If the variable is set, a file that is missing there fails the test.
    """
    name = os.environ.get("AMBINAV_DATA")
    if not name:
        pytest.skip(NO_DATA)
    folder = Path(name)
    assert folder.is_dir(), f"AMBINAV_DATA names {folder}, which is not a folder"
    return folder


@pytest.fixture(scope="session")
def plan_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stored map: a room with a corridor and a door to unknown space, and a room apart."""
    import shapely

    import ambinav as an

    floor = [(0, 0), (3, 0), (3, 1), (11, 1), (11, 2.5), (3, 2.5), (3, 3), (0, 3)]
    environment = an.environment_from_shapes(
        [shapely.Polygon(floor), shapely.box(13, 0, 15, 3)],
        openings=[shapely.LineString([(0, 1), (0, 2)])],
    )
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=36, aperture=math.tau
    )
    path = tmp_path_factory.mktemp("plan") / "map.zarr"
    an.build_map(environment, scanner, spacing=0.2).save(path)
    return path


@pytest.fixture
def plan_folder(plan_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with that map and a file that is none of ours."""
    shutil.copytree(plan_map, tmp_path / "map.zarr")
    (tmp_path / "notes.txt").write_text("not ours")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def planner_copies() -> Iterator[Callable[..., tuple[int, str, str]]]:
    """Runs scripts in copies of one process, where OMPL has drawn no numbers yet."""
    servers: list[ForkServer] = []

    def run(folder: Path, script: str, *arguments: str) -> tuple[int, str, str]:
        if not servers:
            paths = (str(ROOT / name) for name in ("", "planners"))
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
            modules = ("ambinav_planners.flight", "ompl.geometric", "tests.kernels_at_hand")
            servers.append(ForkServer(environment, *modules))
        return servers[0](folder, script, *arguments)

    yield run
    for server in servers:
        server.close()


@pytest.fixture(scope="session")
def seeded_copies(
    planner_copies: Callable[..., tuple[int, str, str]], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[bytes], Any]:
    """Answers of seeded plans from such copies."""
    script = (
        "import pickle\nfrom pathlib import Path\nfrom ambinav_planners.seeded import _called\n"
        "Path('answer').write_bytes(pickle.dumps(_called(Path('task').read_bytes())))\n"
    )

    def answer_of(task: bytes) -> Any:
        folder = tmp_path_factory.mktemp("seeded")
        (folder / "script.py").write_text(script)
        (folder / "task").write_bytes(task)
        status, _, errors = planner_copies(folder, "script.py")
        assert status == 0, errors
        return pickle.loads((folder / "answer").read_bytes())

    return answer_of


@pytest.fixture
def forked_plans(
    seeded_copies: Callable[[bytes], Any], monkeypatch: pytest.MonkeyPatch
) -> Callable[[bytes], Any]:
    """Let seeded plans start no interpreters, each of which takes two seconds."""
    monkeypatch.setattr("ambinav_planners.seeded._answer_of", seeded_copies)
    return seeded_copies


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A headless browser; ended with the module, since it keeps an event loop in this thread."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    names = ("chromium", "chromium-browser", "google-chrome")
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None:
        pytest.skip("there is no chromium on this machine")
    flags = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    with playwright.sync_playwright() as drivers:
        opened = drivers.chromium.launch(executable_path=path, args=flags)
        yield opened
        opened.close()
