"""The same seed gives the same route: in any process, whatever was planned in it before."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.seeded import call_seeded

START, GOAL = (3.0, 3.0), (12.0, 6.0)
JOBS = {"rrtstar": 1000, "bitstar": 3000, "fmt": 300, "prmstar": 300}
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
PosesByJob = dict[tuple[str, int], list[list[float]]]


def in_a_fresh_process(source: Path, jobs: list[tuple[str, int, int | None]]) -> PosesByJob:
    """Poses of the routes by planner and seed."""
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(source), json.dumps(jobs)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    rows = [json.loads(line) for line in run.stdout.splitlines()]
    return {(name, seed): poses for name, seed, poses in rows}


@pytest.fixture
def stored(demo_map: AmbiguityMap, tmp_path: Path) -> Path:
    path = tmp_path / "demo.zarr"
    demo_map.save(path)
    return path


@pytest.mark.slow
def test_the_same_seed_gives_the_same_route(stored: Path, robot: RoutePlanner) -> None:
    """In one test, for the processes take their time."""
    # The first is seeded in the process, the others apart; then the other way round.
    first = in_a_fresh_process(stored, [(name, count, 1) for name, count in JOBS.items()])
    assert set(first) == {(name, 1) for name in JOBS}
    again = in_a_fresh_process(stored, [(name, JOBS[name], 1) for name in ("prmstar", "rrtstar")])
    assert set(again) == {("prmstar", 1), ("rrtstar", 1)}
    assert all(again[key] == first[key] for key in again)
    # A later plan is that of a fresh process.
    alone = in_a_fresh_process(stored, [("bitstar", JOBS["bitstar"], 1)])
    assert alone["bitstar", 1] == first["bitstar", 1]
    # Random numbers drawn before do not matter.
    jobs = [("prmstar", JOBS["prmstar"], None), ("rrtstar", JOBS["rrtstar"], 1)]
    assert in_a_fresh_process(stored, jobs)["rrtstar", 1] == first["rrtstar", 1]
    # Another seed gives another route.
    budget = {"iterations": JOBS["rrtstar"], "seconds": math.inf}
    for seed in (1, 2):
        route = robot.plan(START, GOAL, planner_name="rrtstar", seed=seed, **budget)
        assert route.seed == seed
        assert (route.poses.tolist() == first["rrtstar", 1]) == (seed == 1)


def test_planners_without_random_numbers_start_no_process(
    robot: RoutePlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("ambinav_planners.seeded.subprocess.Popen")
    routes = [robot.plan(START, GOAL, planner_name="reference", seed=seed) for seed in (1, 2)]
    assert (routes[0].poses == routes[1].poses).all()


def test_calls_without_a_seed_stay_here() -> None:
    assert call_seeded(None, os.getpid) == os.getpid()


@pytest.mark.slow
def test_seeded_calls_take_arguments_and_return_results() -> None:
    assert call_seeded(7, math.hypot, 3.0, 4.0) == 5.0
    assert call_seeded(7, os.getpid) != os.getpid()  # since 7 is taken here


@pytest.mark.slow
def test_what_fails_in_a_fresh_process_is_reported() -> None:
    call_seeded(7, os.getpid)
    with pytest.raises(RuntimeError, match=r"(?s)failed: .*ValueError"):
        call_seeded(8, math.sqrt, -1.0)


@pytest.mark.slow
def test_seed_0_is_one_that_ompl_takes() -> None:
    code = (
        "from ambinav_planners.seeded import _take_seed; from ompl import util; "
        "print(_take_seed(0), util.RNG.getSeed())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", str(2**32 - 1)] and done.stderr == ""
