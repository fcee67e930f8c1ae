"""What this package relies on in OMPL, tried in processes of their own: some never end."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

# An empty square for scripts: OMPL's space, a setup in it, and its planner named by `NAME`.
SCRIPT = """
import math, sys
from ompl import base as ob, geometric as og, util as ou
class Length(ob.PathLengthOptimizationObjective):
    def __init__(self, si):
        super().__init__(si)
    def motionCost(self, a, b):
        return ob.Cost(math.hypot(b[0] - a[0], b[1] - a[1]))
def setup(name):
    space = ob.RealVectorStateSpace(2)
    space.setBounds(0.0, 10.0)
    simple = og.SimpleSetup(space)
    si = simple.getSpaceInformation()
    simple.setStateValidityChecker(lambda state: True)
    a, b = si.allocState(), si.allocState()
    a[0], a[1], b[0], b[1] = 1.0, 1.0, 9.0, 9.0
    simple.setStartAndGoalStates(a, b, 1e-6)
    simple.setOptimizationObjective(Length(si))
    simple.setPlanner(getattr(og, name)(si))
    return simple
"""


def script(body: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT + body],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.slow
def test_ctrl_c_ends_a_solve_at_once() -> None:
    process = script("""
simple = setup("RRTstar")
try:
    print("solving", flush=True)
    simple.solve(ob.PlannerTerminationCondition(lambda: False))
except KeyboardInterrupt:
    print("interrupted", flush=True)
""")
    assert process.stdout is not None
    while process.stdout.readline().strip() != "solving":
        assert process.poll() is None
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=10.0)
    assert "interrupted" in output


@pytest.mark.slow
def test_prm_deadlocks_with_an_objective_in_python() -> None:
    process = script("""
simple = setup("PRM")
print("solving", flush=True)
simple.solve(0.3)
""")
    try:
        assert process.stdout is not None
        while process.stdout.readline().strip() != "solving":
            assert process.poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(3.0)
            pytest.fail("OMPL has been repaired: PRM ends, so that it and PRM* can be offered")
    finally:
        process.kill()
        process.communicate()


def test_the_seed_is_taken_once_in_a_process() -> None:
    process = script("""
ou.setLogLevel(ou.LogLevel.LOG_NONE)
ou.RNG.setSeed(5)
first = ou.RNG().uniform01()
ou.RNG.setSeed(6)
print("seed", ou.RNG.getSeed(), ou.RNG().uniform01() != first)
""")
    output, _ = process.communicate(timeout=30.0)
    assert "seed 5 True" in output
