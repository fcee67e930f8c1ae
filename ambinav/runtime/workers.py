"""Tasks done by processes of this computer; a killed process is replaced."""

from __future__ import annotations

import contextlib
import multiprocessing
import traceback
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from typing import Any

from ambinav.runtime.errors import InputError
from ambinav.runtime.processes import ChildProcess, begin_worker, putting_signals_off
from ambinav.runtime.work_queue import Done, Task, Work, WorkQueue


def prepare_processes(module: str) -> None:
    """Import a module in a process of which `do_in_processes` makes its own; does not wait for it.

    They are then ready at once, and share what the module holds.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([module])
    with putting_signals_off():
        forkserver.ensure_running()


def do_in_processes(queue: WorkQueue[Task, Done], work: Work[Task, Done], count: int) -> None:
    """Do all tasks in separate processes, on one thread each.

    Raises:
        InputError: the work raised it.
        RuntimeError: the work raised another error, or see `queue.lost`.
    """
    workers: list[_Worker] = []
    try:
        while True:
            # Start all of them first, as a process must run before it is sent a task.
            while len(workers) < min(count, queue.total):
                workers.append(_Worker(work))
            for active in workers:
                if active.task is None and (task := queue.take()) is not None:
                    active.task = task
                    with contextlib.suppress(OSError):  # it is dead, as its line says below
                        active.line.send(task)
            busy = {active.line: active for active in workers if active.task is not None}
            if not busy:
                return
            for line in wait(list(busy)):
                active = next(worker for key, worker in busy.items() if key is line)
                try:
                    outcome = active.line.recv()
                except (EOFError, OSError):
                    active.end()
                    workers.remove(active)
                    queue.lost(active.task)
                    continue
                if isinstance(outcome, Exception):
                    raise outcome
                active.task = None
                queue.give(outcome)
    finally:
        for active in workers:
            active.end()


class _Worker(ChildProcess):
    """Process, the connection to it, and its present task."""

    def __init__(self, work: Work[Any, Any]) -> None:
        super().__init__("forkserver", _serve, work)
        self.task: Any = None


def _serve(line: Connection, work: Work[Any, Any]) -> None:
    """Do one task after the other, until the connection closes."""
    begin_worker()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            task = line.recv()
            try:
                outcome = work(task)
            except InputError as error:
                outcome = error
            except Exception:
                outcome = RuntimeError(f"a task cannot be done\n{traceback.format_exc()}")
            line.send(outcome)
