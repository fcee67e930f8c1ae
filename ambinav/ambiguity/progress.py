"""A progress bar, a caller's function, or nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def reporter(
    progress: bool | Callable[[float], None], title: str
) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes the share done, from 0 to 1.

    Args:
        progress: True: a bar on standard error; a function: that function; False: nothing.
        title: What the bar is called.
    """
    if callable(progress):
        yield progress
    elif progress:
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=1.0)
            yield lambda share: bar.update(task, completed=share)
    else:
        yield lambda share: None
