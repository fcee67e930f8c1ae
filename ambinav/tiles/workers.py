"""Tiles made by processes of this computer; a killed process is replaced."""

from __future__ import annotations

import contextlib
import multiprocessing
import traceback
from multiprocessing.connection import Connection, wait
from typing import Final

from ambinav.runtime.errors import InputError
from ambinav.runtime.processes import begin_worker, putting_signals_off
from ambinav.tiles.queue import TileDone, TileQueue, TileTask, TileWork, do_task

MOST_DEATHS: Final = 5
"""Maximum number of processes that may be killed in a row before a tile is made."""


def make_here(queue: TileQueue, work: TileWork) -> None:
    """Make all tiles in this process, on its threads."""
    while (task := queue.take()) is not None:
        queue.give(do_task(work, task))


def make_in_processes(queue: TileQueue, work: TileWork, count: int) -> None:
    """Make all tiles in separate processes, on one thread each.

    Args:
        queue: The tiles.
        work: What all have in common.
        count: How many processes.

    Raises:
        InputError: a tile cannot be written.
        RuntimeError: process after process was killed, or a tile cannot be made.
    """
    deaths = 0
    workers: list[_Worker] = []
    try:
        while True:
            # Start all of them first, as a process must run before it is sent a tile.
            while len(workers) < min(count, queue.total):
                with putting_signals_off():
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
                assert active.task is not None
                try:
                    outcome = active.line.recv()
                except (EOFError, OSError):
                    deaths += 1
                    if deaths >= MOST_DEATHS:
                        raise RuntimeError(
                            f"{deaths} worker processes in a row were killed, perhaps for lack of "
                            "memory; fewer --workers or a smaller --tile need less"
                        ) from None
                    queue.lost(active.task)
                    active.end()
                    workers.remove(active)
                    continue
                if not isinstance(outcome, TileDone):
                    raise outcome
                deaths, active.task = 0, None
                queue.give(outcome)
    finally:
        for active in workers:
            active.end()


class _Worker:
    """Process, the connection to it, and its present task."""

    def __init__(self, work: TileWork) -> None:
        self.task: TileTask | None = None
        # Spawned, not forked, as numba's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self.line, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        self.process.start()
        theirs.close()

    def end(self) -> None:
        """End the process at once: a tile that it was writing counts as not made."""
        self.process.kill()
        self.process.join()
        self.line.close()
        self.process.close()


def _serve(line: Connection, work: TileWork) -> None:
    """Make one tile after the other, until the connection closes."""
    begin_worker()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            task: TileTask = line.recv()
            try:
                outcome: TileDone | Exception = do_task(work, task)
            except InputError as error:
                outcome = error
            except Exception:
                outcome = RuntimeError(f"a tile cannot be made\n{traceback.format_exc()}")
            line.send(outcome)
