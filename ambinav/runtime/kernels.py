"""`@kernel`: functions compiled by numba, cached on disk, recompiled when a callee changes.

numba's own cache (`cache=True`) looks at the age of the file that holds the function alone: after
an edit of a kernel in another file, or of a constant that comes from there, its callers go on with
the old machine code, and a file that was only touched is compiled anew. Here the stored code is
stamped with a digest of all that went into it, which a copy, a branch or a comment leaves as it is.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any, overload

import numpy as np
from llvmlite.binding import Linkage
from numba import carray, njit, typeof, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.extending import intrinsic


@overload
def kernel(function: Callable[..., Any], /) -> Any: ...


@overload
def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]: ...


def kernel(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function that releases the interpreter lock, with numpy's rules of division.

    Used bare (`@kernel`) or with options of `numba.njit` (`@kernel(inline="always")`). Of these
    `_nrt=False` leaves out counting references, which numba does wherever arrays and parts of them
    are handed on: for kernels that make no array, called by those who hold what they hand on. Rays
    through prisms are 1.4 times as fast so.
    """

    def decorate(plain: Callable[..., Any]) -> Any:
        # `_nrt` (count references to arrays) is given explicitly: else a callee would inherit it
        # from whichever caller is compiled first. An entry for C, which each function would get
        # beside that for Python, is called by nobody.
        defaults = {
            "nogil": True, "error_model": "numpy", "_nrt": True, "no_cfunc_wrapper": True,
        }  # fmt: skip
        compiled = njit(pipeline_class=_Compiler, **{**defaults, **options})(plain)
        compiled._cache = _CalleeCache(plain, compiled.targetoptions)
        compiled.get_call_template = _any_value(compiled.get_call_template)
        return compiled

    return decorate if function is None else decorate(function)


def digest(function: FunctionType, options: Mapping[str, Any] | None = None) -> str:
    """Compute SHA-256 over a kernel's code, all kernels it calls, and the constants they read.

    What numba freezes into machine code counts: byte code, defaults, compile options, the values
    of global names and of closures. Of objects of other packages the names do; numba's version,
    which its cache looks at itself, and numpy's stand for what is in them.

    Args:
        function: What the kernel was made of.
        options: How it is compiled (`targetoptions` of the kernel).
    """
    # Stored code that calls shared copies of callees (before `_Library`) is not loaded.
    parts: dict[str, bytes] = {"numpy": np.__version__.encode(), "callees": b"private"}
    if options is not None:
        parts[f"{_name(function)}: options"] = _constant(dict(options))
    todo: list[Any] = [function]
    while todo:
        callee = todo.pop()
        if isinstance(callee, Dispatcher):
            # How a callee is compiled shows in its callers: inlining, fastmath.
            options, callee = callee.targetoptions, callee.py_func
            parts[f"{_name(callee)}: options"] = _constant(options)
        if _name(callee) in parts:
            continue
        parts[_name(callee)] = _code(callee.__code__) + _constant(callee.__defaults__)
        for key, value in _values(callee):
            called = isinstance(value, FunctionType) and _is_ours(value, function)
            if called or isinstance(value, Dispatcher):
                todo.append(value)
            elif isinstance(value, ModuleType) or callable(value):
                if isinstance(value, _Intrinsic):
                    # Hash the intrinsic's Python source, which no kernel's byte code contains.
                    module = sys.modules[value._defn.__module__]
                    parts[f"{_name(callee)}: {key}: source"] = inspect.getsource(module).encode()
                # For a named tuple the order of the fields counts too.
                origin = [getattr(value, name, "") for name in ("__module__", "__name__")]
                parts[f"{_name(callee)}: {key}"] = _constant(
                    [origin, getattr(value, "_fields", ())]
                )
            else:
                parts[f"{_name(callee)}: {key}"] = _constant(value)
    checksum = hashlib.sha256()
    for name in sorted(parts):
        checksum.update(name.encode() + b"\0" + parts[name] + b"\0")
    return checksum.hexdigest()


def machine_code(compiled: Any, *arguments: Any) -> Callable[..., Any]:
    """Return a kernel's machine code for arguments of these types, for direct calls.

    Called from Python, a kernel first looks at the types of all its arguments to find the code
    compiled for them; for a short motion that takes as long as integrating its cost. What is
    returned skips that, so it must only be called with arguments of exactly these types.

    Args:
        compiled: A kernel.
        arguments: Some with which it will be called.
    """
    kinds = tuple(typeof(argument) for argument in arguments)
    compiled.compile(kinds)
    entry: Callable[..., Any] = compiled.overloads[kinds].entry_point
    return entry


def _any_value(get_call_template: Callable[..., Any]) -> Callable[..., Any]:
    """Let a kernel that others call with constants be compiled once, not for each constant."""

    def unliteral(args: Iterable[Any], kws: Mapping[str, Any]) -> Any:
        return get_call_template(
            tuple(map(types.unliteral, args)),
            {name: types.unliteral(kind) for name, kind in kws.items()},
        )

    return unliteral


