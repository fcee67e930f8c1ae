"""Queue of tasks for workers, of this computer or of a cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

Task = TypeVar("Task")
Done = TypeVar("Done")
TaskIn = TypeVar("TaskIn")
DoneIn = TypeVar("DoneIn", contravariant=True)

Work = Callable[[Task], Done]
"""Work of a worker on a task. It can be pickled, and is sent to each worker once."""


class WorkQueue(Protocol[TaskIn, DoneIn]):
    """Tasks to do, and what becomes of them.

    Attributes:
        total: Number of tasks.
    """

    total: int

    def take(self) -> TaskIn | None:
        """Return the next task; None: none is left now, but tasks under way may come back."""

    def give(self, done: DoneIn) -> None:
        """Record the result of a task."""

    def lost(self, task: TaskIn, *, often: bool = False) -> None:
        """Record that the worker of a task was killed.

        Args:
            task: The task.
            often: Whether it was given to several workers, all of which were killed.
        """


def do_here(queue: WorkQueue[Task, Done], work: Work[Task, Done]) -> None:
    """Do all tasks in this process, on its threads."""
    while (task := queue.take()) is not None:
        queue.give(work(task))
