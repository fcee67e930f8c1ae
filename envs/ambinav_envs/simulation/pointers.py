"""Arrays by their address: how a kernel looks at buildings that come and go.

numba counts references to the arrays that it is given, in memory that all threads share. An array
made of an address has no count, and making one costs nothing. Whoever stores an address must keep
the array alive: `simulation.site` does.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from ambinav.kernels import kernel


def address(array: NDArray[Any], dtype: Any) -> int:
    """Where an array lies, for kernels that take it for C-contiguous and of this type."""
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"an array is {array.dtype}, {array.flags}; a kernel wants {dtype}")
    # Half as long as array.ctypes.data.
    return int(array.__array_interface__["data"][0])


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:
    """An integer as a pointer to anything."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), code


@intrinsic
def borrowed(typing_context: Any, arrays: Any) -> Any:
    """An array, or a tuple of such, without counts of references.

    For the loops of a kernel whose caller keeps the arrays: counting takes longer than the rest,
    and threads that count the references of the same array wait for each other.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _uncounted(context, builder, arrays, arguments[0])

    return arrays(arrays), code


def _uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The code of `borrowed`."""
    if isinstance(kind, types.BaseTuple):
        for k, part in enumerate(kind):
            one = _uncounted(context, builder, part, builder.extract_value(value, k))
            value = builder.insert_value(value, one, k)
        return value
    if not isinstance(kind, types.Array):
        return value
    array = context.make_array(kind)(context, builder, value)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    return array._getvalue()


@kernel(inline="always")
def array_at(address, shape, dtype):
    """The C-contiguous array of a shape and a type that lies at an address."""
    return carray(_pointer(address), shape, dtype)


@intrinsic
def fetch(typing_context: Any, address: Any) -> Any:
    """Ask for the memory at an address, any at all, so that it is there when it is wanted."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[0], cgutils.voidptr_t)
        word = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, word, word, word])
        known = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        # To read it, often, as data.
        builder.call(known, [pointer, word(0), word(3), word(1)])
        return context.get_dummy_value()

    return types.void(types.int64), code
