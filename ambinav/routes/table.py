"""CSV format of a route: figures in comment lines, then one line per pose."""

from __future__ import annotations

import csv
import io
import json
from typing import Any, Final

from ambinav.config import checked
from ambinav.routes.record import Figures, Waypoint, figures, route_of, waypoints
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError

COLUMNS: Final = ("x", "y", "theta", "distance", "cost", "level", "zone")
STAMP: Final = ("stamp",)
"""Further column of a route with stamps."""
COVARIANCE: Final = ("cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")
"""Further columns of a route with predicted covariances: the upper triangle."""
IN_SPACE: Final = "it is a route through space; give one of a robot on the floor."
"""Fault of a flight where a route is needed."""

Line = tuple[int, list[str]]
"""The number of a line, and its cells."""

_REMARK: Final = (
    "## x, y, distance from the start: metres; theta: radians; cost: metres-equivalent from the "
    "start; level: the layer at the pose; stamp: seconds from the start"
)


def text_of(route: Route) -> str:
    """Return the whole file; numbers read back exactly."""
    out = io.StringIO()
    for name, value in figures(route).model_dump(mode="json").items():
        out.write(f"# {name}: {json.dumps(value, ensure_ascii=False)}\n")
    out.write(f"{_REMARK}\n")
    rows = csv.writer(out, lineterminator="\n")
    columns = COLUMNS if route.stamps is None else COLUMNS + STAMP
    rows.writerow(columns if route.covariances is None else columns + COVARIANCE)
    for point in waypoints(route):
        values = [getattr(point, name) for name in columns]
        rows.writerow([*values, *(point.covariance or ())])
    return out.getvalue()


def route_of_text(text: str, where: str) -> Route:
    """Read the text that `text_of` wrote.

    Args:
        text: The file.
        where: Its name for messages.

    Raises:
        InputError: something is missing or wrong; the message names the line.
    """
    saved, (first, names), rows = parsed(text, where)
    columns = COLUMNS + STAMP if STAMP[0] in names else COLUMNS
    if names[2:3] == ["z"]:
        raise InputError(f"{where}: {IN_SPACE}")
    if names not in (list(columns), list(columns + COVARIANCE)):
        raise InputError(
            f"{where}: line {first}: the columns are {', '.join(names)}; "
            f"a route has {', '.join(COLUMNS)}."
        )
    points = []
    for number, cells in rows:
        plain: dict[str, Any] = dict(zip(columns, cells, strict=False))
        if len(cells) > len(columns):
            plain["covariance"] = cells[len(columns) :]
        points.append(checked(Waypoint, plain, f"{where}: line {number}"))
    return route_of(checked(Figures, saved, where), points, where)


def parsed(text: str, where: str) -> tuple[dict[str, Any], Line, list[Line]]:
    """Return the figures of a table, the names of its columns, and its rows of as many cells.

    Args:
        text: The file.
        where: Its name for messages.

    Raises:
        InputError: a figure cannot be read, there is no table, or a row has more or fewer cells.
    """
    lines = list(enumerate(text.split("\n"), start=1))
    saved: dict[str, Any] = {}
    for number, line in lines:
        if line.startswith("#") and not line.startswith("##"):
            name, value = _figure(line, f"{where}: line {number}")
            saved[name] = value
    table = [
        (number, [cell.strip() for cell in line.split(",")])
        for number, line in lines
        if line.strip() and not line.startswith("#")
    ]
    if not table:
        raise InputError(f"{where}: there is no table of poses in it; save the route again.")
    head, *rows = table
    for number, cells in rows:
        if len(cells) != len(head[1]):
            raise InputError(
                f"{where}: line {number}: it has {len(cells)} values and the table "
                f"{len(head[1])} columns; correct the line."
            )
    return saved, head, rows


def _figure(line: str, where: str) -> tuple[str, Any]:
    name, _, value = line.lstrip("# ").partition(":")
    try:
        return name.strip(), json.loads(value)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{where}: {line.strip()!r} is not a figure of a route; write it as '# name: value'."
        ) from error
