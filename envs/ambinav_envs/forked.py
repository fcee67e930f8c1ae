"""Whether numba's threads can run at all: not in a process forked from one where they ran."""

from __future__ import annotations

import os
import sys

import numba

from ambinav.errors import InputError

_forked = False


def _note() -> None:
    """In a forked process, note whether numba's threads ran in the one that it was forked from."""
    global _forked
    try:
        layer = numba.threading_layer()
    except ValueError:
        # None ran yet.
        return
    # GNU's OpenMP ends a forked process at its first parallel loop, with no word to Python.
    _forked = layer == "omp" and sys.platform == "linux"


os.register_at_fork(after_in_child=_note)


def refuse_if_forked() -> None:
    """See to it that numba's threads can run.

    Raises:
        InputError: this process was forked from one in which they ran.
    """
    if _forked:
        raise InputError(
            "this process was forked from one in which numba's threads ran, and cannot have any; "
            "start it with the context 'spawn' or 'forkserver'."
        )
