"""Plug-in registries: entries of other distributions, and a scenario's own modules.

Every kind of thing that can be added (a layer, a planner, a map reader ...) has one `Registry`, and
all of them have the same three verbs: `register`, `names` and `get`. What is installed is found by
its entry point, so that `pip install my-plugin` is enough; docs/howto/plug-in.md
leads to a page for each kind.
"""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Generic, NamedTuple, TypeVar

from ambinav.config import nearest
from ambinav.runtime.errors import InputError

T = TypeVar("T")


class InstalledEntry(NamedTuple):
    """Entry point: its name, its location ("module:ATTRIBUTE"), its distribution."""

    name: str
    place: str
    distribution: str


class ListedEntry(NamedTuple):
    """An entry of a registry as `ambinav plugins` lists it.

    Attributes:
        name: The name of the entry.
        distribution: Name of the distribution that brings it; None: a module registered it.
        place: Its "module:ATTRIBUTE"; None of our own presets and of what was registered.
        file: The file of a plug-in's module, if it could be imported.
        error: Why it cannot be used; None: it can.
    """

    name: str
    distribution: str | None
    place: str | None = None
    file: str | None = None
    error: str | None = None


class Registry(Generic[T]):
    """Entries of one kind by name: built-in, of installed plug-ins, and registered ones.

    An entry is imported when it is asked for, so that a slow or broken one costs nobody else
    anything.

    Args:
        what: What messages call an entry, such as "layer".
        kind: The class of the entries; `names_of` reads their names.
        group: The group of entry points, such as "ambinav.layers". The name of an entry point is
            the name of its entry.
        own: Our own entries: where each one is, as "module:ATTRIBUTE", or what gives it.
        names_of: The names of an entry; by default its attribute `name` alone.
    """

    def __init__(
        self,
        what: str,
        kind: type[T],
        group: str,
        own: Mapping[str, str | Callable[[], T]],
        names_of: Callable[[T], Iterable[str]] = lambda entry: (entry.name,),  # type: ignore[attr-defined]
    ) -> None:
        self.what = what
        self._kind = kind
        self.group = group
        self._own = dict(own)
        self._names_of = names_of
        self._registered: dict[str, T] = {}

    def register(self, entry: T) -> T:
        """Add an entry until the process ends.

        Returns:
            The entry.

        Raises:
            InputError: there is another one of that name.
        """
        names = tuple(self._names_of(entry))
        for name in names:
            if self._registered.get(name, entry) is not entry or name in self._installed():
                raise InputError(
                    f"{self.what} {name!r}: there is one of that name{self._origin(name)}; "
                    "choose another name."
                )
        self._registered |= dict.fromkeys(names, entry)
        return entry

    def names(self) -> tuple[str, ...]:
        """Return all names: built-in, of installed plug-ins, then registered ones.

        Raises:
            InputError: an installed plug-in has a name that is taken.
        """
        return (*self._installed(), *self._registered)

    def get(self, name: str) -> T:
        """Return the entry of a name.

        Raises:
            InputError: there is none, and the nearest names are offered; or its plug-in cannot be
                loaded, and the message names the distribution.
        """
        if name in self._registered:
            return self._registered[name]
        source = self._installed().get(name)
        if source is None:
            names = self.names()
            offer = nearest(str(name), names) if names else "install a plug-in that brings it"
            raise InputError(f"there is no {self.what} {name!r}; {offer}.")
        if isinstance(source, str):
            return self._checked(_attribute(source), name, source)
        if not isinstance(source, InstalledEntry):
            return source()
        whose = f"{self.what} {name!r} of the plug-in {source.distribution}"
        remedy = f"fix or uninstall {source.distribution}"
        try:
            entry = _attribute(source.place)
        except Exception as error:
            raise InputError(f"{whose} cannot be loaded ({reason(error)}); {remedy}.") from error
        try:
            return self._checked(entry, name, source.place)
        except TypeError as error:
            raise InputError(f"{whose} cannot be used ({error}); {remedy}.") from error

    def listed(self) -> list[ListedEntry]:
        """Return all entries and what brings them; load those of plug-ins, and never raise."""
        own = [
            ListedEntry(name, "ambinav", place if isinstance(place, str) else None)
            for name, place in self._own.items()
        ]
        plugged = [self._listed(point) for point in _entry_points(self.group)]
        return [*own, *plugged, *(ListedEntry(name, None) for name in self._registered)]

    def _listed(self, point: InstalledEntry) -> ListedEntry:
        error = None
        try:
            self.get(point.name)
        except InputError as refusal:
            error = str(refusal)
        module = sys.modules.get(point.place.partition(":")[0])
        file = getattr(module, "__file__", None)
        return ListedEntry(point.name, point.distribution, point.place, file, error)

    def calling(self, name: str) -> Calling:
        """Return a context in which an entry's code is called and its results are checked.

        An exception within becomes an `InputError` that names the plug-in, its function and the
        error. What our own entries raise stays as it is: that is our fault.
        """
        if name in self._registered:
            return Calling(
                f"{self.what} {name!r}, registered by a module", "", self._registered[name]
            )
        source = self._installed().get(name)
        if not isinstance(source, InstalledEntry):
            return Calling()
        whose = f"{self.what} {name!r} of the plug-in {source.distribution}"
        return Calling(whose, f", or uninstall {source.distribution}", self.get(name))

    def _installed(self) -> dict[str, str | Callable[[], T] | InstalledEntry]:
        """Return where the entries are that need no `register`, by name."""
        entries: dict[str, str | Callable[[], T] | InstalledEntry] = dict(self._own)
        for point in _entry_points(self.group):
            other = entries.get(point.name)
            if other is not None:
                raise InputError(
                    f"{self.what} {point.name!r} is both in {_provider(other)} and in "
                    f"{point.distribution}; uninstall one of the two."
                )
            entries[point.name] = point
        return entries

    def _origin(self, name: str) -> str:
        source = self._installed().get(name)
        return "" if source is None else f" in {_provider(source)}"

    def _checked(self, entry: Any, name: str, place: str) -> T:
        if not isinstance(entry, self._kind):
            raise TypeError(
                f"{place} is of the type {type(entry).__name__}, not {self._kind.__name__}"
            )
        names = tuple(self._names_of(entry))
        if name not in names:
            raise TypeError(f"{place} has the name {', '.join(map(repr, names))}, not {name!r}")
        return entry


