"""Reading of the files of routes through space."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ambinav.config import (
    ConfigModel,
    NonNegative,
    Number,
    Positive,
    check_kind,
    checked,
    read_text,
)
from ambinav.routes.table import parsed
from ambinav.runtime.errors import InputError
from ambinav.service.volume_service import VolumeService
from ambinav_planners.flight_route import COLUMNS, SUFFIXES, FlightRoute

MEMBER = "ambinav"


class _Figures(ConfigModel):
    """Figures of a flight, as `FlightRoute.figures` gives them."""

    format: Literal["ambinav-flight/1"]
    planner: str
    seed: int | None
    environment: str
    scanner: str
    space: Literal["r3"]
    robot_radius_m: Positive
    half_height_m: Positive | None
    layer: str
    weight: NonNegative
    length_m: NonNegative
    cost: NonNegative
    mean_level: Number
    lowest_m: Number
    highest_m: Number
    curve: tuple[tuple[NonNegative, NonNegative], ...]


class _Point(ConfigModel):
    """A point of a flight."""

    x: Number
    y: Number
    z: Number
    distance: NonNegative
    cost: NonNegative
    level: Number


_Saved = tuple[_Figures, list[_Point]]


def load_flight(path: str | Path, service: VolumeService) -> FlightRoute:
    """Read a route through space that `FlightRoute.save` wrote.

    Points are kept exactly. Cost and level are those of the service, which may be of another map,
    layer or weight than the route was planned with.

    Args:
        path: A `.csv` or `.json` file.
        service: Cost per metre.

    Raises:
        InputError: there is no such file, or it is no route through space; the message names the
            line or field and the value; or the route leaves the heights of the volume.
    """
    check_kind(service, VolumeService, "service")
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: routes through space are read from {' or '.join(SUFFIXES)}.")
    figures, rows = _read(path)
    points = np.array([[point.x, point.y, point.z] for point in rows])
    attrs = service.volume.dataset.attrs
    # The planner's progress is in the costs of what it planned with.
    theirs = figures.environment, figures.scanner, figures.layer, figures.weight
    same = theirs == (attrs["environment"], attrs["scanner"], service.layer, service.weight)
    return FlightRoute(
        points=points,
        cost=service.route_cost(points),
        length=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
        curve=figures.curve if same else (),
        service=service,
        radius=figures.robot_radius_m,
        half_height=figures.half_height_m,
        planner=figures.planner,
        seed=figures.seed,
    )


def is_flight(path: Path) -> bool:
    """Return whether a file holds a route through space."""
    try:
        return path.suffix.lower() in SUFFIXES and bool(_read(path))
    except InputError:
        return False


def _read(path: Path) -> _Saved:
    return _table(path) if path.suffix.lower() == ".csv" else _message(path)


def _table(path: Path) -> _Saved:
    figures, (first, names), rows = parsed(read_text(path), str(path))
    if names != list(COLUMNS):
        raise InputError(
            f"{path}: line {first}: the columns are {', '.join(names)}; a route through space has "
            f"{', '.join(COLUMNS)}."
        )
    points = [
        checked(_Point, dict(zip(names, cells, strict=True)), f"{path}: line {number}")
        for number, cells in rows
    ]
    return _saved(figures, points, path)


def _message(path: Path) -> _Saved:
    try:
        document = json.loads(read_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}); save the route again.") from error
    content = document.get(MEMBER) if isinstance(document, dict) else None
    if not isinstance(content, dict) or not isinstance(content.get("points"), list):
        raise InputError(
            f"{path}: {MEMBER}.points is missing, so this is not a route through space; save one "
            "with `ambinav plan --space r3`."
        )
    points = [
        checked(_Point, point, f"{path}: {MEMBER}.points[{i}]")
        for i, point in enumerate(content["points"])
    ]
    return _saved({name: content[name] for name in content if name != "points"}, points, path)


def _saved(figures: dict[str, Any], points: list[_Point], path: Path) -> _Saved:
    if len(points) < 2:
        raise InputError(f"{path}: it has {len(points)} points; a route has a start and a goal.")
    return checked(_Figures, figures, str(path)), points
