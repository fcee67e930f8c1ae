"""Messages read back by mcap and mcap-ros2-support, which decode by the definitions in the file."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ambinav as an
from ambinav.export.formats.cdr import Message
from ambinav.runtime.errors import InputError

pytest.importorskip("mcap_ros2")

Write = Callable[..., tuple[Path, ...]]


def messages(path: Path) -> dict[str, list[tuple[str, int, Any]]]:
    """By topic: type, time in nanoseconds and message."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    found: dict[str, list[tuple[str, int, Any]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            found.setdefault(channel.topic, []).append((schema.name, message.log_time, decoded))
    return found


def value(grid: Any, x: float, y: float) -> int:
    origin = grid.info.origin.position
    column = int((x - origin.x) // grid.info.resolution)
    row = int((y - origin.y) // grid.info.resolution)
    return int(grid.data[row * grid.info.width + column])


def test_map_zones_and_routes(write: Write, amap: an.AmbiguityMap, route: Path) -> None:
    found = messages(write("mcap", "m.mcap", routes=(route,), resolution=0.05)[0])
    assert set(found) == {"/map", "/ambiguity", "/zones", "/route/route"}
    (kind, moment, grid), *_ = found["/map"]
    assert (kind, moment, grid.header.frame_id) == ("nav_msgs/msg/OccupancyGrid", 0, "map")
    assert [value(grid, *at) for at in ((7.0, 1.5), (7.0, 3.5))] == [0, -1]
    assert 100 in [value(grid, 1.0 + dx, 0.8) for dx in (-0.01, 0.01)]
    level, zone = found["/ambiguity"][0][2], found["/zones"][0][2]
    for x, y in [(0.5, 2.7), (7.1, 1.7), (14.3, 3.5)]:
        assert value(level, x, y) == pytest.approx(100 * amap.sample("level", x, y), abs=5)
        assert value(zone, x, y) == 33 * amap.sample("zone", x, y)
    assert value(level, 7.1, 3.5) == -1
    (kind, _, path), *_ = found["/route/route"]
    assert kind == "nav_msgs/msg/Path"
    points = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
    assert points[0] == (2.0, 1.5)
    assert points[-1] == (14.0, 4.0)


def test_a_drive(write: Write, drive: Path) -> None:
    found = messages(write("mcap", "m.mcap", drives=(drive,))[0])
    assert [time for _, time, _ in found["/drive/run_001/truth"]] == [
        0, 500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000
    ]  # fmt: skip
    kind, _, last = found["/drive/run_001/estimate"][-1]
    assert kind == "geometry_msgs/msg/PoseWithCovarianceStamped"
    assert (last.header.stamp.sec, last.header.stamp.nanosec) == (2, 0)
    assert last.pose.pose.position.x == pytest.approx(6.1)
    covariance = np.array(last.pose.covariance).reshape(6, 6)
    assert covariance[np.ix_((0, 1, 5), (0, 1, 5))] == pytest.approx(
        np.array([[0.04, 0, 0.002], [0, 0.01, 0], [0.002, 0, 0.001]])
    )
    kind, _, odometry = found["/drive/run_001/odometry"][-1]
    assert (kind, odometry.child_frame_id) == ("nav_msgs/msg/Odometry", "base_link")
    # Its own frame, placed in the map by a transform, leads to the truth.
    (transform,) = found["/tf_static"][0][2].transforms
    assert odometry.header.frame_id == transform.child_frame_id == "run_001/odom"
    moved = transform.transform.translation.x + odometry.pose.pose.position.x
    assert moved == pytest.approx(6.0)


def test_topics_that_are_sent_once_are_latched(write: Write, route: Path, drive: Path) -> None:
    """By the numbers of rmw's types.h, as rosbag2 of each release decodes them."""
    import yaml
    from mcap.reader import make_reader

    with write("mcap", "m.mcap", routes=(route,), drives=(drive,))[0].open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()  # type: ignore[union-attr]
    latched = {"/map", "/ambiguity", "/zones", "/route/route", "/tf_static"}
    assert latched < {channel.topic for channel in channels}
    for channel in channels:
        (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        policies = [profile[name] for name in ("history", "reliability", "durability", "depth")]
        assert policies == ([1, 1, 1, 1] if channel.topic in latched else [1, 1, 2, 10])
        assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}


def test_stamps_of_a_route_are_its_own(write: Write, route: Path, tmp_path: Path) -> None:
    """On a straight piece from standstill: the closed form of a trapezoid, after a real clock."""
    from ambinav.routes.clock import SpeedLimits
    from ambinav.routes.files import load_route, save_route

    limits = SpeedLimits(max_speed=0.5, acceleration=0.25)
    save_route(load_route(route).timed(limits), tmp_path / "timed.csv")
    (tmp_path / "slam.tum").write_text("1.7e9 2 1.5 0 0 0 0 1\n1700000001 3 1.5 0 0 0 0 1\n")
    found = messages(
        write("mcap", "m.mcap", routes=(tmp_path / "timed.csv",), drives=(tmp_path / "slam.tum",))[
            0
        ]
    )
    start = 1_700_000_000 * 10**9
    (_, moment, path), (_, sent, grid) = found["/route/timed"][0], found["/map"][0]
    assert moment == sent == start and grid.info.map_load_time.sec == 1_700_000_000
    for pose in path.poses:
        metres = pose.pose.position.x - 2.0
        if metres > 7.0:  # before it brakes for the corner
            break
        expected = (2.0 * metres / 0.25) ** 0.5 if metres < 0.5 else 2.0 + (metres - 0.5) / 0.5
        stamp = (pose.header.stamp.sec - 1_700_000_000) + 1e-9 * pose.header.stamp.nanosec
        assert stamp == pytest.approx(expected, abs=0.02)
    times = [(pose.header.stamp.sec, pose.header.stamp.nanosec) for pose in path.poses]
    assert times == sorted(times) and len(set(times)) == len(times)


def test_frames_of_all_drives_are_in_one_message(write: Write, drive: Path, tmp_path: Path) -> None:
    other = tmp_path / "run-002" / "drive.csv"
    other.parent.mkdir()
    other.write_bytes(drive.read_bytes())
    (message,) = messages(write("mcap", "m.mcap", drives=(drive, other))[0])["/tf_static"]
    frames = [transform.child_frame_id for transform in message[2].transforms]
    assert frames == ["run_001/odom", "run_002/odom"]


def test_a_trajectory(write: Write, tmp_path: Path) -> None:
    (tmp_path / "7 slam.tum").write_text("0.25 2 1.5 0 0 0 0 1\n1.25 3 1.5 0 0 0 1 0\n")
    found = messages(write("mcap", "m.mcap", drives=(tmp_path / "7 slam.tum",))[0])
    (_, first, pose), (_, second, turned) = found["/drive/_7_slam"]
    assert (first, second) == (250_000_000, 1_250_000_000)
    assert (pose.pose.position.x, abs(turned.pose.orientation.z)) == (2.0, 1.0)
    assert pose.header.stamp.nanosec == 250_000_000


@pytest.mark.parametrize("time", ["-1", "3e9"])
def test_times_that_no_stamp_can_say(write: Write, tmp_path: Path, time: str) -> None:
    (tmp_path / "t.tum").write_text(f"{time} 2 1.5 0 0 0 0 1\n")
    with pytest.raises(InputError, match=r"t\.tum: time runs from .*; shift it"):
        write("mcap", "m.mcap", drives=(tmp_path / "t.tum",))


def test_seconds_are_rounded_to_whole_nanoseconds() -> None:
    assert Message().header(1.9999999999, "").encoded()[4:12] == b"\x02" + bytes(7)


def test_files_of_one_name_are_told_apart_by_their_folders(
    write: Write, route: Path, drive: Path, tmp_path: Path
) -> None:
    """As run 1 of two routes of a comparison."""
    routes, drives = [], []
    for folder in ("one", "two", "more/two"):
        routes.append(tmp_path / folder / "route.csv")
        drives.append(tmp_path / folder / "run-001" / "drive.csv")
        drives[-1].parent.mkdir(parents=True)
        routes[-1].write_bytes(route.read_bytes())
        shutil.copytree(drive.parent, drives[-1].parent, dirs_exist_ok=True)
    found = messages(write("mcap", "m.mcap", routes=routes[:2], drives=drives[:2])[0])
    names = {"/route/one/route", "/route/two/route"}
    names |= {f"/drive/{name}/run_001/truth" for name in ("one", "two")}
    assert names < found.keys()
    with pytest.raises(InputError, match="another file has the topic /route/two/route too"):
        write("mcap", "more.mcap", routes=routes)


def test_a_route_that_outlasts_the_stamps(write: Write, route: Path, tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(f"{2**31 - 1} 2 1.5 0 0 0 0 1\n")
    with pytest.raises(InputError, match=r"\.csv: begun .* ends after 2147483647 s, the last that"):
        write("mcap", "m.mcap", routes=(route,), drives=(tmp_path / "t.tum",))


def test_alignment_of_fields() -> None:
    """By hand: a string of 3 with its zero ends at byte 8, the double after it begins there."""
    message = Message().text("abc").number("d", 1.0).number("i", -1).text("").encoded()
    assert message[4:12] == b"\x04\x00\x00\x00abc\x00"
    assert message[12:20] == np.float64(1.0).tobytes()
    assert message[20:] == b"\xff\xff\xff\xff\x01\x00\x00\x00\x00"
