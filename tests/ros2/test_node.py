"""The node with stubs in the place of ROS, and the files of the two packages."""

from __future__ import annotations

import ast
import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from ambinav import export_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from tests.export.test_map_server import map_io
from tests.maps import synthetic
from tests.ros2.conftest import PACKAGE, Message, StubNode

INTERFACES = PACKAGE.parent / "ambinav_interfaces"


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "map.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    return path


@pytest.fixture
def node(node_module, stored, monkeypatch):
    """The node, active."""
    monkeypatch.setattr(StubNode, "given", {"map": str(stored), "filter": "nav2-speed"})
    made = node_module.AmbinavNode()
    assert not made.made
    assert made.trigger_configure() == made.trigger_activate() == "success"
    return made


def transform(x: float, y: float, yaw: float) -> Message:
    turned = Message(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return Message(translation=Message(x=x, y=y, z=0.0), rotation=turned)


def scan_at(node, x: float, y: float, yaw: float, clockwise: bool = True) -> Message:
    """A scan as a driver that turns clockwise, from a frame turned by 90 degrees, gives it."""
    count, mounted = 360, math.pi / 2
    step = -math.tau / count if clockwise else math.tau / count
    first = math.pi if clockwise else -math.pi
    angles = first + step * np.arange(count) + mounted + yaw
    ranges = node.environment.cast(np.full(count, x), np.full(count, y), angles, 4.0)
    ranges = np.where(ranges >= 4.0, math.inf, ranges)
    node.buffer.transforms = {
        ("base_link", "laser"): transform(0.0, 0.0, mounted),
        ("map", "base_link"): transform(x, y, yaw),
    }
    stamp = Message(sec=99, nanosec=500_000_000)
    return Message(
        header=Message(frame_id="laser", stamp=stamp), angle_min=first, angle_increment=step,
        range_min=0.1, range_max=12.0, ranges=ranges.tolist(),
    )  # fmt: skip


def status(node) -> Message:
    node.on_timer()
    return node.diagnostics.sent[-1].status[0]


def test_the_map_is_latched(node):
    kind, qos, publisher = node.made["ambiguity"]
    assert kind.__name__ == "OccupancyGrid"
    assert qos == {"depth": 1, "durability": "transient local", "reliability": "reliable"}
    (message,) = publisher.sent
    assert message.header.frame_id == "map"
    assert len(message.data) == message.info.width * message.info.height
    assert all(isinstance(value, int) for value in message.data[:3])
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-0.5, -0.5)
    assert message.info.origin.orientation.w == 1.0


@pytest.mark.parametrize("clockwise", [True, False])
def test_diagnostics_say_how_localizable_it_is(node, clockwise):
    assert status(node).level == b"\x03" and status(node).message == "no scan yet"
    levels = {}
    for name, pose in {"room": (2.0, 2.0, 0.4), "corridor": (10.0, 2.0, 2.0)}.items():
        node.on_scan(scan_at(node, *pose, clockwise=clockwise))
        diagnostic = status(node)
        levels[name] = diagnostic.level
        values = {one.key: one.value for one in diagnostic.values}
        assert float(values["explained"]) > 0.8
    assert levels == {"room": b"\x00", "corridor": b"\x02"}
    assert diagnostic.name == "robot1/ambinav: localizability"
    assert node.status.sent[-1] is diagnostic
    assert "along 0 degrees" in diagnostic.message or "along 180 degrees" in diagnostic.message


def test_no_pose_and_old_scans_are_stale(node):
    node.on_scan(scan_at(node, 2.0, 2.0, 0.0))
    node.buffer.transforms.pop(("map", "base_link"))
    assert status(node).level == b"\x03" and "no pose: base_link" in status(node).message
    node.on_scan(scan_at(node, 2.0, 2.0, 0.0))
    node.time = 200.0
    assert "the last scan is 100.5 s old" in status(node).message
    node.time = 100.0
    node.scan.ranges = [math.nan] * 360
    assert "no reading" in status(node).message
    node.scan.angle_increment = 0.0
    assert "angle_increment" in status(node).message


def test_the_service_answers_many_poses(node):
    request = Message(header=Message(frame_id="map"), x=[2.0, 99.0], y=[2.0, 0.0], theta=[])
    answer = node.on_request(request, Message())
    assert answer.success and answer.state == [0, 2] and answer.cost[1] == math.inf
    assert answer.cost[0] == pytest.approx(1.0 + 5.0 * 0.1, abs=1e-5)
    request.header.frame_id = "odom"
    answer = node.on_request(request, Message())
    assert not answer.success and "'odom'; give poses in 'map'" in answer.message
    request.header.frame_id, request.y = "", [2.0]
    assert "give as many of each" in node.on_request(request, Message()).message


