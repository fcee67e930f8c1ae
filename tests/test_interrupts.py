"""Ctrl-C and termination: status 130 and 143 whenever they come, and never "internal error"."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from ambinav.cli.running import INTERRUPTED

ROOT = Path(__file__).parents[1]
DEMO = str(ROOT / "configs" / "demo.geojson")
PATHS = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")

KERNEL = """
import ctypes, os, signal, sys, threading, time
import numpy as np
from typing import NamedTuple
from numba import njit
from ambinav.cli import interrupts

class Two(NamedTuple):
    one: np.ndarray
    other: float

pause = ctypes.CDLL(None).usleep
pause.argtypes = (ctypes.c_uint,)

@njit(nogil=True)
def spun(flags):
    flags[0] = 1
    while flags[1] == 0:
        pause(100)
    return flags

@njit(nogil=True)
def named(flags):
    return Two(spun(flags), 1.0)

@njit(nogil=True)
def failed(flags):
    raise ValueError(spun(flags)[0] > 0)

def alarm(flags):
    while flags[0] == 0:
        time.sleep(0.001)
    os.kill(os.getpid(), signal.SIGALRM)
    flags[1] = 1

# Compiled before a signal comes.
for kernel in (spun, named, failed):
    try:
        kernel(np.ones(2))
    except ValueError:
        pass
"""

# No clock decides: a kernel runs until the signal has been sent.
EACH = """
{install}
ended = set()
for kernel in 3 * ({kernels}):
    flags = np.zeros(2)
    sender = threading.Thread(target=alarm, args=(flags,))
    try:
        sender.start()
        kernel(flags)
        time.sleep(10.0)
        ended.add("nothing")
    except BaseException as error:
        ended.add(type(error).__name__)
    sender.join()
assert sys.gettrace() is None
print(*sorted(ended))
"""

# The alarm stands for Ctrl-C: it can be set to a time.
OURS = """
interrupts.install()
signal.signal(signal.SIGALRM, signal.getsignal(signal.{name}))
"""


PLAIN = """
def stop(number, frame):
    raise KeyboardInterrupt
signal.signal(signal.{name}, stop)
"""


def python(body: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", body],
        env={**os.environ, "PYTHONPATH": PATHS},
        capture_output=True,
        text=True,
        timeout=300,
    )


def script(body: str) -> str:
    done = python(KERNEL + body)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow(kept=("SIGINT-KeyboardInterrupt",))
@pytest.mark.parametrize(
    ("name", "error"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "SystemExit")]
)
def test_a_signal_while_a_kernel_runs(name: str, error: str) -> None:
    install = OURS.format(name=name)
    assert script(EACH.format(install=install, kernels="spun, named, failed")) == error


@pytest.mark.slow
def test_numba_turns_an_interrupt_into_another_error() -> None:
    """What is worked around: a kernel that returns a named tuple fails, or crashes the process.

    If this fails numba has been repaired: drop `interrupts.GLUE`.
    """
    plain = "signal.signal(signal.SIGALRM, signal.default_int_handler)"
    done = python(KERNEL + EACH.format(install=plain, kernels="named,"))
    assert "SystemError" in done.stdout or done.returncode == -signal.SIGSEGV


WITHIN = """
import signal, sys
from ambinav.cli import interrupts
interrupts.install()
try:
    exec("import signal; signal.raise_signal(signal.SIGINT); x = 1")
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.slow
def test_an_interrupt_within_a_text_that_is_executed(tmp_path: Path) -> None:
    """As while modules are imported: Python would kill itself instead of ending with 130."""
    for text, status in ((WITHIN, 130), (WITHIN.replace("interrupts.install()", ""), -2)):
        (tmp_path / "within.py").write_text(text)
        done = subprocess.run(
            [sys.executable, "-m", "within"],
            env={**os.environ, "PYTHONPATH": PATHS},
            cwd=tmp_path,
            timeout=60,
        )
        assert done.returncode == status


DROPPED = """
import signal, sys, weakref
from ambinav.cli import interrupts
{install}

class Dying:
    def __del__(self):
        signal.raise_signal(signal.{name})

def die():
    dying = Dying()
    del dying
    return "nothing"

def call_back():
    dying = type("Empty", (), {{}})()
    kept = weakref.ref(dying, lambda _: signal.raise_signal(signal.{name}))
    del dying
    return "nothing"

def load():
    # Cython registers a class of its own there, and drops what comes of that.
    import abc
    plain = abc.ABCMeta.register
    def register(cls, subclass):
        if subclass.__name__ == "_memoryviewslice":
            abc.ABCMeta.register = plain
            signal.raise_signal(signal.{name})
        return plain(cls, subclass)
    abc.ABCMeta.register = register
    import numpy.random
    return "nothing" if abc.ABCMeta.register is plain else "not registered"

def name():
    class Named:
        def __set_name__(self, owner, name):
            signal.raise_signal(signal.{name})
    class Owner:
        named = Named()
    return "nothing"

for each in (die, call_back, load, name):
    try:
        print(each())
    except (KeyboardInterrupt, SystemExit) as error:
        print(type(error).__name__)
assert sys.gettrace() is None
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "error"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "SystemExit")]
)
def test_a_signal_whose_exception_would_be_dropped(name: str, error: str) -> None:
    """In a finalizer, a weak reference's callback, an extension that is loaded, a `__set_name__`.

    The last one is turned into another error, by Python 3.11, and not dropped.
    """
    done = python(DROPPED.format(install="interrupts.install()", name=name))
    assert done.stdout.split() == 4 * [error], done.stderr
    done = python(DROPPED.format(install=PLAIN.format(name=name), name=name))
    assert done.stdout.split()[:3] == 3 * ["nothing"], done.stderr


SHARED = """
import random
import numba
from ambinav.runtime.threads import run_rows
interrupts.install()
signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))

