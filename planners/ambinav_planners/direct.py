"""Kernels called without numba's dispatcher, for callbacks where every call counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def direct(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """The machine code behind a kernel for the types of these arguments.

    Called from Python, a kernel first looks at the types of all its arguments to find the code
    compiled for them; for short motions that takes as long as the motion's cost. What is returned
    skips that, so it must only be called with arguments of exactly these types.

    Args:
        kernel: A function compiled by numba.
        arguments: Some with which it will be called.
    """
    types = tuple(numba.typeof(argument) for argument in arguments)
    kernel.compile(types)
    entry: Callable[..., Any] = kernel.overloads[types].entry_point
    return entry