class Calling:
    """Context manager of `Registry.calling`.

    Args:
        whose: Names the entry; "" for our own, whose exceptions pass.
        remedy: What else can be done than to fix it.
        entry: The entry.
    """

    def __init__(self, whose: str = "", remedy: str = "", entry: object = None) -> None:
        self.whose = whose
        self._remedy = remedy
        self._entry = entry

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Add the plug-in's name to an error.

        Raises:
            InputError: it raised something else, or what it gave is of no use.
        """
        if not (self.whose and isinstance(error, Exception)) or isinstance(error, InputError):
            return
        roots = {
            value.__module__.partition(".")[0]
            for value in vars(self._entry).values()
            if callable(value) and isinstance(getattr(value, "__module__", None), str)
        } - {"ambinav", "ambinav_envs", "ambinav_planners"}
        for frame, _ in traceback.walk_tb(trace):
            if frame.f_globals.get("__name__", "").partition(".")[0] in roots:
                function = frame.f_code.co_qualname
                problem = f"{function} failed ({reason(error)})"
                break
        else:
            problem = f"what it gives cannot be used ({' '.join(str(error).split())})"
        raise InputError(f"{self.whose}: {problem}; fix it{self._remedy}.") from error


def _provider(entry: object) -> str:
    return entry.distribution if isinstance(entry, InstalledEntry) else "ambinav"


@functools.cache
def _entry_points(group: str) -> tuple[InstalledEntry, ...]:
    """Return the entry points of a group, sorted by name; cached for the process."""
    # Not kept as they are: once a process has imported the back-port `importlib_metadata`, the
    # standard library gives entry points of that one's class.
    points = [
        InstalledEntry(point.name, point.value, point.dist.name if point.dist else "unknown")
        for point in importlib.metadata.entry_points(group=group)
    ]
    return tuple(sorted(points))


def _attribute(place: str) -> Any:
    """Return the object that "module:ATTRIBUTE" names."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


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
        module_name = f"ambinav_scenario_{path.stem}_{abs(hash(str(path))):x}"
        if module_name in sys.modules:
            return sys.modules[module_name]
        spec = importlib.util.spec_from_file_location(module_name, path)
        if spec is None or spec.loader is None:
            raise ImportError("it is not a Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[module_name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[module_name]
            raise
        return module
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{name} cannot be imported ({reason(error)}); fix it") from error


def load_callable(source: str, folder: Path) -> Callable[..., Any]:
    """Return the object that `module:callable` or `file.py:callable` names.

    Raises:
        InputError: see `load_module`; or there is no such callable in it.
    """
    module, colon, name = source.rpartition(":")
    if not (colon and module and name):
        raise InputError(f"policy is {source!r}; give module:callable, or file.py:callable")
    function = getattr(load_module(module, folder), name, None)
    if not callable(function):
        raise InputError(f"policy: {module} has no callable {name!r}; check the name")
    return function  # type: ignore[no-any-return]


def called(function: Callable[..., Any], source: str, *arguments: Any) -> Any:
    """Call a function of somebody else and return its result.

    Raises:
        InputError: it takes other arguments, or raised an error; the message gives the error and
            its place.
    """
    _check_signature(function, source, arguments)
    try:
        return function(*arguments)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"policy {source} failed ({reason(error)}); fix it") from error


def _check_signature(function: Callable[..., Any], source: str, arguments: tuple[Any, ...]) -> None:
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        # For functions in C without a signature, their own error must suffice.
        return
    try:
        signature.bind(*arguments)
    except TypeError:
        kinds = ", ".join(type(argument).__name__ for argument in arguments)
        raise InputError(
            f"policy {source} takes {signature}, but is called with {len(arguments)} arguments "
            f"({kinds}); docs/leaderboard.md and docs/compare.md say what they are"
        ) from None


def reason(error: Exception) -> str:
    """Describe an exception briefly: its message, and the line where it occurred."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}, {Path(last.filename).name} line {last.lineno}"
