"""Ctrl-C and termination, raised only where they come out as what they are.

While machine code runs, a signal waits. The first line of Python after it is often not the
caller's: where a kernel returns a named tuple or raises an error, numba's wrapper calls
`_numba_unpickle`, does not look whether that raised, and goes on. The exception then comes out as
"SystemError: CPUDispatcher(...) returned a result with an exception set", or the process ends by a
segmentation fault. And where Ctrl-C ends a text given to `exec`, as modules do while they are
imported, Python notes that nobody handled it, and kills itself in the end whatever the status is.
So what would be raised there is raised in the caller instead, before its next instruction.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

GLUE: Final = frozenset(
    {
        ("numba.core.serialize", "_numba_unpickle"),
        ("llvmlite.binding.executionengine", "_raw_object_cache_notify"),
        ("llvmlite.binding.executionengine", "_raw_object_cache_getbuffer"),
    }
)
"""Functions, by module and name, whose exceptions their callers in C ignore."""


def install() -> None:
    """Let Ctrl-C raise KeyboardInterrupt and termination SystemExit(143).

    Where Ctrl-C is ignored, as of a job in the background, it stays so.
    """
    signal.signal(signal.SIGTERM, _terminate)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise_in_python(frame, KeyboardInterrupt)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise_in_python(frame, lambda: SystemExit(128 + number))


def raise_in_python(frame: FrameType | None, make: Callable[[], BaseException]) -> None:
    """Raise an exception in the frame that was interrupted, or where that is no use in its caller.

    Args:
        frame: As a handler of signals is given it.
        make: Makes the exception.
    """
    inner: FrameType | None = frame
    while inner is not None and not _is_deaf(inner):
        inner = inner.f_back
    caller = None if inner is None else inner.f_back
    # A debugger that traces is not disturbed.
    if caller is None or sys.gettrace() is not None:
        raise make()

    def trace(at: FrameType, event: str, argument: Any) -> Any:
        if at is not caller:
            return None
        sys.settrace(None)
        caller.f_trace = None
        raise make()

    caller.f_trace = trace
    caller.f_trace_opcodes = True
    sys.settrace(trace)


def _is_deaf(frame: FrameType) -> bool:
    """Whether an exception out of a frame does not reach its caller."""
    code = frame.f_code
    if (code.co_filename, code.co_name) == ("<string>", "<module>"):
        return True
    return (frame.f_globals.get("__name__"), code.co_name) in GLUE
