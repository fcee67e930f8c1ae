"""Work for the workers of a cluster, which must compute as this computer does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numba

from ambinav.map_building.stored import computing_digest
from ambinav.runtime.errors import InputError
from ambinav.runtime.work_queue import Done, Task, Work


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
