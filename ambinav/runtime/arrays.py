"""Copies of arrays within kernels, without numba's assignment of slices.

`out[:n] = values` and `out[i] = row` compare shapes and put an error message together, all of it in
machine code: a second and a half of compilation in each process that meets one of them first.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

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