class _Compiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, with machine code that calls none of another kernel's."""

    def __init__(self, typing: Any, target: Any, library: Any, *rest: Any) -> None:
        super().__init__(typing, target, library, *rest)
        if library is None:
            self.state.library = _Library(target.codegen(), "kernel")
            self.state.library.enable_object_caching()


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """Machine code of a kernel, whose copies of its callees are its own.

    numba compiles a copy of each callee along with a kernel, optimized anew, under the callee's
    name. Of the copies in a process the one that was made or loaded first serves all callers, so
    that results would differ in the last bit between a process that compiles and one that loads.
    Private, a copy has no name to others: LLVM may change its arguments, and a function of somebody
    else that calls the same callee must not be led to it.
    """

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.private
        super()._optimize_final_module()


class _CalleeCache(FunctionCache):  # type: ignore[misc]
    """Numba's store of a function's machine code, valid only for one `digest`."""

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        super().__init__(function)
        self._options = options
        self._stamped = False
        self._cache_file.__class__ = _Index

    def _stamp(self) -> None:
        # Not before the first call: callees further down in the file do not stand yet.
        if not self._stamped:
            self._cache_file._source_stamp = digest(self._py_func, self._options)
            self._stamped = True

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        self._stamp()
        return super()._load_overload(sig, target_context)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # To numba all named tuples of a class are of one type, whatever the order of their fields.
        return *super()._index_key(sig, codegen), _fields(getattr(sig, "args", sig))

    def _save_overload(self, sig: Any, data: Any) -> None:
        self._stamp()
        # numba counts the files up. Two processes that compile for different arguments would come
        # to the same number, and one would be handed the other's machine code.
        mark = hashlib.sha256(str(sig).encode()).hexdigest()[:16]
        base = self._impl.filename_base
        self._cache_file._data_name_pattern = f"{base}.{mark}.{{number:d}}.nbc"
        super()._save_overload(sig, data)


class _Index(IndexDataCacheFile):  # type: ignore[misc]
    """Index of stored machine code; empty where it names a class that has moved."""

    def _load_index(self) -> dict[Any, str]:
        try:
            return dict(super()._load_index())
        except (ImportError, AttributeError):
            return {}


def _fields(kinds: Iterable[Any]) -> tuple[Any, ...]:
    """Return the field names of all named tuples among types, and of those within."""
    return tuple(
        (getattr(kind, "fields", ()), _fields(kind.types))
        for kind in kinds
        if isinstance(kind, types.BaseTuple)
    )


def _values(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the globals, names in modules of the package, and closures that a function reads."""
    names = _names(function.__code__)
    for name in sorted(names & function.__globals__.keys()):
        value = function.__globals__[name]
        yield name, value
        if isinstance(value, ModuleType) and _is_ours(value, function):
            for attribute in sorted(names & vars(value).keys()):
                yield f"{name}.{attribute}", vars(value)[attribute]
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    for name, cell in cells:
        yield name, cell.cell_contents


def _name(function: FunctionType) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def _is_ours(thing: ModuleType | FunctionType, function: FunctionType) -> bool:
    """Return whether a module or function is of this project, or of a function's package."""
    name = thing.__name__ if isinstance(thing, ModuleType) else thing.__module__
    top = name.partition(".")[0]
    return top.startswith("ambinav") or top == function.__module__.partition(".")[0]


def _nested(code: CodeType) -> list[CodeType]:
    """Return the code objects within one: of functions and comprehensions in its body."""
    return [constant for constant in code.co_consts if isinstance(constant, CodeType)]


def _names(code: CodeType) -> set[str]:
    """Return all names in a code object that may be globals or attributes."""
    return set(code.co_names).union(*(_names(inner) for inner in _nested(code)))


def _code(code: CodeType) -> bytes:
    """Return bytes that identify the behaviour of a code object, independent of its location."""
    plain = [c for c in code.co_consts if not isinstance(c, CodeType)]
    names = (code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_argcount)
    return b"\0".join(
        [code.co_code, repr(names).encode(), *map(_constant, plain), *map(_code, _nested(code))]
    )


def _constant(value: Any) -> bytes:
    """Serialize a value that numba freezes, so that equal values give equal bytes."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}".encode() + value.tobytes()
    if isinstance(value, set | frozenset):
        return b"{" + b",".join(sorted(map(_constant, value))) + b"}"
    if isinstance(value, dict):
        return _constant({(key, _constant(item)) for key, item in value.items()})
    if isinstance(value, tuple | list):
        return b"(" + b",".join(map(_constant, value)) + b")"
    return f"{type(value).__name__} {value!r}".encode()


@intrinsic
def _float32_pointer(_: Any, address: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float32)(address), build


@kernel(inline="always")
def float32_at(address: Any, shape: Any) -> Any:
    """Return the C array of float32 at an address, for kernels; the caller keeps it alive."""
    return carray(_float32_pointer(address), shape)
