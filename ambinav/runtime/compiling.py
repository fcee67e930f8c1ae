"""Notice at a terminal while kernels are compiled for the first time."""

from __future__ import annotations

import functools
import sys
from typing import Any

from numba.core import event

NOTICE = "ambinav: compiling kernels for this machine; it is done once, and takes a minute or two."


class _Notice(event.Listener):  # type: ignore[misc]
    """Listener that prints at the first kernel of this project without stored machine code."""

    def __init__(self) -> None:
        self.announced = False

    def on_start(self, begun: Any) -> None:
        kernel = begun.data["dispatcher"].py_func
        if not self.announced and kernel.__module__.partition(".")[0].startswith("ambinav"):
            self.announced = True
            print(NOTICE, file=sys.stderr)

    def on_end(self, ended: Any) -> None:
        """Do nothing."""


@functools.cache
def announce() -> None:
    """Print `NOTICE` to stderr once in a process, only if stderr is a terminal."""
    if sys.stderr.isatty():
        event.register("numba:compile", _Notice())
