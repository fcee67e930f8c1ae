"""Plans in worker processes: limited in number and time, stopped when no client waits."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Coroutine
from multiprocessing.connection import Connection
from typing import Any, Final, TypeVar

from fastapi import Request

from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.server.jobs.workers import Failure, PlanTask, Worker, plans
from ambinav.server.problems import ENDING, RETRY, Problem, named_field
from ambinav.server.served import DEFAULT_WEIGHT, ServedMap

T = TypeVar("T")

GRACE_SECONDS: Final = 2.0
"""Seconds that a plan whose client has left may go on, before its process is stopped."""


class Turns:
    """Queue of limited length in front of a limited number of jobs.

    Args:
        running: Jobs that run at the same time.
        waiting: Jobs that may wait for their turn.
        noun: Name of the jobs in messages.
    """

    def __init__(self, running: int, waiting: int, noun: str) -> None:
        self._free = asyncio.Semaphore(running)
        self._places = running + waiting
        self._noun = noun

    async def __aenter__(self) -> None:
        """Wait for a turn.

        Raises:
            Problem: too many wait already.
        """
        if self._places == 0:
            raise Problem(
                503, f"Too many {self._noun} are waiting; try again later.", headers=RETRY
            )
        self._places -= 1
        try:
            await self._free.acquire()
        except BaseException:
            self._places += 1
            raise

    async def __aexit__(self, *_: object) -> None:
        """Start the next waiting job."""
        self._free.release()
        self._places += 1


class PlanPool:
    """Processes that plan, kept for reuse.

    Args:
        running: Plans that run at the same time.
        waiting: Plans that may wait.
        seconds: Time after which a plan is stopped.
    """

    work: Callable[[Connection], None] = staticmethod(plans)
    """Work of a process."""
    what = "plan"
    """Name of a task in messages."""
    remedy = "ask for a shorter one"
    """For a task that takes too long."""

    def __init__(self, running: int, waiting: int, seconds: float) -> None:
        self._turns = Turns(running, waiting, f"{self.what}s")
        self._seconds = seconds
        self._idle: list[Worker] = []
        self.busy: set[Worker] = set()

    async def run(self, task: object) -> Any:
        """Run a task; if the caller is cancelled, the task is stopped, see `_can_reuse`.

        Raises:
            Problem: it cannot be done, takes too long, or its process was killed.
        """
        async with self._turns:
            worker = self._idle_worker() or await started(self.work)
            self.busy.add(worker)
            done = False
            # A task of its own: what was begun to be read is read to its end if this is cancelled.
            coming = asyncio.ensure_future(received(worker))
            try:
                worker.line.send(task)
                async with asyncio.timeout(self._seconds):
                    answer = await asyncio.shield(coming)
                done = True
            except asyncio.CancelledError:
                done = await self._can_reuse(worker, coming)
                raise
            except TimeoutError:
                raise Problem(
                    504, f"The {self.what} was stopped after {self._seconds:g} s; {self.remedy}."
                ) from None
            except (EOFError, OSError):
                raise Problem(
                    503, f"The process of the {self.what} was killed, perhaps for lack of memory."
                ) from None
            finally:
                self.busy.discard(worker)
                if done:
                    self._idle.append(worker)
                else:
                    coming.cancel()
                    await asyncio.gather(coming, return_exceptions=True)
                    await asyncio.to_thread(worker.end)
        if isinstance(answer, Failure):
            if answer.ours:
                raise answer.error
            raise Problem(422, answer.detail, field=named_field(answer.detail))
        return answer

    async def _can_reuse(self, worker: Worker, answer: asyncio.Future[Any]) -> bool:
        """Return whether a process can be reused after its task, whose `answer` nobody wants.

        A new process has to load all code and the map: a task that ends soon is waited for.
        """
        try:
            async with asyncio.timeout(GRACE_SECONDS):
                await asyncio.shield(answer)
        except (EOFError, OSError):  # TimeoutError is one
            return False
        return True

    def _idle_worker(self) -> Worker | None:
        """Return an idle process that has planned before; killed processes are skipped."""
        while self._idle:
            worker = self._idle.pop()
            if worker.process.is_alive():
                return worker
            worker.end()
        return None

    @property
    def running(self) -> int:
        """Number of tasks that are computed."""
        return len(self.busy)

    def close(self) -> None:
        """Stop all processes."""
        for worker in (*self._idle, *self.busy):
            worker.end()
        self._idle.clear()


def warm_up_plan(
    served: ServedMap, map_file: str, place: tuple[float, float], weights: tuple[float, ...] | None
) -> PlanTask:
    """Return the task to plan along one cell of a map, written to a file."""
    x, y = place
    heading = (0.0,) if served.amap.has_theta else ()
    return PlanTask(
        map_file=map_file,
        map_name=served.name,
        layer=served.amap.cost_layer,
        weight=DEFAULT_WEIGHT,
        weights=weights,
        start=(x, y, *heading),
        goal=(x + served.amap.spacing, y, *heading),
        planner=None,
        seconds=0.1,
        seed=0,
        radius=None,
        odometry=ODOMETRY,
        localizer=LOCALIZER,
    )


async def started(work: Callable[[Connection], None]) -> Worker:
    """Start a process; if the caller is cancelled meanwhile, the process is stopped."""
    begun = asyncio.get_running_loop().run_in_executor(None, Worker, work)
    try:
        return await asyncio.shield(begun)
    except asyncio.CancelledError:
        begun.add_done_callback(_end_worker)
        raise


def _end_worker(begun: asyncio.Future[Worker]) -> None:
    if begun.exception() is None:
        begun.result().end()


async def received(worker: Worker) -> Any:
    """Return the next message of a process.

    Raises:
        EOFError: it has ended.
    """
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    number = worker.line.fileno()
    loop.add_reader(number, ready.set)
    try:
        await ready.wait()
    finally:
        loop.remove_reader(number)
        # Once the server ends, the line is closed, and its number may be another file's.
        if not worker.line.closed:
            # uvloop makes what it watches non-blocking; a long message would be read in part.
            os.set_blocking(number, True)
    # In a thread: the process has low priority and may have sent only a part.
    message = loop.run_in_executor(None, worker.line.recv)
    try:
        return await asyncio.shield(message)
    except asyncio.CancelledError:
        worker.kill()  # what is read ends then, before the line is closed
        await asyncio.gather(message, return_exceptions=True)
        raise


async def while_connected(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """Await a job, and cancel it when the request's connection is closed.

    Raises:
        Problem: it was closed, and nobody is there to read of it; or the server ends.
    """
    task = asyncio.ensure_future(work)
    disconnection = asyncio.ensure_future(_disconnected(request))
    try:
        await asyncio.wait({task, disconnection}, return_when=asyncio.FIRST_COMPLETED)
    except asyncio.CancelledError:
        # By uvicorn, which waits for requests a few seconds when it ends. It has no time for the
        # process to be gone; `PlanPool` sees to that.
        raise Problem(503, ENDING) from None
    finally:
        disconnection.cancel()
        task.cancel()
    await asyncio.gather(task, disconnection, return_exceptions=True)
    if task.cancelled():
        raise Problem(503, "The connection was closed.")
    return task.result()


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
