"""Code that a scenario brings along: modules that register planners, and policies."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from ambinav.errors import InputError


def load_module(name: str, folder: Path) -> ModuleType:
    """Import a module by its name, or from a file.

    Args:
        name: As `import` takes it, also one in the working folder, or the name of a .py file.
        folder: What a file's name is relative to.

    Raises:
        InputError: there is none, or it cannot be imported.
    """
    try:
        if not name.endswith(".py"):
            # As `python -m` would, but what is installed goes first.
            here = str(Path.cwd())
            if here not in sys.path:
                sys.path.append(here)
            return importlib.import_module(name)
        path = (folder / name).resolve()
        if not path.is_file():
            raise InputError(f"there is no file {folder / name}; give a path relative to the file")
        known = f"ambinav_scenario_{path.stem}_{abs(hash(str(path))):x}"
        if known in sys.modules:
            return sys.modules[known]
        spec = importlib.util.spec_from_file_location(known, path)
        if spec is None or spec.loader is None:
            raise ImportError("it is no Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[known] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[known]
            raise
        return module
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{name} cannot be imported ({_told(error)}); mend it") from error


def load_callable(told: str, folder: Path) -> Callable[..., Any]:
    """What `module:callable` or `file.py:callable` names.

    Raises:
        InputError: see `load_module`; or there is no such callable in it.
    """
    module, colon, name = told.rpartition(":")
    if not (colon and module and name):
        raise InputError(f"policy is {told!r}; give module:callable, or file.py:callable")
    found = getattr(load_module(module, folder), name, None)
    if not callable(found):
        raise InputError(f"policy: {module} has no callable {name!r}; check the name")
    return found  # type: ignore[no-any-return]


def called(function: Callable[..., Any], told: str, *arguments: Any) -> Any:
    """The outcome of somebody else's function.

    Raises:
        InputError: it takes other arguments, or raised something; the message says what and where.
    """
    _check_signature(function, told, arguments)
    try:
        return function(*arguments)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"policy {told} failed ({_told(error)}); mend it") from error


def _check_signature(function: Callable[..., Any], told: str, arguments: tuple[Any, ...]) -> None:
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        # Written in C, say: its own error must do.
        return
    try:
        signature.bind(*arguments)
    except TypeError:
        kinds = ", ".join(type(one).__name__ for one in arguments)
        raise InputError(
            f"policy {told} takes {signature}, but is called with {len(arguments)} arguments "
            f"({kinds}); docs/leaderboard.md and docs/compare.md say what they are"
        ) from None


def _told(error: Exception) -> str:
    """An exception in a few words: what, and in which line it came up."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}, {Path(last.filename).name} line {last.lineno}"
