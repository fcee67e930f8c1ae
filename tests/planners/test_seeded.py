"""The same seed gives the same route: in any process, whatever was planned in it before."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav_planners import seeded
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.seeded import call_seeded
from tests.planners import noisy_planners

ROOT = Path(__file__).parents[2]
START, GOAL = (3.0, 3.0), (12.0, 6.0)
JOBS = {"rrtstar": 600, "bitstar": 1500, "prmstar": 300}
SCRIPT = """
import json, sys
from ambinav import AmbiguityMap
from ambinav_planners import NotFoundError, RoutePlanner
def main(source, jobs):
    robot = RoutePlanner(AmbiguityMap.open(source))
    for name, iterations, seed in json.loads(jobs):
        budget = dict(seconds=float("inf"), iterations=iterations)
        try:
            route = robot.plan((3.0, 3.0), (12.0, 6.0), planner_name=name, seed=seed, **budget)
        except NotFoundError:
            # Without a seed a small roadmap may miss the goal; its random numbers are drawn.
            if seed is not None:
                raise
            continue
        print(json.dumps([name, seed, route.poses.tolist()]))
main(*sys.argv[1:])
"""
PLUG_IN = """
import os
from ambinav_planners.reference import REFERENCE
from dataclasses import replace

def solve(problem, budget):
    print("chatty plans", flush=True)
    os.write(1, b"chatty plans from C\\n")
    return REFERENCE.solve(problem, budget)

