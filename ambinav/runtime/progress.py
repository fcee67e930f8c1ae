"""Reports of how far long work is."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

Progress = Callable[[float], None]
"""Takes the share of the work that is done, 0 to 1."""
Stages = Callable[[str], Progress]
"""Begins a stage of the work, named by a text, and returns the progress of that stage."""


def silent(share: float) -> None:
    """Report no progress."""


def silent_stages(text: str) -> Progress:
    """Begin a stage whose progress is not reported."""
    return silent


def within(progress: Progress, low: float, high: float) -> Progress:
    """Return the progress of a part of the work, which leads from one share to another."""
    return lambda share: progress(low + (high - low) * share)


def step_of(progress: Progress, done: int, count: int) -> Progress:
    """Return the progress of the step after `done` of `count` equal ones."""
    return lambda share: progress((done + share) / count)


@contextlib.contextmanager
def reporter(progress: bool | Progress, title: str) -> Iterator[Progress]:
    """Yield a function that takes the completed share, from 0 to 1.

    Args:
        progress: True: a bar on standard error; a function: that function; False: nothing.
        title: What the bar is called.
    """
    if callable(progress):
        yield progress
    elif progress:
        from rich.console import Console
        from rich.progress import Progress as Bars

        with Bars(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=1.0)
            yield lambda share: bar.update(task, completed=share)
    else:
        yield silent
