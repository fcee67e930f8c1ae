"""Arrays by their address: how a kernel looks at buildings that come and go.

numba counts references to the arrays that it is given, in memory that all threads share. An array
made of an address has no count, and making one costs nothing. Whoever stores an address must keep
the array alive: `simulation.site` does.
"""

from __future__ import annotations

from typing import Any

from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:
    """An integer as a pointer to anything."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), code


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def array_at(address, shape, dtype):
    """The C-contiguous array of a shape and a type that lies at an address."""
    return carray(_pointer(address), shape, dtype)
