"""Arguments and options common to several commands."""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, get_args, get_origin, get_type_hints

import typer
from typer.models import ParameterInfo

from ambinav.cli.checks import option_name
from ambinav.cli.limits import Limit
from ambinav.cli.running import INTERRUPTED, note, reporting, say

if TYPE_CHECKING:
    from ambinav.store.map_store import MapStore


_ENTRY = re.compile(r"(\w+)(?: \(([^)]+)\))?: (.*?)(?: \[default: (.*)\])?")


def completing(module: str, names: Callable[[Any], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a shell completion by names that are read from a module, imported only then."""
    return lambda incomplete: [
        name for name in names(import_module(module)) if name.startswith(incomplete)
    ]


complete_preset = completing("ambinav.sensing.presets", lambda presets: presets.preset_names())
MapFile = Annotated[
    Path,
    typer.Argument(
        metavar="MAP",
        help="The building: a map_server .yaml, a .geojson, .wkt, .ifc or .dxf file.",
        show_default=False,
    ),
]
StoredMap = Annotated[
    str,
    typer.Argument(
        metavar="MAP.zarr",
        help="An ambiguity map made by `ambinav map`: a folder, or a URL such as "
        "s3://maps/office.zarr.",
        show_default=False,
    ),
]
Scanner = Annotated[
    str,
    typer.Option(
        "--scanner",
        "-s",
        metavar="PRESET|FILE",
        help="A preset (see `ambinav presets`) or a scanner .yaml file.",
        show_default=False,
        autocompletion=complete_preset,
    ),
]
ReportFolder = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="DIR",
        help="Folder for the report; an earlier one there is replaced.",
        show_default="only printed",
    ),
]
Pictures = Annotated[
    str, typer.Option("--pictures", metavar="png|svg", help="Format of the pictures in the report.")
]
NoStore = Annotated[
    bool,
    typer.Option(
        "--no-store", help="Compute the map even if it is in the store, and do not store it."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print only the result, as JSON, on stdout.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print neither progress nor result; only write files.")
]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Accept a policy that was trained with another scanner or robot; differences are "
        "printed.",
    ),
]

Trust = Annotated[
    bool,
    typer.Option(
        "--trust",
        help="Run code of others with your rights: policies that are module:callable or files of "
        "model.save, localizers of the type program. Policy files hold no code and do not need it.",
    ),
]


def documented(command: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command whose docstring describes its options.

    A parameter without an annotation of typer's is the option of its name; metavar, help and shown
    default of an option or an argument without help are those of its entry under "Parameters":

        spacing (M): Distance between map cells, metres. [default: what the help shows as such]

    A parameter may also be an option group: a dataclass, whose fields are options in a panel of the
    help with the title that its `PANEL` gives, described by its docstring under "Attributes"; the
    command gets the group.

    A `Limit` in the annotation of a parameter or a field is checked before the command runs.
    """
    hints = get_type_hints(command, include_extras=True)
    text, _, entries_text = (inspect.getdoc(command) or "").partition("\n\nParameters:\n")
    groups: dict[str, Any] = {}
    limits: list[tuple[str, str, Limit]] = []
    parameters = []
    for parameter in inspect.signature(command).parameters.values():
        kind: Any = hints[parameter.name]
        if not dataclasses.is_dataclass(kind):
            plain, info = _described(parameter.name, kind, _entries(entries_text), limits)
            parameters.append(
                parameter.replace(
                    annotation=Annotated[plain, info], kind=inspect.Parameter.KEYWORD_ONLY
                )
            )
            continue
        groups[parameter.name] = kind
        types, entries = get_type_hints(kind, include_extras=True), _entries_of(kind)
        for field in dataclasses.fields(kind):
            plain, info = _described(field.name, types[field.name], entries, limits)
            info.rich_help_panel = groups[parameter.name].PANEL
            parameters.append(
                inspect.Parameter(
                    field.name,
                    inspect.Parameter.KEYWORD_ONLY,
                    default=(
                        inspect.Parameter.empty
                        if field.default is dataclasses.MISSING
                        else field.default
                    ),
                    annotation=Annotated[plain, info],
                )
            )

    @functools.wraps(command)
    def expanded(**values: Any) -> None:
        with reporting():
            for name, option, limit in limits:
                limit.check(values[name], option)
        for name, kind in groups.items():
            members = {field.name: values.pop(field.name) for field in dataclasses.fields(kind)}
            values[name] = kind(**members)
        try:
            command(**values)
        except KeyboardInterrupt:
            # While the command imports what it runs: typer would exit without a word.
            say("ambinav: interrupted.")
            raise typer.Exit(INTERRUPTED) from None

    expanded.__doc__ = text
    expanded.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    expanded.__annotations__ = {each.name: each.annotation for each in parameters}
    return expanded


def _described(
    name: str, kind: Any, entries: Mapping[str, re.Match[str]], limits: list[tuple[str, str, Limit]]
) -> tuple[Any, Any]:
    """Return the type of a parameter, and its option or argument with the text of its entry.

    Args:
        name: Name of the parameter.
        kind: Its annotation.
        entries: Entries of the docstring.
        limits: Gets the parameter's limits, each with the name of the parameter and the option.
    """
    plain, *marks = get_args(kind) if get_origin(kind) is Annotated else (kind,)
    infos = [mark for mark in marks if isinstance(mark, ParameterInfo)]
    # Which other commands may share.
    info: Any = copy.copy(infos[0]) if infos else typer.Option(option_name(name))
    # In an annotation typer keeps the first name as the default.
    names = (info.default, *(info.param_decls or ()), option_name(name))
    option = next(text for text in map(str, names) if text.startswith("--"))
    limits += [(name, option, mark) for mark in marks if isinstance(mark, Limit)]
    if info.parser is None:
        info.parser = _PARSERS.get(frozenset(_leaves(plain)))
    # Python without docstrings (-OO) has options without help.
    if info.help is None and name in entries:
        info.metavar, info.help, shown = entries[name].groups()[1:]
        info.show_default = shown or info.show_default
    return plain, info


def _number(text: Any) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not a number; leave units and % out, and write decimals with a point, as "
            "in 0.25."
        ) from None


def _whole_number(text: Any) -> int:
    number = _number(text)
    if not number.is_integer():
        raise typer.BadParameter(f"{text!r} is not a whole number; give one, such as 12.")
    # Exact beyond the digits of a float.
    return int(text) if str(text).strip().lstrip("+-").isdecimal() else int(number)


_PARSERS: Final = {frozenset({float}): _number, frozenset({int}): _whole_number}


def _leaves(kind: Any) -> set[Any]:
    """Return the types that a type is made of, without None."""
    parts = get_args(kind)
    return set().union(*map(_leaves, parts)) if parts else {kind} - {type(None)}


def _entries_of(kind: Any) -> dict[str, re.Match[str]]:
    """Return the entries in the docstrings of a group and of its bases, by field."""
    entries: dict[str, re.Match[str]] = {}
    for base in reversed(kind.__mro__):
        entries |= _entries((inspect.getdoc(base) or "").partition("\nAttributes:\n")[2])
    return entries


def _entries(section: str) -> dict[str, re.Match[str]]:
    """Return the entries in a section of a docstring, by the name that each begins with."""
    texts = (" ".join(entry.split()) for entry in re.split(r"\n(?=    \w)", section))
    return {match[1]: match for match in map(_ENTRY.fullmatch, texts) if match is not None}


def store_of(no_store: bool, before_build: Callable[[], None] | None = None) -> MapStore:
    """Return the user's store, which logs to stderr; with `--no-store` one without a folder.

    Raises:
        InputError: see `MapStore.of_user`.
    """
    from ambinav.store.map_store import MapStore

    if no_store:
        return MapStore(None, before_build=before_build)
    return MapStore.of_user(note, before_build)
