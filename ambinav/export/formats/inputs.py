"""Inputs of an export: routes and drives, checked against the map."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ambinav.logs.drive_table import load_drive
from ambinav.logs.export import load_tum
from ambinav.logs.export_drive import RecordedDrive
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.files import load_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError

STEP: Final = 0.05
"""Metres between the poses of a dense path."""


def route_on(amap: AmbiguityMap, path: Path) -> Route:
    """Read a route from its file.

    Raises:
        InputError: it cannot be read, or a pose lies outside of the map or in something solid.
    """
    route = load_route(path)
    check_on_floor(amap, route.poses, path)
    return route


def only_route(amap: AmbiguityMap, paths: tuple[Path, ...], kind: str) -> Route:
    """Return the only route of an export.

    Raises:
        InputError: there is none or there are several, or see `route_on`.
    """
    if len(paths) != 1:
        raise InputError(
            f"--route is given {len(paths)} times, and {kind} is of one route; give one file that "
            "`ambinav plan` wrote."
        )
    return route_on(amap, paths[0])


def drive_on(amap: AmbiguityMap, path: Path) -> RecordedDrive:
    """Read a drive from the `drive.csv` of a comparison's exports.

    Raises:
        InputError: it cannot be read, or leaves the map.
    """
    drive = load_drive(path)
    check_in_bounds(amap, drive.tracks["truth"], path)
    return drive


def trajectory_on(amap: AmbiguityMap, path: Path) -> tuple[Floats, Floats]:
    """Read a trajectory (.tum): time, shape (N,), and poses, shape (N, 3).

    Raises:
        InputError: it cannot be read, or leaves the map.
    """
    time, poses = load_tum(path)
    check_in_bounds(amap, poses, path)
    return time, poses


def check_in_bounds(amap: AmbiguityMap, poses: Floats, path: Path) -> None:
    """Check that poses (N, 3) lie on the lattice of the map.

    Raises:
        InputError: a pose lies elsewhere; the message names the first.
    """
    xmin, ymin, xmax, ymax = amap.bounds
    x, y = poses[:, 0], poses[:, 1]
    _refuse(amap, poses, path, (x < xmin) | (x > xmax) | (y < ymin) | (y > ymax), "outside of")


def check_on_floor(amap: AmbiguityMap, poses: Floats, path: Path) -> None:
    """Check that poses (N, 3) lie on free cells of the map.

    Raises:
        InputError: a pose lies elsewhere; the message names the first.
    """
    check_in_bounds(amap, poses, path)
    x, y = poses[:, 0], poses[:, 1]
    free = np.asarray(amap.environment.is_free(x, y))
    _refuse(amap, poses, path, ~free, "not on the free floor of")


def _refuse(amap: AmbiguityMap, poses: Floats, path: Path, bad: Bools, where: str) -> None:
    if bad.any():
        k = int(bad.argmax())
        xmin, ymin, xmax, ymax = amap.bounds
        raise InputError(
            f"{path}: pose {k} at ({poses[k, 0]:g}, {poses[k, 1]:g}) is {where} the map "
            f"{amap.source} (x {xmin:g} to {xmax:g}, y {ymin:g} to {ymax:g}); give a route or "
            "drive of this building."
        )