PLANNER = replace(REFERENCE, name="chatty", solve=solve, uses_ompl=True)
"""
PosesByJob = dict[tuple[str, int], list[list[float]]]


Jobs = list[tuple[str, int, int | None]]


@pytest.fixture
def stored(demo_map: AmbiguityMap, tmp_path: Path) -> Path:
    path = tmp_path / "demo.zarr"
    demo_map.save(path)
    return path


@pytest.mark.slow
def test_the_same_seed_gives_the_same_route(
    stored: Path, robot: RoutePlanner, planner_copies: Callable[..., tuple[int, str, str]],
    seeded_copies: Callable[[bytes], Any], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """In one test, for the processes take their time."""
    (stored.parent / "script.py").write_text(SCRIPT)

    def in_a_fresh_process(jobs: Jobs) -> PosesByJob:
        """Poses of the routes by planner and seed; what is planned apart is in a real process."""
        status, printed, errors = planner_copies(
            stored.parent, "script.py", str(stored), json.dumps(jobs)
        )
        assert status == 0, errors
        rows = [json.loads(line) for line in printed.splitlines()]
        return {(name, seed): poses for name, seed, poses in rows}

    # The first is seeded in the process, the second apart, and then in a process too.
    first = in_a_fresh_process([(name, JOBS[name], 1) for name in ("rrtstar", "prmstar")])
    assert set(first) == {("rrtstar", 1), ("prmstar", 1)}
    again = in_a_fresh_process([("prmstar", JOBS["prmstar"], 1)])
    assert again == {("prmstar", 1): first["prmstar", 1]}
    # Random numbers drawn before do not matter.
    jobs: Jobs = [("prmstar", JOBS["prmstar"], None), ("rrtstar", JOBS["rrtstar"], 1)]
    assert in_a_fresh_process(jobs)["rrtstar", 1] == first["rrtstar", 1]
    # Another seed gives another route.
    monkeypatch.setattr(seeded, "_answer_of", seeded_copies)

    def poses(name: str, seed: int) -> list[list[float]]:
        budget = {"iterations": JOBS[name], "seconds": math.inf}
        route = robot.plan(START, GOAL, planner_name=name, seed=seed, **budget)
        assert route.seed == seed
        return route.poses.tolist()

    assert poses("rrtstar", 1) == first["rrtstar", 1] != poses("rrtstar", 2)
    assert poses("bitstar", 1) == poses("bitstar", 1)


def test_planners_without_random_numbers_start_no_process(
    robot: RoutePlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("ambinav_planners.seeded.subprocess.Popen")
    routes = [robot.plan(START, GOAL, planner_name="reference", seed=seed) for seed in (1, 2)]
    assert (routes[0].poses == routes[1].poses).all()


def test_calls_without_a_seed_stay_here() -> None:
    assert call_seeded(None, os.getpid) == os.getpid()


@pytest.mark.slow
def test_what_fails_in_a_fresh_process_is_reported() -> None:
    if seeded._process.seed is None:
        call_seeded(7, os.getpid)
    with pytest.raises(RuntimeError, match=r"(?s)failed: .*ValueError"):
        call_seeded(8, math.sqrt, -1.0)


@pytest.fixture
def seeded_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let further calls go to fresh processes, which find the functions of the tests."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), *sys.path]))
    if seeded._process.seed is None:  # else this call would start a process too
        call_seeded(7, os.getpid)


@pytest.mark.sweep
@pytest.mark.usefixtures("seeded_here")
def test_planners_may_print(capfd: pytest.CaptureFixture[str]) -> None:
    value = list(range(1000))
    assert call_seeded(8, noisy_planners.prints, value) == value
    out, err = capfd.readouterr()
    assert out == ""
    assert set(err.splitlines()) == {
        "from python", "to stderr", "from below", "from C", "from a child"
    }  # fmt: skip
    with pytest.raises(InputError, match=r"^goal: it is inside of a wall\.$"):
        call_seeded(8, noisy_planners.refuses)
    assert capfd.readouterr() == ("", "no\n")


@pytest.mark.sweep
@pytest.mark.usefixtures("seeded_here")
def test_a_flood_of_output_does_not_stop_it(capfd: pytest.CaptureFixture[str]) -> None:
    assert call_seeded(8, noisy_planners.floods) == noisy_planners.FLOOD
    assert len(capfd.readouterr().err) == 2 * noisy_planners.FLOOD


@pytest.mark.sweep
@pytest.mark.usefixtures("seeded_here")
def test_a_process_that_dies_is_reported_at_once() -> None:
    begun = time.monotonic()
    with pytest.raises(RuntimeError, match="it ended before it had answered, by SIGKILL"):
        call_seeded(8, noisy_planners.dies, signal.SIGKILL)
    with pytest.raises(RuntimeError, match="it ended before it had answered, by SIGSEGV"):
        call_seeded(8, noisy_planners.dies, signal.SIGSEGV)
    with pytest.raises(RuntimeError, match="it ended before it had answered, with exit status 3"):
        call_seeded(8, noisy_planners.leaves, 3)
    assert time.monotonic() - begun < 90.0  # what it had started lives longer
    with pytest.raises(RuntimeError, match=r"(?s)failed: .*gives_what_cannot_be_sent"):
        call_seeded(8, noisy_planners.gives_what_cannot_be_sent)


@pytest.mark.sweep
@pytest.mark.usefixtures("seeded_here")
def test_nothing_is_read_from_standard_input() -> None:
    assert call_seeded(8, noisy_planners.asks) == ""


@pytest.mark.slow
def test_the_process_ends_with_the_one_that_waits_for_it(tmp_path: Path) -> None:
    file = tmp_path / "pid"
    code = (
        "import os; from ambinav_planners.seeded import call_seeded; "
        "from tests.planners.noisy_planners import waits; "
        f"call_seeded(7, os.getpid); call_seeded(8, waits, {str(file)!r})"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as waiting:
        while not (file.exists() and file.read_text()):
            assert waiting.poll() is None
            time.sleep(0.05)
        waiting.kill()
    pid = int(file.read_text())
    deadline = time.monotonic() + 10.0
    while Path(f"/proc/{pid}/cmdline").exists() and Path(f"/proc/{pid}/cmdline").read_bytes():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.sweep
def test_a_plug_in_that_prints_plans_with_a_seed(
    demo_map: AmbiguityMap, tmp_path: Path, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Installed, as its entry point says; two seeds, of which the second is planned apart."""
    (tmp_path / "chatty.py").write_text(PLUG_IN, encoding="utf-8")
    record = tmp_path / "chatty-1.0.dist-info"
    record.mkdir()
    (record / "METADATA").write_text("Metadata-Version: 2.1\nName: chatty\nVersion: 1.0\n")
    (record / "entry_points.txt").write_text("[ambinav.planners]\nchatty = chatty:PLANNER\n")
    stored = tmp_path / "demo.zarr"
    demo_map.save(stored)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    code = (
        "import json; from ambinav import AmbiguityMap; "
        "from ambinav_planners import RoutePlanner; "
        f"robot = RoutePlanner(AmbiguityMap.open({str(stored)!r})); "
        "routes = [robot.plan((3.0, 3.0), (12.0, 6.0), planner_name='chatty', seed=seed) "
        "for seed in (1, 2)]; "
        "print(json.dumps([route.poses.tolist() for route in routes]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # The first is planned in the process itself, whose standard output it has.
    *chatter, routes = done.stdout.splitlines()
    assert chatter == ["chatty plans", "chatty plans from C"]
    assert done.stderr.splitlines()[-2:] == chatter
    first, second = json.loads(routes)
    assert first == second


@pytest.mark.sweep
def test_seed_0_is_one_that_ompl_takes() -> None:
    code = (
        "from ambinav_planners.seeded import _take_seed; from ompl import util; "
        "print(_take_seed(0), util.RNG.getSeed())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", str(2**32 - 1)] and done.stderr == ""
