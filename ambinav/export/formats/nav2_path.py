"""Route as a dense nav_msgs/Path, for `ros2 topic pub` or as plain JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from ambinav.export.formats.inputs import STEP, only_route
from ambinav.export.options import MapExport
from ambinav.export.registry import Exporter
from ambinav.routes.files import path_message, stamps_along
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats


def dense_poses(route: Route, step: float = STEP) -> Floats:
    """Sample poses along a route, all distinct and at most `step` apart, shape (N, 3).

    Each faces as the robot does there. At a corner of straight pieces stands the heading of the
    piece that begins: what a controller is to turn to.
    """
    return _dense(route, step)[0]


def stamped_poses(route: Route) -> tuple[Floats, Floats]:
    """Return `dense_poses`, and the seconds from the start at each, (N,); zeros if not known."""
    poses, along = _dense(route, STEP)
    return poses, stamps_along(route, along)


def _dense(route: Route, step: float) -> tuple[Floats, Floats]:
    """Return `dense_poses`, and the metres up to each, (N,)."""
    poses, _, along = route.steering.dense(route.poses, step)
    last = np.append(np.diff(along) > 0.0, True)
    return poses[last], along[last]


def _message(export: MapExport, kind: str) -> dict[str, Any]:
    options = export.options
    route = only_route(export.amap, options.routes, kind)
    poses = dense_poses(route, options.step or STEP)
    # Stamp 0 is the latest transform.
    return path_message(poses, np.zeros(len(poses)))


def write_yaml(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the message in the form that `ros2 topic pub` reads."""
    text = yaml.safe_dump(_message(export, "nav2-path-yaml"), sort_keys=False)
    head = (
        f"# ros2 topic pub --once --qos-durability transient_local /plan nav_msgs/msg/Path "
        f'"$(cat {path.name})"\n'
    )
    path.write_text(head + text, encoding="utf-8")
    return (path,)


def write_json(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the message as JSON, as rosbridge and `FollowPath` scripts take it."""
    text = json.dumps(_message(export, "nav2-path-json"), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    return (path,)


PATH_YAML: Final = Exporter(
    subject="map",
    format="nav2-path-yaml",
    title="a route as a dense nav_msgs/Path with headings, YAML",
    reader="ros2 topic pub, ros2 action send_goal /follow_path",
    write=write_yaml,
    suffixes=(".yaml",),
    uses=frozenset({"routes", "step"}),
)
PATH_JSON: Final = replace(
    PATH_YAML,
    format="nav2-path-json",
    title="a route as a dense nav_msgs/Path with headings, JSON",
    reader="rosbridge, scripts",
    write=write_json,
    suffixes=(".json",),
)
