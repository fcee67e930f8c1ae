"""Tasks done by the workers of a Dask scheduler, possibly on other machines."""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import CancelledError
from typing import Any, Final

from ambinav.runtime.errors import InputError
from ambinav.runtime.work_queue import Done, Task, Work, WorkQueue

PATIENCE: Final = 6.0
"""Seconds in which a scheduler must answer, and then have a worker."""
PER_THREAD: Final = 2
"""Tasks under way for each thread of the workers: one that is done, and one that waits there."""


def do_on_cluster(
    queue: WorkQueue[Task, Done], work: Work[Task, Done], address: str, option: str
) -> None:
    """Do all tasks on a cluster.

    The scheduler holds the tasks that are under way and no others. Of a worker that dies it gives
    them to another one.

    Args:
        queue: The tasks.
        work: What is done with each; sent to each worker once.
        address: Address of the scheduler, `tcp://host:8786`.
        option: The command's option that gives the address, for messages.

    Raises:
        InputError: Dask is not installed, the scheduler does not answer or has no workers, or the
            work raised it.
        RuntimeError: see `queue.lost`.
    """
    threads_of(address, option)
    from distributed import Client, KilledWorker, wait
    from distributed.comm import CommClosedError

    client = Client(address, timeout=PATIENCE, set_as_default=False)
    outstanding: dict[Any, Task] = {}
    try:
        _await_workers(client, address, option)
        common = client.scatter(work, broadcast=True, hash=False)
        number = 0
        while True:
            threads = sum(client.nthreads().values())
            while len(outstanding) < PER_THREAD * max(threads, 1):
                task = queue.take()
                if task is None:
                    break
                number += 1
                future = client.submit(
                    _run_task, common, task, pure=False, key=f"ambinav-task-{number}"
                )
                outstanding[future] = task
            if not outstanding:
                return
            with client.as_current():
                finished = wait(list(outstanding), return_when="FIRST_COMPLETED").done
            for future in finished:
                task = outstanding.pop(future)
                try:
                    done = future.result()
                except KilledWorker:
                    queue.lost(task, often=True)
                else:
                    queue.give(done)
    except (CancelledError, CommClosedError, ConnectionError, TimeoutError) as error:
        raise InputError(
            f"{option} {address}: it was lost; what is finished is kept, and the same command "
            "resumes from there."
        ) from error
    finally:
        client.cancel(list(outstanding), force=True)
        client.close(timeout=PATIENCE)


def threads_of(address: str, option: str = "--scheduler") -> int:
    """Return the number of threads of a scheduler's workers.

    Not by a client, which waits for ever for one that takes the call and says nothing.

    Raises:
        InputError: Dask is not installed, or no scheduler answers in `PATIENCE` seconds.
    """
    try:
        from distributed.core import connect, send_recv
    except ImportError as error:
        raise InputError(
            f"{option} {address}: Dask is not installed; install ambinav[dask], or leave the "
            "scheduler out to use processes of this computer."
        ) from error

    async def ask() -> int:
        comm = await connect(address, timeout=PATIENCE)
        try:
            answer = await send_recv(comm, op="identity", reply=True)
        finally:
            comm.abort()
        return sum(int(worker["nthreads"]) for worker in answer["workers"].values())

    try:
        return asyncio.run(asyncio.wait_for(ask(), PATIENCE))
    # If the address is not a scheduler, its answer is arbitrary and may raise any error.
    except Exception as error:
        raise InputError(
            f"{option} {address}: no scheduler answers there within {PATIENCE:g} s; start one "
            "with `dask scheduler`, or leave it out to use processes of this computer."
        ) from error


def _await_workers(client: Any, address: str, option: str) -> None:
    begun = time.monotonic()
    while not client.nthreads():
        if time.monotonic() - begun > PATIENCE:
            raise InputError(
                f"{option} {address}: it has no workers; start some with `dask worker {address}`."
            )
        time.sleep(0.1)


def _run_task(work: Work[Task, Done], task: Task) -> Done:
    """Do a task on a worker."""
    return work(task)
