"""A word to whoever waits at a terminal while kernels are compiled for the first time."""

from __future__ import annotations

import functools
import sys
from typing import Any

from numba.core import event

NOTICE = "ambinav: compiling kernels for this machine; it is done once, and takes a minute or two."


class _Notice(event.Listener):  # type: ignore[misc]
    """Says so at the first kernel of this project that numba has not stored from an earlier run."""

    def __init__(self) -> None:
        self.announced = False

    def on_start(self, begun: Any) -> None:
        kernel = begun.data["dispatcher"].py_func
        if not self.announced and kernel.__module__.partition(".")[0].startswith("ambinav"):
            self.announced = True
            print(NOTICE, file=sys.stderr)

    def on_end(self, ended: Any) -> None:
        """Nothing is to be said."""


@functools.cache
def announce() -> None:
    """Have `NOTICE` printed to stderr, once in a process and only if that is a terminal."""
    if sys.stderr.isatty():
        event.register("numba:compile", _Notice())
