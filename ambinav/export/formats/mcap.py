"""MCAP files of a map with routes and drives, for Foxglove and `ros2 bag play`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from ambinav.export.formats import cdr
from ambinav.export.formats.inputs import drive_on, route_on, trajectory_on
from ambinav.export.formats.nav2_path import stamped_poses
from ambinav.export.occupancy import FREE, OCCUPIED, occupancy, raster_of
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.logs.export_drive import RecordedDrive
from ambinav.routes.files import FRAME
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

ODOMETRY_FRAME: Final = "odom"
LATEST: Final = 2**31 - 1
"""Seconds that a stamp of ROS 2 can say; they begin at 0."""
ZONE_STEP: Final = 33
"""Zones are drawn as 0, 33, 66 and 99."""

LATCHED: Final = ("nav_msgs/OccupancyGrid", "nav_msgs/Path", "tf2_msgs/TFMessage")
"""Types that are sent once, for late subscribers too."""

Send = Callable[[str, str, float, bytes], None]
"""Takes topic, message type, seconds and the encoded message."""
Trajectory = tuple[Floats, Floats]
"""Seconds, shape (N,), and poses, shape (N, 3)."""


def qos_profiles(latched: bool) -> str:
    """Return a reliable QoS profile as rosbag2 keeps it in a channel: YAML.

    Policies are the numbers of rmw, which rosbag2 reads in each release (names from Jazzy on only):
    keep last, and transient local if latched, or else volatile.
    """
    forever = {"sec": 9223372036, "nsec": 854775807}
    profile = {
        "history": 1,
        "depth": 1 if latched else 10,
        "reliability": 1,
        "durability": 1 if latched else 2,
        "deadline": dict(forever),
        "lifespan": dict(forever),
        "liveliness": 1,
        "liveliness_lease_duration": dict(forever),
        "avoid_ros_namespace_conventions": False,
    }
    return yaml.safe_dump([profile], sort_keys=False)


def _grids(export: MapExport, start: float, send: Send) -> None:
    """Send the building, and level and zones over its judged floor."""
    amap = export.amap
    raster = raster_of(amap.environment, export.options.resolution, amap.spacing)
    grey = occupancy(amap.environment, raster)
    values = np.full(grey.shape, -1, dtype=np.int8)
    values[grey == FREE], values[grey == OCCUPIED] = 0, 100
    _grid(send, "/map", start, values, raster)
    map_raster = Raster.of_map(amap)
    layer = amap.cost_layer
    for topic, share in (
        ("/ambiguity", 100.0 * export.counted(layer)),
        ("/zones", ZONE_STEP * export.counted("zone")),
    ):
        drawn = np.where(np.isnan(share), -1.0, np.clip(share, 0.0, 100.0))
        _grid(send, topic, start, np.rint(drawn).astype(np.int8), map_raster)


def _grid(send: Send, topic: str, seconds: float, values: NDArray[np.int8], raster: Raster) -> None:
    message = cdr.occupancy_grid(seconds, values, raster.x, raster.y, raster.resolution, FRAME)
    send(topic, "nav_msgs/OccupancyGrid", seconds, message)


def _read_drive(export: MapExport, path: Path) -> RecordedDrive | Trajectory:
    """Read a drive or a trajectory whose times a stamp can represent.

    Raises:
        InputError: it cannot be read, leaves the map, or has other times.
    """
    drive = (trajectory_on if path.suffix.lower() == ".tum" else drive_on)(export.amap, path)
    time = _times(drive)
    low, high = float(time.min()), float(time.max())
    if low < 0.0 or high > LATEST:
        raise InputError(
            f"{path}: time runs from {low:g} to {high:g} s, and stamps of ROS 2 from 0 to "
            f"{LATEST}; shift it."
        )
    return drive


def _times(drive: RecordedDrive | Trajectory) -> Floats:
    return drive.time if isinstance(drive, RecordedDrive) else drive[0]


def _odometry_frame(topic: str) -> str:
    return f"{topic.rpartition('/')[2]}/{ODOMETRY_FRAME}"


def _drive(drive: RecordedDrive | Trajectory, topic: str, send: Send) -> None:
    """Send a drive's truth, estimate and odometry; for a trajectory only its poses."""
    if not isinstance(drive, RecordedDrive):
        for seconds, pose in zip(*(part.tolist() for part in drive), strict=True):
            message = cdr.pose_stamped(seconds, pose, FRAME)
            send(topic, "geometry_msgs/PoseStamped", seconds, message)
        return
    covariance = drive.drives.covariance[drive.run]
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
            cdr.odometry(seconds, moved, _odometry_frame(topic), "base_link"),
        )


def _topics(head: str, paths: tuple[Path, ...]) -> list[str]:
    """Return a topic for each file, by its name with characters that ROS allows.

    Of files with one name the topics have the folder too: run 1 of two routes of a comparison.

    Raises:
        InputError: two files would have one.
    """
    ros_names = [_ros_name(path) for path in paths]
    names = [
        f"{head}/{_ros_word(_folder(path).name)}/{name}"
        if ros_names.count(name) > 1
        else f"{head}/{name}"
        for path, name in zip(paths, ros_names, strict=True)
    ]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"{paths[k]}: another file has the topic {name} too; rename one.")
    return names


def _ros_name(path: Path) -> str:
    # Drives of a comparison are called drive.csv, each in a folder of its own.
    return _ros_word(path.absolute().parent.name if path.name == "drive.csv" else path.stem)


def _folder(path: Path) -> Path:
    """Return the folder that tells a file from others of its name."""
    return path.absolute().parents[1 if path.name == "drive.csv" else 0]


def _ros_word(name: str) -> str:
    name = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")
    return f"_{name}" if not name or name[0].isdigit() else name


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write moving objects at their own times, and the map at the first of these, or second 0.

    Poses of a route are stamped by its speed profile, from there on.
    """
    from mcap.writer import Writer  # optional

    options = export.options
    routes = [
        (topic, *stamped_poses(route_on(export.amap, file)))
        for topic, file in zip(_topics("/route", options.routes), options.routes, strict=True)
    ]
    drives = [
        (topic, _read_drive(export, file))
        for topic, file in zip(_topics("/drive", options.drives), options.drives, strict=True)
    ]
    # Odometry begins at 0 in its own frame, which so lies where the drive begins.
    placed = [
        (drive.tracks["truth"][0].tolist(), _odometry_frame(topic))
        for topic, drive in drives
        if isinstance(drive, RecordedDrive)
    ]
    start = min((float(_times(drive).min()) for _, drive in drives), default=0.0)
    for (_, _, stamps), route in zip(routes, options.routes, strict=True):
        if start + stamps[-1] > LATEST:
            raise InputError(
                f"{route}: begun with the drives at {start:g} s it ends after {LATEST} s, the last "
                "that stamps of ROS 2 can say; shift the drives."
            )
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
                about = {"offered_qos_profiles": qos_profiles(kind in LATCHED)}
                channels[topic] = writer.register_channel(topic, "cdr", schemas[kind], about)
            moment = round(seconds * 1e9)
            writer.add_message(channels[topic], moment, message, moment)

        _grids(export, start, send)
        for topic, poses, stamps in routes:
            send(topic, "nav_msgs/Path", start, cdr.path(start, poses, stamps, FRAME))
        if placed:  # all in one message, as only the last one is latched
            frames = cdr.transforms(start, placed, FRAME)
            send("/tf_static", "tf2_msgs/TFMessage", start, frames)
        for topic, drive in drives:
            _drive(drive, topic, send)
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
