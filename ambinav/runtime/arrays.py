"""Copies of arrays within kernels, without numba's assignment of slices.

`out[:n] = values` and `out[i] = row` compare shapes and put an error message together, all of it in
machine code: a second and a half of compilation in each process that meets one of them first.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats32
from ambinav.runtime.kernels import kernel


@kernel
def copy_into(out: NDArray[Any], values: NDArray[Any]) -> None:
    """Copy the elements of a C array to the beginning of another one.

    Raises:
        ValueError: `out` has fewer elements.
    """
    target, source = out.reshape(-1), values.reshape(-1)
    if source.size > target.size:
        raise ValueError("there are more values than room for them")
    for k in range(source.size):
        target[k] = source[k]


CACHE_LINE: Final = 64
"""Bytes."""


def line_of_floats(count: int) -> Floats32:
    """Return so many float32 that begin with a cache line: vectors across two take longer."""
    extra = CACHE_LINE // 4
    numbers = np.empty(count + extra, dtype=np.float32)
    begin = -numbers.ctypes.data // 4 % extra
    return numbers[begin : begin + count]
