"""Worker processes: how they start, and how they end with this process."""

from __future__ import annotations

import atexit
import gc
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ambinav.runtime.errors import InputWarning


def processors() -> int:
    """Return how many processors this process may use: a job may have fewer than the machine."""
    affinity = getattr(os, "sched_getaffinity", None)  # only some systems have it
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


@contextmanager
def putting_signals_off() -> Iterator[None]:
    """Block Ctrl-C and termination while processes start.

    These hear no Ctrl-C until `begin_worker` has seen to that. Here another thread may take the
    signal, which raises in this one; a process that has begun and is not yet the pool's would then
    take the word to end that is meant for another, and the pool would wait for that one for ever.
    """
    delayed: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # elsewhere no signal raises
        for number in (signal.SIGINT, signal.SIGTERM):
            handlers[number] = signal.signal(number, lambda number, frame: delayed.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        # First, so that what another thread has taken meanwhile is put off too, and does not raise
        # before the mask is as it was.
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for received in dict.fromkeys(delayed):
            signal.raise_signal(received)


class ChildProcess:
    """A process and the connection to it.

    Args:
        method: How it starts: "fork", or fresh by "spawn" or "forkserver", as numba's threads do
            not survive a fork.
        target: What it runs, given its end of the connection and `args`; it calls `begin_worker`.
        args: Further arguments.
    """

    def __init__(self, method: str, target: Callable[..., None], *args: Any) -> None:
        context = multiprocessing.get_context(method)
        self.line, theirs = context.Pipe()
        self._lock, self._is_ended = threading.Lock(), False
        # Every context has it, though the stubs do not say so of their base class.
        self.process = context.Process(target=target, args=(theirs, *args), daemon=True)  # type: ignore[attr-defined]
        try:
            with putting_signals_off():
                self.process.start()
        except BaseException:  # a signal that was put off
            self.end()
            raise
        finally:
            theirs.close()

    def kill(self) -> None:
        """Kill the process; `end` must still be called."""
        with self._lock:
            if not self._is_ended:
                self.process.kill()

    def end(self) -> None:
        """Kill the process, busy or not, and wait for its end; further calls do nothing."""
        with self._lock:
            if self._is_ended:
                return
            if self.process.pid is not None:  # it has begun
                self.process.kill()
                self.process.join()
            self.line.close()
            self.process.close()
            self._is_ended = True


def begin_worker() -> None:
    """Prepare a worker process; Ctrl-C and notices are left to the parent process."""
    import numba

    warnings.simplefilter("ignore", InputWarning)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # After "forkserver" numba would make a semaphore, which a killed process leaves behind.
    multiprocessing.set_start_method("spawn", force=True)
    numba.set_num_threads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    atexit.register(end_quickly)


def end_quickly() -> None:
    """Let this process end without a search of all modules for garbage: a third of a second."""
    # OMPL's bindings would print what is left of it.
    if "ompl" not in sys.modules:
        gc.freeze()


def _end_with_parent() -> None:
    """End this process when its parent is killed, as nothing else would."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
