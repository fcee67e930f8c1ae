"""Arguments and options that several commands take."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from ambinav.cli.running import Progress, above_zero, not_negative, note
from ambinav.errors import InputError

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.store.map_store import MapStore

LONG_SECONDS = 60.0
"""A map that takes longer is announced."""
LARGE_BYTES = 4e9
"""A map that takes more memory is announced."""


def _complete_preset(begun: str) -> list[str]:
    """Presets that the shell offers to complete what was begun with."""
    from ambinav.sensing.presets import preset_names

    return [name for name in preset_names() if name.startswith(begun)]


MapFile = Annotated[
    Path,
    typer.Argument(
        metavar="MAP",
        help="The building: a map_server .yaml, a .geojson or a .wkt file.",
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
        autocompletion=_complete_preset,
    ),
]
Level = Annotated[
    str | None,
    typer.Option(
        "--level",
        metavar="NAME|INDEX",
        help="The floor of a plan whose features have several levels.",
        show_default="the only one",
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        "--unit",
        metavar="m|cm|mm",
        help="What a drawn plan's coordinates are in.",
        show_default="metres, where they make a building",
    ),
]
Spacing = Annotated[
    float, typer.Option("--spacing", metavar="M", help="Distance between map cells, metres.")
]
Radius = Annotated[
    float,
    typer.Option(
        "--ambiguity-radius",
        metavar="M",
        help="How far around a pose its scan is compared with others, metres.",
    ),
]
Headings = Annotated[
    int | None,
    typer.Option(
        "--headings",
        metavar="N",
        help="Number of headings that the map has.",
        show_default="the scanner decides",
    ),
]
MapStd = Annotated[
    float | None,
    typer.Option(
        "--map-std",
        metavar="M",
        help="Standard deviation of the walls in the map, metres.",
        show_default="0.03 for occupancy maps, 0.02 for drawings",
    ),
]
Layers = Annotated[
    str | None,
    typer.Option(
        "--layers",
        metavar="NAMES",
        help="Further layers, e.g. fisher,gfm; all: those that the scanner can have, but aliasing.",
        show_default="none",
    ),
]
RobotRadius = Annotated[
    float | None,
    typer.Option(
        "--robot-radius",
        metavar="M",
        help="Of the disc that covers the robot, metres; floor that it cannot reach does not "
        "count.",
        show_default="the scanner's robot_radius, or 0.2",
    ),
]
Start = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--start",
        metavar="X Y",
        help="Where the robot starts, map frame, metres.",
        show_default="the largest piece of floor",
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
        help="Compute the map, though it may have been computed before, and do not keep it.",
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
]


Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Let a policy drive another scanner or robot than it was trained with; what differs "
        "is said.",
    ),
]


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters may be groups of options: dataclasses with typer's annotations.

    The command line has the fields of a group as options, in a panel of the help with the title
    that its `PANEL` gives; the command gets the group.
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
        types = get_type_hints(kind, include_extras=True)
        for field in dataclasses.fields(kind):
            get_args(types[field.name])[1].rich_help_panel = vars(kind)["PANEL"]
            parameters.append(
                inspect.Parameter(
                    field.name,
                    inspect.Parameter.KEYWORD_ONLY,
                    default=field.default,
                    annotation=types[field.name],
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


def check_pictures(image_format: str) -> None:
    """Check the value of --pictures.

    Raises:
        InputError: there is no such format.
    """
    from ambinav.plotting.style import FORMATS

    if image_format not in FORMATS:
        raise InputError(f"--pictures: {image_format!r} is no format; give {' or '.join(FORMATS)}.")


def check_plan_options(map_file: object, level: str | None, unit: str | None) -> None:
    """Check that --level and --unit come with a building.

    Raises:
        InputError: they come without.
    """
    for option, value in (("--level", level), ("--unit", unit)):
        if value is not None and not map_file:
            raise InputError(f"{option}: {value!r} says something of a plan; give it with --map.")


def check_numbers(
    spacing: float, radius: float, headings: int | None, map_std: float | None
) -> None:
    """Check what can be checked before the map is read.

    Raises:
        InputError: an option has a value that cannot be used.
    """
    above_zero(spacing, "--spacing", "0.1")
    above_zero(radius, "--ambiguity-radius", "0.5")
    not_negative(map_std, "--map-std", "0.05")
    if headings is not None and headings < 1:
        raise InputError(f"--headings: {headings} is not a number of headings; give 1 or more.")


def layer_names(layers: str | None, scanner: str) -> tuple[str, ...]:
    """The names in `--layers`, checked before the map is read.

    Raises:
        InputError: there is no such layer, or the scanner cannot be used or cannot have it.
    """
    if layers is None:
        return ()
    from ambinav.ambiguity.layers.registry import chosen_layers
    from ambinav.sensing.scanner import RangeScanner

    names = [name.strip() for name in layers.split(",")]
    return tuple(layer.name for layer in chosen_layers(names, RangeScanner.load(scanner)))


def load(
    map_file: Path,
    scanner: str,
    spacing: float,
    level: str | None = None,
    unit: str | None = None,
) -> tuple[Environment, RangeScanner]:
    """Load the building and the scanner, the scanner first: it is the quicker to be wrong.

    Raises:
        InputError: one cannot be used, or the spacing exceeds the building.
    """
    from ambinav.geometry.io.load import load_environment
    from ambinav.sensing.presets import preset_names
    from ambinav.sensing.scanner import RangeScanner

    chosen = RangeScanner.load(scanner)
    if str(map_file) in preset_names():
        raise InputError(
            f"{map_file}: this is a scanner preset, not a building; give it with --scanner."
        )
    environment = load_environment(map_file, level=level, unit=unit)
    xmin, ymin, xmax, ymax = environment.bounds
    if spacing > max(xmax - xmin, ymax - ymin):
        raise InputError(
            f"--spacing: {spacing:g} m is larger than the building in {map_file} "
            f"({xmax - xmin:.3g} x {ymax - ymin:.3g} m); give less, e.g. 0.1."
        )
    return environment, chosen


def announce(
    environment: Environment,
    scanner: RangeScanner,
    *,
    spacing: float,
    radius: float,
    headings: int | None,
    layers: tuple[str, ...] = (),
) -> None:
    """Say on stderr, before a map that takes long is begun, how long and how much memory.

    And what a wider spacing would make of it.
    """
    from ambinav.ambiguity.estimate import coarser, estimate

    if not 0.0 < spacing <= radius:
        return  # which `build_map` refuses
    needs = estimate(environment, scanner, spacing, radius, headings)
    if needs.seconds < LONG_SECONDS and needs.bytes < LARGE_BYTES:
        return
    wider = coarser(environment, scanner, spacing, radius, headings, LONG_SECONDS)
    remedy = "" if wider is None else f"; with --spacing {wider.spacing:g} {wider}"
    if needs.bytes > os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"):
        remedy = f", more than this computer has{remedy}"
    besides = ", the further layers not counted" if layers else ""
    headed = "" if needs.headings == 1 else f" with {needs.headings} headings"
    millions = needs.poses / 1e6
    poses = f"{millions:.0f}" if millions >= 10.0 else f"{millions:.2g}"
    note(
        f"this map takes {needs} ({poses} million poses{headed}, each compared with "
        f"{needs.neighbours:.0f} others by {needs.beams} beams{besides}){remedy}."
    )


def make_map(
    environment: Environment,
    scanner: RangeScanner,
    *,
    spacing: float,
    radius: float,
    headings: int | None,
    map_std: float | None,
    progress: Progress,
    layers: tuple[str, ...] = (),
    robot_radius: float = 0.0,
    no_store: bool = False,
) -> AmbiguityMap:
    """Open the map from the store, or announce, build and keep it.

    Raises:
        InputError: an option does not suit this building, or see `MapStore.of_user`.
    """
    from ambinav.ambiguity.build import build_map

    def before_build() -> None:
        announce(
            environment, scanner, spacing=spacing, radius=radius, headings=headings, layers=layers
        )

    return build_map(
        environment,
        scanner,
        spacing=spacing,
        radius=radius,
        headings=headings,
        map_std=map_std,
        progress=progress,
        layers=layers,
        robot_radius=robot_radius,
        store=store_of(no_store, before_build),
    )


def store_of(no_store: bool, before_build: Callable[[], None] | None = None) -> MapStore:
    """The user's store, which says on stderr what it does; with `--no-store` one without a folder.

    Raises:
        InputError: see `MapStore.of_user`.
    """
    from ambinav.store.map_store import MapStore

    if no_store:
        return MapStore(None, before_build=before_build)
    return MapStore.of_user(note, before_build)
