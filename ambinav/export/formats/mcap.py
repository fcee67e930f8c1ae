"""MCAP files of a map with routes and drives, for Foxglove and `ros2 bag play`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.export.formats import cdr
from ambinav.export.formats.inputs import drive_on, route_on, trajectory_on
from ambinav.export.formats.nav2_path import dense_poses
from ambinav.export.occupancy import FREE, OCCUPIED, occupancy, raster_of
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.routes.files import FRAME
from ambinav.runtime.errors import InputError

ODOMETRY_FRAME: Final = "odom"
LATEST: Final = 2**31 - 1
"""Seconds that a stamp of ROS 2 can say; they begin at 0."""
ZONE_STEP: Final = 33
"""Zones are drawn as 0, 33, 66 and 99."""

Send = Callable[[str, str, float, bytes], None]
"""Takes topic, message type, seconds and the encoded message."""


def _grids(export: MapExport, send: Send) -> None:
    """Send the building, and level and zones over its judged floor."""
    amap = export.amap
    raster = raster_of(amap.environment, export.options.resolution, amap.spacing)
    grey = occupancy(amap.environment, raster)
    values = np.full(grey.shape, -1, dtype=np.int8)
    values[grey == FREE], values[grey == OCCUPIED] = 0, 100
    _grid(send, "/map", values, raster)
    own = Raster.of_map(amap)
    layer = amap.cost_layer
    for topic, share in (
        ("/ambiguity", 100.0 * export.counted(layer)),
        ("/zones", ZONE_STEP * export.counted("zone")),
    ):
        drawn = np.where(np.isnan(share), -1.0, np.clip(share, 0.0, 100.0))
        _grid(send, topic, np.rint(drawn).astype(np.int8), own)


def _grid(send: Send, topic: str, values: NDArray[np.int8], raster: Raster) -> None:
    message = cdr.occupancy_grid(values, raster.x, raster.y, raster.resolution, FRAME)
    send(topic, "nav_msgs/OccupancyGrid", 0.0, message)


def _drive(export: MapExport, path: Path, topic: str, send: Send) -> None:
    """Send a drive's truth, estimate and odometry; for a trajectory only its poses."""
    if path.suffix.lower() == ".tum":
        time, poses = trajectory_on(export.amap, path)
        _check_time(time, path)
        for seconds, pose in zip(time.tolist(), poses, strict=True):
            message = cdr.pose_stamped(seconds, pose.tolist(), FRAME)
            send(topic, "geometry_msgs/PoseStamped", seconds, message)
        return
    drive = drive_on(export.amap, path)
    _check_time(drive.time, path)
    covariance = drive.drives.covariance[drive.run]
    odometry = f"{topic.rpartition('/')[2]}/{ODOMETRY_FRAME}"
    start = drive.tracks["truth"][0].tolist()
    # Odometry begins at 0 in its own frame, which so lies where the drive begins.
    send("/tf_static", "tf2_msgs/TFMessage", 0.0, cdr.transform(0.0, start, FRAME, odometry))
    for k, seconds in enumerate(drive.time.tolist()):
        truth, estimate, moved = (
            drive.tracks[name][k].tolist() for name in ("truth", "estimate", "odometry")
        )
        send(
            f"{topic}/truth",
            "geometry_msgs/PoseStamped",
            seconds,
            cdr.pose_stamped(seconds, truth, FRAME),
        )
        send(
            f"{topic}/estimate",
            "geometry_msgs/PoseWithCovarianceStamped",
            seconds,
            cdr.pose_with_covariance(seconds, estimate, covariance[k], FRAME),
        )
        send(
            f"{topic}/odometry",
            "nav_msgs/Odometry",
            seconds,
            cdr.odometry(seconds, moved, odometry, "base_link"),
        )


def _check_time(time: NDArray[np.float64], path: Path) -> None:
    """Check that a stamp can represent all times.

    Raises:
        InputError: there is one.
    """
    low, high = float(time.min()), float(time.max())
    if low < 0.0 or high > LATEST:
        raise InputError(
            f"{path}: time runs from {low:g} to {high:g} s, and stamps of ROS 2 from 0 to "
            f"{LATEST}; shift it."
        )


def _topics(head: str, paths: tuple[Path, ...]) -> list[str]:
    """Return a topic for each file, by its name with characters that ROS allows.

    Raises:
        InputError: two files would have one.
    """
    names = [f"{head}/{_ros_name(path)}" for path in paths]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"{paths[k]}: another file has the topic {name} too; rename one.")
    return names


def _ros_name(path: Path) -> str:
    # Drives of a comparison are called drive.csv, each in a folder of its own.
    name = path.absolute().parent.name if path.name == "drive.csv" else path.stem
    name = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    return f"_{name}" if not name or name[0].isdigit() else name


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the map at second 0, and moving objects at their own times."""
    from mcap.writer import Writer  # optional

    options = export.options
    routes = [
        (topic, dense_poses(route_on(export.amap, file)))
        for topic, file in zip(_topics("/route", options.routes), options.routes, strict=True)
    ]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="ambinav")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}

        def send(topic: str, kind: str, seconds: float, message: bytes) -> None:
            if kind not in schemas:
                package, name = kind.split("/")
                schemas[kind] = writer.register_schema(
                    f"{package}/msg/{name}", "ros2msg", cdr.definition(kind).encode()
                )
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
            moment = round(seconds * 1e9)
            writer.add_message(channels[topic], moment, message, moment)

        _grids(export, send)
        for topic, poses in routes:
            send(topic, "nav_msgs/Path", 0.0, cdr.path(poses, FRAME))
        for topic, drive in zip(_topics("/drive", options.drives), options.drives, strict=True):
            _drive(export, drive, topic, send)
        writer.add_metadata("ambinav", _about(export))
        writer.finish()  # type: ignore[no-untyped-call]
    return (path,)


def _about(export: MapExport) -> dict[str, str]:
    attrs: dict[str, Any] = export.amap.dataset.attrs
    names = ("environment", "environment_sha256", "scanner", "parameters", "ambinav_version")
    return {name: str(attrs[name]) for name in names if name in attrs}


MCAP: Final = Exporter(
    subject="map",
    format="mcap",
    title="map, ambiguity, zones, routes and drives as ROS 2 messages",
    reader="Foxglove, ros2 bag play",
    write=write,
    suffixes=(".mcap",),
    uses=frozenset({"routes", "drives", "resolution"}),
    needs=("mcap",),
    extra="mcap",
)
