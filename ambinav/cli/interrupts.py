"""Handling of Ctrl-C and termination, raised only where they reach the caller unchanged.

While machine code runs, a signal waits. The first line of Python after it is often not the
caller's: where a kernel returns a named tuple or raises an error, numba's wrapper calls
`_numba_unpickle`, does not look whether that raised, and goes on. The exception then comes out as
"SystemError: CPUDispatcher(...) returned a result with an exception set", or the process ends by a
segmentation fault. And where Ctrl-C ends a text given to `exec`, as modules do while they are
imported, Python notes that nobody handled it, and kills itself in the end whatever the status is.
What an extension module calls while it is loaded may lose it: Cython drops all that
`abc.ABCMeta.register` raises. And what comes out of a descriptor's `__set_name__`, as of a data
class's fields, Python 3.11 turns into a RuntimeError. So what would be raised in any of these is
raised in the caller instead, before its next instruction.

What finalizers and callbacks of weak references raise, Python prints and drops. An interrupt that
comes back from there is raised again.
"""

from __future__ import annotations

import _imp
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

GLUE: Final = frozenset(
    {
        (__name__, "_raise_again"),
        ("numba.core.serialize", "_numba_unpickle"),
        ("llvmlite.binding.executionengine", "_raw_object_cache_notify"),
        ("llvmlite.binding.executionengine", "_raw_object_cache_getbuffer"),
    }
)
"""Functions, by module and name, whose exceptions their callers in C ignore."""

EXECUTED: Final = ("<string>", "<module>")
"""File and name of a text that is given to `exec`."""

LOADERS: Final = (_imp.create_dynamic, _imp.exec_dynamic)
"""Functions that load extension modules."""


def install() -> None:
    """Make Ctrl-C raise KeyboardInterrupt and termination raise SystemExit(143).

    Where Ctrl-C is ignored, as of a job in the background, it stays so.
    """
    signal.signal(signal.SIGTERM, _terminate)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _raise_again


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise_in_python(frame, KeyboardInterrupt)


def _terminate(number: int, frame: FrameType | None) -> None:
    raise_in_python(frame, lambda: SystemExit(128 + number))


def _raise_again(unraisable: sys.UnraisableHookArgs) -> None:
    error = unraisable.exc_value
    if isinstance(error, KeyboardInterrupt | SystemExit):
        raise_in_python(sys._getframe(), lambda: error)
    else:
        sys.__unraisablehook__(unraisable)


def raise_in_python(frame: FrameType | None, make: Callable[[], BaseException]) -> None:
    """Raise an exception in the interrupted frame, or in a caller if the frame would lose it.

    Args:
        frame: Frame as passed to a signal handler.
        make: Makes the exception.
    """
    caller: FrameType | None = None
    while frame is not None:
        # The outermost one: modules imported while an extension is loaded are lost with it.
        if _loses_exceptions(frame):
            caller = frame.f_back
        frame = frame.f_back
    # Do not disturb a tracing debugger.
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


def _loses_exceptions(frame: FrameType) -> bool:
    """Return whether an exception from a frame fails to reach its caller."""
    code, caller = frame.f_code, frame.f_back
    if caller is None:
        return False
    if code.co_name == "__set_name__" or (code.co_filename, code.co_name) == EXECUTED:
        return True
    if caller.f_code.co_name == "_call_with_frames_removed":
        return caller.f_locals.get("f") in LOADERS
    return (frame.f_globals.get("__name__"), code.co_name) in GLUE
