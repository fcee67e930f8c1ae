"""OMPL's own benchmark with our objective: its log, and the database made of it."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from ambinav.errors import InputError
from ambinav_planners.benchmark import write_benchmark
from ambinav_planners.planning import RoutePlanner

START, GOAL = (3.0, 3.0), (6.0, 3.0)


def test_the_log_becomes_a_database(robot: RoutePlanner, tmp_path: Path) -> None:
    log, database = tmp_path / "run.log", tmp_path / "run.db"
    problem = robot.problem(START, GOAL)
    names = ["rrtstar", "bitstar", "fmt"]
    write_benchmark(
        problem, names, log, seconds=0.2, runs=2, name="demo building", database=database
    )
    text = log.read_text()
    assert "demo building" in text
    assert "weight REAL = 5" in text
    with closing(sqlite3.connect(database)) as connection:
        told = [row[0] for row in connection.execute("SELECT name FROM plannerConfigs")]
        assert sorted(told) == ["geometric_FMT", "geometric_RRTstar", "geometric_kBITstar"]
        rows = connection.execute("SELECT solution_length, solved FROM runs").fetchall()
        assert len(rows) == 6
        assert all(solved for _, solved in rows)
        assert all(length >= 3.0 - 1e-6 for length, _ in rows)
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
