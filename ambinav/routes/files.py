"""Files of routes: CSV, GeoJSON, and JSON as a ROS nav_msgs/Path; poses are kept exactly."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from ambinav.config import check_kind, checked, read_text
from ambinav.export.registry import EXPORTERS, Exporter, exporter, formats
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.routes import table
from ambinav.routes.clock import SPACING, speed_profile
from ambinav.routes.record import Figures, Waypoint, figures, route_of, waypoints
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text

FRAME: Final = "map"
TRACE_STEP: Final = SPACING
"""Metres between the points that curves are drawn with for those who only know straight lines."""


def save_route(route: Route, path: str | Path) -> None:
    """Write a route, completely or not at all; an older file is replaced.

    - `.csv`: the figures in lines that begin with #, then a table of the poses.
    - `.geojson`: a Feature with a LineString in the map frame (metres, not degrees); figures and
      poses are its properties.
    - `.json`: the fields of a ROS nav_msgs/Path in the frame `map`, stamped with the time from the
      start, and the member `ambinav` with figures and poses.

    The line and the path show curves (dubins, reeds-shepp) by points `TRACE_STEP` apart.

    Args:
        route: What to write.
        path: Where to; the ending says the format. Plug-ins may know more of them.

    Raises:
        InputError: another ending, or the place is not writable.
    """
    path = Path(path)
    check_kind(route, Route, "route")
    exporter("route", path).written(route, path)


def load_route(path: str | Path) -> Route:
    """Read a route that `save_route` wrote; ambinav's own formats keep poses exactly.

    Raises:
        InputError: there is no such file, it is not a route, or routes of its format are only
            written; the message names the line or field and the value.
    """
    path = Path(path)
    reader = exporter("route", path)
    if reader.read is None:
        every = (EXPORTERS.get(f"route-{name}") for name in formats("route"))
        able = ", ".join(f".{other.format}" for other in every if other.read is not None)
        raise InputError(
            f"{path}: routes are only written as .{reader.format}; give one of {able}."
        )
    with EXPORTERS.calling(reader.name):
        route = reader.read(path)
        if not isinstance(route, Route):
            raise TypeError(f"it is not a Route but {route!r}")
    return route


def _read_json(path: Path, member: str) -> Route:
    """Read the route in a member of a JSON file."""
    text = read_text(path)
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}: line {error.lineno}: not valid JSON ({error.msg}); save the route again."
        ) from error
    except RecursionError as error:
        raise InputError(f"{path}: nested too deeply for a route; save it again.") from error
    content = document.get(member) if isinstance(document, dict) else None
    if isinstance(content, dict) and "points" in content:
        raise InputError(f"{path}: {table.IN_SPACE}")
    if not isinstance(content, dict) or not isinstance(content.get("poses"), list):
        raise InputError(
            f"{path}: {member}.poses is missing, so this is not a route of ambinav; "
            "save one with `ambinav plan`."
        )
    plain_figures = {name: value for name, value in content.items() if name != "poses"}
    points = [
        checked(Waypoint, plain, f"{path}: {member}.poses[{i}]")
        for i, plain in enumerate(content["poses"])
    ]
    return route_of(checked(Figures, plain_figures, f"{path}: {member}"), points, str(path))


def trace_route(route: Route, step: float = TRACE_STEP) -> Floats:
    """Return poses joined by straight lines, (M, 3): the route's own, or points of its curves.

    Args:
        route: The route.
        step: Metres between points of a curve, at most.
    """
    if not route.steering.turns:
        return route.poses
    return _trace(route, step)[0]


def _trace(route: Route, step: float) -> tuple[Floats, Floats]:
    """Return points of a route, (M, 3), and the metres up to each, (M,)."""
    dense, _, along = route.steering.dense(route.poses, step)
    moves = np.diff(along, prepend=-1.0) > 0.0
    return dense[moves], along[moves]


def _trace_stamps(route: Route) -> Floats:
    """Return the seconds at the points of `trace_route`, (M,); zeros if not known."""
    if not route.steering.turns:
        return np.zeros(len(route.poses)) if route.stamps is None else route.stamps
    return stamps_along(route, _trace(route, TRACE_STEP)[1])


def stamps_along(route: Route, along: Floats) -> Floats:
    """Return the seconds from the start at metres along a route, (M,); zeros if not known.

    Where the robot turns on the spot, those after the turn.
    """
    if route.stamps is None:
        return np.zeros(len(along))
    profile = speed_profile(route.poses, route.steering, route.speed_limits)
    freely = np.interp(along, profile.distance, profile.stamps)
    # Stops and bounds made each motion slower than it is under the limits alone.
    return np.interp(freely, profile.stamps[profile.vertices], route.stamps)


def _record(route: Route) -> dict[str, Any]:
    poses = [point.model_dump(exclude_none=True) for point in waypoints(route)]
    return {**figures(route).model_dump(), "poses": poses}


def _feature(route: Route) -> dict[str, Any]:
    return {
        "type": "Feature",
        **MAP_FRAME,
        "geometry": {"type": "LineString", "coordinates": trace_route(route)[:, :2].tolist()},
        "properties": _record(route),
    }


def _header(stamp: float) -> dict[str, Any]:
    sec, nanosec = divmod(round(1e9 * stamp), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": FRAME}


def path_message(poses: Floats, stamps: Floats) -> dict[str, Any]:
    """Return exactly the fields of a nav_msgs/Path.

    Args:
        poses: Shape (M, 3), map frame.
        stamps: Seconds, shape (M,).
    """
    return {
        "header": _header(0.0),
        "poses": [
            {
                "header": _header(stamp),
                "pose": {
                    "position": {"x": x, "y": y, "z": 0.0},
                    "orientation": {
                        "x": 0.0,
                        "y": 0.0,
                        "z": math.sin(theta / 2.0),
                        "w": math.cos(theta / 2.0),
                    },
                },
            }
            for (x, y, theta), stamp in zip(poses.tolist(), stamps.tolist(), strict=True)
        ],
    }


def _stamped_path(route: Route) -> dict[str, Any]:
    message = path_message(trace_route(route), _trace_stamps(route))
    return message | {"ambinav": _record(route)}


def _write(path: Path, text: str) -> tuple[Path, ...]:
    write_text(path, text)
    return (path,)


def _write_json(path: Path, document: dict[str, Any]) -> tuple[Path, ...]:
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    return _write(path, text + "\n")


CSV: Final = Exporter(
    subject="route",
    format="csv",
    title="figures in lines that begin with #, then a table of the poses",
    write=lambda route, path: _write(path, table.text_of(route)),
    read=lambda path: table.route_of_text(read_text(path), str(path)),
)
GEOJSON: Final = Exporter(
    subject="route",
    format="geojson",
    title="a Feature with a LineString in the map frame, figures and poses as its properties",
    write=lambda route, path: _write_json(path, _feature(route)),
    read=lambda path: _read_json(path, "properties"),
)
PATH_MESSAGE: Final = Exporter(
    subject="route",
    format="json",
    title="the fields of a ROS nav_msgs/Path in the frame `map`, with figures and poses",
    write=lambda route, path: _write_json(path, _stamped_path(route)),
    read=lambda path: _read_json(path, "ambinav"),
)
