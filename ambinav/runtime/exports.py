"""Public names that a module takes from others, and loads when they are first used (PEP 562).

A name is written once, where type checkers read it too:

    if TYPE_CHECKING:
        from ambinav.maps.ambiguity_map import AmbiguityMap as AmbiguityMap
    else:
        __all__, __getattr__, __dir__ = exports(__name__)
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any


def homes(source: str) -> dict[str, str]:
    """Return the module that each public name comes from.

    Args:
        source: Code. Public is what it imports as `from module import name as name`.
    """
    return {
        alias.name: node.module
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
        if alias.asname == alias.name
    }


def exports(
    name: str, extras: Mapping[str, str] = MappingProxyType({})
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a module.

    Args:
        name: Name of the module.
        extras: Packages that a name may need and a user may not have, and the extra of this
            distribution that brings each.
    """
    module = sys.modules[name]
    places = homes(module.__loader__.get_source(name))  # type: ignore[union-attr]

    def load(public: str) -> Any:
        if public not in places:
            raise AttributeError(f"module {name!r} has no attribute {public!r}")
        try:
            value = getattr(importlib.import_module(places[public]), public)
        except ModuleNotFoundError as error:
            extra = extras.get((error.name or "").partition(".")[0])
            if extra is None:
                raise
            reason = f'{public} needs {error.name}; run: pip install "ambinav[{extra}]".'
            raise ImportError(reason, name=error.name) from error
        setattr(module, public, value)
        return value

    names = sorted(places)
    return names, load, names.copy
