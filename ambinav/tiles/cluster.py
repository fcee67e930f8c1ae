"""Tiles made by the workers of a Dask scheduler, possibly on other machines."""

from __future__ import annotations

import asyncio
import time
from concurrent.futures import CancelledError
from typing import Any, Final

import numba

from ambinav.runtime.errors import InputError
from ambinav.tiles.queue import TileDone, TileQueue, TileTask, TileWork, do_task

PATIENCE: Final = 6.0
"""Seconds in which a scheduler must answer, and then have a worker."""
PER_THREAD: Final = 2
"""Tiles under way for each thread of the workers: one that is made, and one that waits there."""


def make_on_cluster(queue: TileQueue, work: TileWork, address: str, computed_by: str) -> None:
    """Make all tiles on a cluster.

    The scheduler holds the tiles that are under way and no others. Of a worker that dies it gives
    them to another one.

    Args:
        queue: The tiles.
        work: What all have in common; sent to each worker once.
        address: Address of the scheduler, `tcp://host:8786`.
        computed_by: What workers must compute with, see `computing_digest`.

    Raises:
        InputError: Dask is not installed, the scheduler does not answer or has no workers, they
            run other code, or a tile cannot be written.
        RuntimeError: tile after tile its worker was killed.
    """
    threads_of(address)
    from distributed import Client, KilledWorker, wait

    client = Client(address, timeout=PATIENCE, set_as_default=False)
    outstanding: dict[Any, TileTask] = {}
    try:
        _await_workers(client, address)
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
                    _run_task, common, task, computed_by, pure=False, key=f"ambinav-tile-{number}"
                )
                outstanding[future] = task
            if not outstanding:
                return
            with client.as_current():
                finished = wait(list(outstanding), return_when="FIRST_COMPLETED").done
            for future in finished:
                del outstanding[future]
                try:
                    done: TileDone = future.result()
                except KilledWorker as error:
                    raise RuntimeError(
                        f"the workers of {address} that made a tile were killed again and again, "
                        "perhaps for lack of memory; a smaller --tile needs less"
                    ) from error
                queue.give(done)
    except CancelledError as error:
        raise InputError(
            f"--scheduler {address}: it was lost; finished tiles are kept, and the same command "
            "resumes from there."
        ) from error
    finally:
        client.cancel(list(outstanding), force=True)
        client.close(timeout=PATIENCE)


def threads_of(address: str) -> int:
    """Return the number of threads of a scheduler's workers.

    Not by a client, which waits for ever for one that takes the call and says nothing.

    Raises:
        InputError: Dask is not installed, or no scheduler answers in `PATIENCE` seconds.
    """
    try:
        from distributed.core import connect, send_recv
    except ImportError as error:
        raise InputError(
            f"--scheduler {address}: Dask is not installed; install ambinav[dask], or leave the "
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
            f"--scheduler {address}: no scheduler answers there within {PATIENCE:g} s; start one "
            "with `dask scheduler`, or leave it out to use processes of this computer."
        ) from error


def _await_workers(client: Any, address: str) -> None:
    begun = time.monotonic()
    while not client.nthreads():
        if time.monotonic() - begun > PATIENCE:
            raise InputError(
                f"--scheduler {address}: it has no workers; start some with "
                f"`dask worker {address}`."
            )
        time.sleep(0.1)


def _run_task(work: TileWork, task: TileTask, computed_by: str) -> TileDone:
    """Run a task on a worker."""
    from ambinav.map_building.stored import computing_digest

    if computing_digest() != computed_by:
        raise InputError(
            "a worker of the scheduler has other code of ambinav, other libraries or another kind "
            "of processor than this computer, so that its numbers may differ; give all the same."
        )
    numba.set_num_threads(1)
    return do_task(work, task)
