"""OMPL's own benchmark with our objective and validator; its log is what Planner Arena reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ompl import tools as ot

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing
from ambinav_planners.ompl_setup import prepare
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, check_suits, planner

MEMORY = 4096.0
"""Megabytes after which OMPL's benchmark stops a planner."""


def write_benchmark(
    problem: Problem,
    names: Sequence[str],
    output: Path,
    *,
    seconds: float = 1.0,
    runs: int = 10,
    name: str = "ambinav",
    database: Path | None = None,
) -> None:
    """Run OMPL's `Benchmark` on a problem and write its log.

    Every run starts from scratch and is not simplified, because OMPL's simplification removes the
    detours that the objective asks for. OMPL's benchmark keeps the setup for good, which nanobind
    notes when the process ends.

    Args:
        problem: The planning problem.
        names: Planners of the registry that OMPL runs itself: all but prmstar, which is searched
            apart, and those that are not OMPL's.
        output: The log.
        seconds: Time of a run.
        runs: Runs of each planner.
        name: Name of the experiment.
        database: SQLite file for Planner Arena to make from the log, or None.

    Raises:
        InputError: a planner that OMPL's benchmark cannot run, or that does not suit the problem,
            no planner, or no run.
    """
    if not names or runs < 1 or not seconds > 0.0:
        raise InputError(
            f"the benchmark has {len(names)} planners, {runs} runs and {seconds:g} s; give at "
            "least one of each."
        )
    setup = prepare(problem)
    benchmark = ot.Benchmark(setup.simple, name)
    for each in names:
        chosen = planner(each)
        check_suits(chosen, problem, Budget(seconds))
        if chosen.make is None:
            raise InputError(
                f"planner {each!r} cannot run in OMPL's benchmark, since OMPL does not solve with "
                "it; time it with RoutePlanner.plan."
            )
        benchmark.addPlanner(chosen.make(setup.si))
    benchmark.addExperimentParameter("weight", "REAL", f"{problem.service.weight:g}")
    benchmark.addExperimentParameter("layer", "TEXT", problem.service.layer)
    benchmark.benchmark(ot.Request(seconds, MEMORY, runs, 0.05, False, False, False))
    with replacing(output) as scratch:
        if not benchmark.saveResultsToFile(str(scratch)):
            raise OSError(f"OMPL could not write its log to {scratch}")
    if database is not None:
        with replacing(database) as scratch:
            ot.readBenchmarkLog(str(scratch), [str(output)], None)
