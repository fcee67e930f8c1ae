"""Work for workers of this computer, or of a cluster, which must compute as this computer does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numba

from ambinav.map_building.stored import computing_digest
from ambinav.runtime.errors import InputError
from ambinav.runtime.processes import processors
from ambinav.runtime.work_queue import Done, Task, Work, WorkQueue, do_here
from ambinav.runtime.workers import do_in_processes


@dataclass(frozen=True)
class SameCode(Generic[Task, Done]):
    """Does a work on one thread, after a check that the worker has the same code.

    Attributes:
        work: The work.
        computed_by: What workers must compute with, see `computing_digest`.
    """

    work: Work[Task, Done]
    computed_by: str

    def __call__(self, task: Task) -> Done:
        """Do a task.

        Raises:
            InputError: the worker computes with something else, or the work raised it.
        """
        if computing_digest() != self.computed_by:
            raise InputError(
                "a worker of the scheduler has other code of ambinav, other libraries or another "
                "kind of processor than this computer, so that its numbers may differ; give all "
                "the same."
            )
        numba.set_num_threads(1)
        return self.work(task)


def do_all(
    queue: WorkQueue[Task, Done],
    work: Work[Task, Done],
    computed_by: str,
    workers: int | None,
    scheduler: str | None,
    option: str = "--scheduler",
) -> None:
    """Do all tasks, here, in processes of this computer, or on a cluster.

    Args:
        queue: The tasks.
        work: What is done with each.
        computed_by: What a cluster must compute with, see `computing_digest`.
        workers: Number of processes; 0: only this one, with its threads; None: one per processor.
        scheduler: Address of a Dask scheduler, whose workers do them instead; None: there is none.
        option: Names the scheduler in messages.

    Raises:
        InputError: the work raised it, or the scheduler does not answer.
        RuntimeError: the work raised another error, or see `WorkQueue.lost`.
    """
    if scheduler is not None:
        from ambinav.runtime.cluster import do_on_cluster

        do_on_cluster(queue, SameCode(work, computed_by), scheduler, option)
    elif workers == 0:
        do_here(queue, work)
    else:
        do_in_processes(queue, work, workers or processors())
