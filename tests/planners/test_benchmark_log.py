"""OMPL's own benchmark with our objective: its log, and the database made of it."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from ambinav.runtime.errors import InputError
from ambinav_planners.benchmark import write_benchmark
from ambinav_planners.planning import RoutePlanner

START, GOAL = (3.0, 3.0), (6.0, 3.0)


Run = tuple[float, int]


def planners_and_runs(database: Path) -> tuple[list[str], list[Run]]:
    """Names of the planners, and length and success of each run."""
    with closing(sqlite3.connect(database)) as connection:
        names = [row[0] for row in connection.execute("SELECT name FROM plannerConfigs")]
        return names, connection.execute("SELECT solution_length, solved FROM runs").fetchall()


@pytest.mark.slow
def test_the_log_becomes_a_database(robot: RoutePlanner, tmp_path: Path) -> None:
    log, database = tmp_path / "run.log", tmp_path / "run.db"
    problem = robot.problem(START, GOAL)
    names = ["rrtstar", "bitstar", "fmt"]
    # OMPL's benchmark counts seconds alone: a machine with other work to do gets more of them.
    for seconds in (0.2, 2.0, 20.0):
        options = {"seconds": seconds, "runs": 2, "name": "demo building", "database": database}
        write_benchmark(problem, names, log, **options)
        configs, runs = planners_and_runs(database)
        if all(solved for _, solved in runs):
            break
    text = log.read_text()
    assert "demo building" in text
    assert "weight REAL = 5" in text
    assert sorted(configs) == ["geometric_FMT", "geometric_RRTstar", "geometric_kBITstar"]
    assert len(runs) == 6
    assert all(solved for _, solved in runs)
    assert all(length >= 3.0 - 1e-6 for length, _ in runs)
    assert {path.name for path in tmp_path.iterdir()} == {"run.log", "run.db"}


@pytest.mark.parametrize("name", ["prmstar", "reference", "belief"])
def test_planners_that_ompl_does_not_run(robot: RoutePlanner, tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"planner '{name}' cannot run in OMPL's benchmark"):
        write_benchmark(robot.problem(START, GOAL), [name], tmp_path / "run.log")
    assert not list(tmp_path.iterdir())


def test_nothing_to_run(robot: RoutePlanner, tmp_path: Path) -> None:
    problem = robot.problem(START, GOAL)
    for names, options in (([], {}), (["fmt"], {"runs": 0}), (["fmt"], {"seconds": 0.0})):
        with pytest.raises(InputError, match="give at least one of each"):
            write_benchmark(problem, names, tmp_path / "run.log", **options)
    with pytest.raises(InputError, match="'prm' is refused"):
        write_benchmark(problem, ["prm"], tmp_path / "run.log")
