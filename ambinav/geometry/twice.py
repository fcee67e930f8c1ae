"""One kernel compiled twice: for one thread, which starts at once, and for all of them."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import njit


def serial_and_parallel(function: Callable[..., Any]) -> tuple[Any, Any]:
    """Compile a function whose loops say `prange` without and with threads.

    numba stores machine code by the function's name, whatever it was compiled for; under one name
    the code for all threads would be loaded for one, and the other way round.
    """
    if not isinstance(function, FunctionType):
        raise TypeError(f"{function!r} is no plain function")
    other = FunctionType(function.__code__, function.__globals__, function.__name__)
    other.__module__ = function.__module__
    other.__qualname__ = f"{function.__qualname__}_parallel"
    options = {"cache": True, "nogil": True, "error_model": "numpy"}
    return njit(**options)(function), njit(parallel=True, **options)(other)
