"""Checks of options: contradictions, files to write, points."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ambinav.cli.running import check_file
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.sensing.scanner import RangeScanner

Point = tuple[float, float]


def option_name(name: str) -> str:
    """Return the option of a field or a parameter."""
    return f"--{name.replace('_', '-')}"


@contextlib.contextmanager
def naming_options(*names: str, **options: str | Callable[[int], str]) -> Iterator[None]:
    """Replace a parameter's name at the start of a message by that of its option.

    Errors with a type of their own are left as they are: callers look at more than the message.

    Args:
        names: Parameters whose options have their names.
        options: Other options, by their parameters; for a sequence, a function from an index to
            the name of that item, which is used for the items alone.
    """
    option_of = {name: option_name(name) for name in names} | options
    try:
        yield
    except InputError as error:
        match = re.match(r"(\w+)(?:\[(\d+)\])?(?=:? )", str(error))
        if match is None or match[1] not in option_of or type(error) is not InputError:
            raise
        option, item = option_of[match[1]], match[2]
        if callable(option):
            option = option_name(match[1]) if item is None else option(int(item))
        elif item is not None:
            raise
        raise InputError(option + str(error)[match.end() :]) from error


def check_planar(scanner: RangeScanner) -> None:
    """Refuse a scanner that looks up or down where only plans are supported.

    Raises:
        InputError: it does.
    """
    if scanner.upright[:, 1].any():
        raise InputError(
            f"--scanner: {scanner.name!r} looks up or down, and the choice of beams is known for "
            "plans alone; give a scanner that looks in the plane."
        )


def conflict(option: str, is_given: bool, reason: str) -> None:
    """Refuse an option that has no effect together with the others.

    Raises:
        InputError: it is given.
    """
    if is_given:
        raise InputError(f"{option} {reason}; leave it out.")


def check_suffix(path: Path, name: str, suffixes: tuple[str, ...]) -> None:
    """Check the suffix of a file's name.

    Raises:
        InputError: it ends in something else.
    """
    if path.suffix.lower() not in suffixes:
        if path.is_dir():
            raise InputError(f"{name}: {path} is a folder; name a file in it.")
        raise InputError(
            f"{name}: {path} ends in {path.suffix or 'nothing'!r}; give a file that ends in "
            f"{', '.join(suffixes)}."
        )


def check_picture(picture: Path | None) -> None:
    """Check, before the long work, that a picture can be written; None passes.

    Raises:
        InputError: see `check_suffix` and `check_file`.
    """
    if picture is not None:
        check_suffix(picture, "--picture", (".png", ".pdf", ".svg"))
        check_file(picture)


def check_replaced(output: Path) -> None:
    """Refuse to write a route over a file of another content, such as a building's GeoJSON.

    Raises:
        InputError: there is such a file.
    """
    from ambinav.export.registry import exporter
    from ambinav.routes.files import load_route

    if not output.is_file() or exporter("route", output).read is None:
        return
    try:
        load_route(output)
    except InputError as error:
        from ambinav_planners.flight_file import is_flight

        if not is_flight(output):
            raise InputError(
                f"--output: {output} exists and is not a route; give another name, or remove it."
            ) from error


def points_of(text: str, option: str, example: str) -> list[Point]:
    """Parse points from "x,y x,y x,y".

    Args:
        text: As it was given.
        option: Names it in the message.
        example: Shown there.

    Raises:
        InputError: a point is not two finite numbers, or there is none.
    """
    points = []
    for part in text.split() or [text]:
        try:
            x, y = (float(number) for number in part.split(","))
        except ValueError:
            x = y = math.nan
        if not (math.isfinite(x) and math.isfinite(y)):
            raise InputError(
                f"{option}: {part!r} is not a point; give x,y in metres, and blanks between "
                f"points, e.g. {example}."
            )
        points.append((x, y))
    return points
