"""Seeded runs: OMPL accepts one seed per process, so every further run gets its own process.

OMPL hands its seeds out in order, one to every sampler that is made, and can neither set nor
reset them later. The first seeded call of a process takes place in it; every further one in a
fresh process. Both give the same result.

Call and answer go over a connection of their own, for planners may be plug-ins, which print: what
is written to standard output or error there, from Python or C, is shown on standard error here.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Final, TypeVar

from ambinav.runtime.errors import InputError
from ambinav.runtime.processes import putting_signals_off
from ambinav_planners.registry import SEEDS

T = TypeVar("T")

LOOK_EVERY: Final = 0.5
"""Seconds between two looks whether a process that does not answer is still there."""
PATIENCE: Final = 5.0
"""Seconds in which a process that has answered must end, with what it still prints."""


@dataclass
class _Process:
    seed: int | None = None


_process = _Process()


@dataclass(frozen=True)
class _Answer:
    """Answer to a call: a result, or the error."""

    result: Any = None
    refused: InputError | None = None
    failed: str | None = None


def call_seeded(seed: int | None, function: Callable[..., T], *arguments: Any) -> T:
    """Call a function with OMPL's random numbers seeded.

    Args:
        seed: From 0 on; None for other random numbers every time.
        function: At the top level of a module, so that a fresh process can import it.
        arguments: Its arguments; they and its result are pickled for a fresh process.

    Raises:
        InputError: what the function raised so, here or there.
        RuntimeError: the fresh process failed otherwise; the message holds its traceback, or how it
            ended.
    """
    if seed is None or (_process.seed is None and _take_seed(seed)):
        return function(*arguments)
    answer = _answer_of(pickle.dumps((seed, function, arguments)))
    if answer.refused is not None:
        raise answer.refused
    if answer.failed is not None:
        raise RuntimeError(f"planning in a fresh process failed: {answer.failed}")
    value: T = answer.result
    return value


def _answer_of(task: bytes) -> _Answer:
    """Start a process, give it a pickled call, and wait for its answer."""
    parent, child = socket.socketpair()
    with child:
        code = f"from ambinav_planners.seeded import main; main({child.fileno()})"
        command = [sys.executable, "-c", code]
        with putting_signals_off():  # of this process: the new one is ended by the block below
            run = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=_stderr(), pass_fds=(child.fileno(),)
            )
    with run, Connection(parent.detach()) as line:
        try:
            # A process that ends first breaks the connection; its end is reported below.
            with contextlib.suppress(OSError, EOFError):
                line.send_bytes(task)
                while not wait([line], LOOK_EVERY):
                    if run.poll() is not None and not line.poll():
                        raise EOFError
                answer = pickle.loads(line.recv_bytes())
                with contextlib.suppress(subprocess.TimeoutExpired):
                    run.wait(PATIENCE)
                return answer if isinstance(answer, _Answer) else _Answer(failed="no answer")
            return _Answer(failed=f"it ended before it had answered, {_ending(run.wait())}")
        finally:
            run.kill()


def _stderr() -> int:
    """Return the file descriptor for this process's errors."""
    try:
        return sys.__stderr__.fileno() if sys.__stderr__ is not None else subprocess.DEVNULL
    except (OSError, ValueError):
        return subprocess.DEVNULL


def _ending(status: int) -> str:
    if status >= 0:
        return f"with exit status {status}"
    try:
        return f"by {signal.Signals(-status).name}"
    except ValueError:
        return f"by signal {-status}"


def _take_seed(seed: int) -> bool:
    """Seed OMPL; return False if something in this process has used its random numbers already."""
    from ompl import util as ou

    _process.seed = seed
    seed = seed or SEEDS
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(seed)
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    return bool(ou.RNG.getSeed() == seed)


def main(descriptor: int) -> None:
    """Read a call from a connection and write the answer to it: entry point of the new process."""
    # Ctrl-C is handled by the process that waits for the answer.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.set_inheritable(descriptor, False)  # else children would keep it open
    line = Connection(descriptor)
    task = line.recv_bytes()
    threading.Thread(target=_end_with, args=(line,), daemon=True).start()
    try:
        made = pickle.dumps(_called(task))
    except Exception:  # the result cannot be pickled
        made = pickle.dumps(_Answer(failed=traceback.format_exc()))
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    line.send_bytes(made)


def _called(task: bytes) -> _Answer:
    """Execute a call."""
    try:
        seed, function, arguments = pickle.loads(task)
        if not _take_seed(seed):
            return _Answer(failed="OMPL had drawn random numbers before it could be seeded")
        return _Answer(function(*arguments))
    except InputError as error:
        return _Answer(refused=error)
    except Exception:
        return _Answer(failed=traceback.format_exc())


def _end_with(line: Connection) -> None:
    """End this process when its parent has ended."""
    with contextlib.suppress(OSError, EOFError):
        line.poll(None)
    os._exit(1)