@njit(nogil=True)
def doubled(low, high, x):
    for i in range(low, high):
        x[i] *= 2.0

numba.set_num_threads(2)
x = np.ones(64)
run_rows(doubled, 64, x)
came = 0
while came < 1000:
    try:
        signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-6, 3e-4))
        while True:
            x[:] = 1.0
            run_rows(doubled, 64, x)
    except KeyboardInterrupt:
        came += 1
x[:] = 1.0
run_rows(doubled, 64, x)
assert (x == 2.0).all()
print("done")
"""


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="there are no threads to share with")
def test_threads_share_on_after_interrupts() -> None:
    """Also while rows are handed out: no lock stays taken, for the next call or Python's end."""
    assert script(SHARED) == "done"


@pytest.mark.slow
def test_an_ignored_interrupt_stays_ignored() -> None:
    assert (
        script(
            "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
            "interrupts.install()\n"
            "print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)"
        )
        == "True"
    )


def begin(folder: Path, words: Sequence[str]) -> subprocess.Popen[str]:
    """A command in a group of processes of its own, as a shell starts it."""
    return subprocess.Popen(
        [sys.executable, "-m", "ambinav.cli", *words],
        env={**os.environ, "PYTHONPATH": PATHS, "AMBINAV_CACHE": str(folder / "cache")},
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until_termination_is_caught(process: subprocess.Popen[str]) -> None:
    """Wait until the command handles signals itself, however slow the machine is."""
    status = Path(f"/proc/{process.pid}/status")
    mask = 1 << (signal.SIGTERM - 1)
    while status.exists() and process.poll() is None:
        caught = re.search(r"SigCgt:\s*(\w+)", status.read_text())
        if caught and int(caught[1], 16) & mask:
            return
        time.sleep(0.02)


def test_an_interrupt_outside_a_command() -> None:
    done = python(
        """
import ambinav.cli
def stop(**_):
    raise KeyboardInterrupt
ambinav.cli.app = stop
ambinav.cli.main()
"""
    )
    assert (done.returncode, done.stderr) == (INTERRUPTED, "ambinav: interrupted.\n")


SCENARIO = f"""
environment: {DEMO}
scanner: hokuyo-urg-04lx
map: {{spacing: 0.4}}
robot: {{radius: 0.105}}
planning: {{margin: 0.05}}
localizer: {{min_particles: 300, max_particles: 600}}
pairs: [{{start: [3, 3], goal: [42, 20]}}]
routes: [shortest, {{kind: reference, weight: 5}}]
drive: {{runs: 400}}
"""
TRAINING = """
algorithm: ppo
steps: 100000000
envs: 8
environment: {id: ambinav/Hall-v1, buildings: 2}
"""
LASER = ("-s", "hokuyo-urg-04lx")
COMMANDS = {
    "audit": ("audit", DEMO, *LASER, "--spacing", "0.05", "-o", "out"),
    "map": ("map", DEMO, *LASER, "--spacing", "0.03", "-o", "out.zarr"),
    "compare": ("compare", "scenario.yaml", "-o", "out", "--jobs", "2"),
    "benchmark": ("benchmark", "-o", "out", "--map", DEMO, "localizer=mcl"),
    "evaluate": ("evaluate", "vfh", "-n", "5000", "localizer=mcl"),
    "dataset": ("dataset", "-o", "out", "-n", "5000", "--planner", "reference:5"),
    "train": ("train", "training.yaml", "-o", "out"),
}
"""Long enough that none is done when the signal comes."""
# Seconds after signals are caught: while modules are imported, or kernels run.
MOMENTS = (1.5, 4.0)


@pytest.mark.slow(kept=("audit-1.5", "map-4.0", "train-1.5"))
@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("command", COMMANDS)
def test_ctrl_c_ends_a_command_with_130(command: str, moment: float, tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    if command == "dataset":
        pytest.importorskip("minari")
    pytest.importorskip("ompl")
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    (tmp_path / "training.yaml").write_text(TRAINING)
    process = begin(tmp_path, COMMANDS[command])
    try:
        wait_until_termination_is_caught(process)
        time.sleep(moment)
        assert process.poll() is None, process.communicate()[1]
        os.killpg(process.pid, signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == INTERRUPTED, stderr
    assert (
        "internal error" not in stderr and stderr.strip().endswith(".") and "interrupted" in stderr
    )