def test_the_filter_mask_is_that_of_the_export(node, stored, tmp_path):
    mask, *_ = export_map(AmbiguityMap.open(stored), "nav2-speed", tmp_path / "mask.yaml")
    grid, _, origin = map_io(mask)
    (message,), (info,) = node.mask.sent, node.info.sent
    assert np.array_equal(np.reshape(message.data, grid.shape), grid) and grid.any()
    assert (message.info.height, message.info.width) == grid.shape
    assert [message.info.origin.position.x, message.info.origin.position.y, 0.0] == origin
    assert info.filter_mask_topic == "/robot1/filter_mask"
    assert (info.type, info.base, info.multiplier) == (1, 100.0, -1.0)
    for topic in ("filter_mask", "costmap_filter_info"):
        assert node.made[topic][1]["durability"] == "transient local"


def test_only_an_active_node_publishes(node):
    timer = node.made["timer"][2]
    assert timer.running
    assert node.on_deactivate(None) == "success" and not timer.running
    node.on_timer()
    assert not node.diagnostics.sent and not node.status.sent
    node.on_activate(None)
    assert len(node.grid.sent) == len(node.mask.sent) == 2 and timer.running
    assert node.on_deactivate(None) == node.on_cleanup(None) == "success"
    assert not node.made
    assert node.trigger_configure() == node.trigger_activate() == "success"
    assert len(node.grid.sent) == 1


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({}, "map: no ambiguity map is named"),
        ({"map": "", "filter": "speed"}, "filter: 'speed'; give one of nav2-keepout"),
        ({"map": "", "layer": "nope"}, "'nope': the map has no such layer"),
        ({"map": "", "period": 0.0}, "period is 0.0; give what is above 0"),
        ({"map": "", "prior": [0.0, 1.0, 1.0]}, r"prior is .0.0, 1.0, 1.0.; give what"),
    ],
)
def test_a_node_that_cannot_be_configured_says_so(
    node_module, monkeypatch, stored, capsys, given, problem
):
    given = {**given, "map": str(stored)} if "map" in given else given
    monkeypatch.setattr(StubNode, "given", given)
    node = node_module.AmbinavNode()
    assert node.trigger_configure() == "failure" and not node.made
    assert re.search(problem, capsys.readouterr().out)
    with pytest.raises(SystemExit, match=f"ambinav: error: {problem}"):
        node_module.main()


def test_sigterm_is_no_failure(node_module, monkeypatch, stored):
    """rclpy's spin raises when the context has ended, as do callbacks that publish then."""
    monkeypatch.setattr(StubNode, "given", {"map": str(stored), "autostart": False})

    def spin(node):
        raise RuntimeError("the context is gone" if not alive else "a fault of ours")

    monkeypatch.setattr(node_module.rclpy, "spin", spin)
    monkeypatch.setattr(node_module.rclpy, "ok", lambda: alive)
    alive = False
    node_module.main()
    alive = True
    with pytest.raises(RuntimeError, match="a fault of ours"):
        node_module.main()


def test_parameters_of_node_and_file_are_the_same(node_module):
    document = yaml.safe_load((PACKAGE / "config" / "ambinav.yaml").read_text())
    assert document["/**"]["ros__parameters"] == node_module.PARAMETERS


def test_only_the_node_and_the_launch_file_import_ros():
    ros = {"rclpy", "tf2_ros", "launch", "launch_ros", "ament_index_python"}
    importing = set()
    for path in PACKAGE.rglob("*.py"):
        for each in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in each.names] if isinstance(each, ast.Import) else []
            names += [each.module or ""] if isinstance(each, ast.ImportFrom) else []
            if ros & {name.split(".")[0] for name in names}:
                importing.add(path.name)
    assert importing == {"node.py", "ambinav.launch.py"}


def test_packages_declare_what_they_import():
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    depends = {one.text for one in package if one.tag.endswith("depend")}
    text = (PACKAGE / "ambinav_ros" / "node.py").read_text()
    imported = set(re.findall(r"^from (\w+)\.(?:msg|srv) import", text, re.MULTILINE))
    assert imported | {"rclpy", "tf2_ros"} <= depends
    versions = {ElementTree.parse(path / "package.xml").findtext("version")
                for path in (PACKAGE, INTERFACES)}  # fmt: skip
    assert versions == {re.search(r'version="([^"]+)"', (PACKAGE / "setup.py").read_text())[1]}


def test_files_that_setup_installs_are_there():
    text = (PACKAGE / "setup.py").read_text()
    for name in re.findall(r'"((?:config|launch)/[^"]+|package\.xml)"', text):
        assert (PACKAGE / name).is_file(), name
    assert (PACKAGE / "resource" / "ambinav_ros").is_file()
    service = (INTERFACES / "srv" / "GetAmbiguity.srv").read_text()
    constants = dict(re.findall(r"^uint8 (\w+)=(\d)", service, re.MULTILINE))
    from ambinav_ros import conversions

    assert {name: getattr(conversions, name) for name in constants} == {
        name: int(value) for name, value in constants.items()
    }
    assert "srv/GetAmbiguity.srv" in (INTERFACES / "CMakeLists.txt").read_text()
