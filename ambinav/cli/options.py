"""Arguments and options common to several commands."""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import typer
from typer.models import OptionInfo

from ambinav.cli.running import note

if TYPE_CHECKING:
    from ambinav.store.map_store import MapStore


_ATTRIBUTE = re.compile(r"(\w+)(?: \(([^)]+)\))?: (.*?)(?: \[default: (.*)\])?")


def complete_preset(begun: str) -> list[str]:
    """Return the presets that complete a partly typed name in the shell."""
    from ambinav.sensing.presets import preset_names

    return [name for name in preset_names() if name.startswith(begun)]


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
    str,
    typer.Option("--pictures", metavar="png|svg", help="Format of the pictures in the report."),
]
NoStore = Annotated[
    bool,
    typer.Option(
        "--no-store",
        help="Compute the map even if it is in the store, and do not store it.",
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


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command whose parameters may be option groups: dataclasses.

    The command line has the fields of a group as options, in a panel of the help with the title
    that its `PANEL` gives; the command gets the group. A field without an annotation of its own is
    the option of its name, described by the docstring of the class, under "Attributes":

        spacing (M): Distance between map cells, metres. [default: what the help shows as such]
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {}
    parameters = []
    for parameter in inspect.signature(command).parameters.values():
        kind: Any = hints[parameter.name]
        if not dataclasses.is_dataclass(kind):
            parameters.append(
                parameter.replace(annotation=kind, kind=inspect.Parameter.KEYWORD_ONLY)
            )
            continue
        groups[parameter.name] = kind
        types, described = get_type_hints(kind, include_extras=True), _described(kind)
        for field in dataclasses.fields(kind):
            plain = types[field.name]
            if get_origin(plain) is Annotated:
                plain, info = get_args(plain)
                info = copy.copy(info)  # which commands without the group may share
            else:  # Python without docstrings (-OO) has options without help.
                info = described.get(field.name) or typer.Option(_flag(field.name))
            info.rich_help_panel = vars(kind)["PANEL"]
            parameters.append(
                inspect.Parameter(
                    field.name,
                    inspect.Parameter.KEYWORD_ONLY,
                    default=field.default,
                    annotation=Annotated[plain, info],
                )
            )

    @functools.wraps(command)
    def expanded(**given: Any) -> None:
        for name, kind in groups.items():
            own = {field.name: given.pop(field.name) for field in dataclasses.fields(kind)}
            given[name] = kind(**own)
        command(**given)

    expanded.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    expanded.__annotations__ = {each.name: each.annotation for each in parameters}
    return expanded


def _described(kind: Any) -> dict[str, OptionInfo]:
    """Return the options that the docstrings of a group and of its bases describe, by field."""
    options: dict[str, OptionInfo] = {}
    for base in reversed(kind.__mro__):
        _, _, attributes = (inspect.getdoc(base) or "").partition("\nAttributes:\n")
        for entry in re.split(r"\n(?=    \w)", attributes):
            if (match := _ATTRIBUTE.fullmatch(" ".join(entry.split()))) is not None:
                name, metavar, text, shown = match.groups()
                options[name] = typer.Option(
                    _flag(name), metavar=metavar, help=text, show_default=shown or True
                )
    return options


def _flag(field: str) -> str:
    return f"--{field.replace('_', '-')}"


def store_of(no_store: bool, before_build: Callable[[], None] | None = None) -> MapStore:
    """Return the user's store, which logs to stderr; with `--no-store` one without a folder.

    Raises:
        InputError: see `MapStore.of_user`.
    """
    from ambinav.store.map_store import MapStore

    if no_store:
        return MapStore(None, before_build=before_build)
    return MapStore.of_user(note, before_build)
