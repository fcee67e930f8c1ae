"""The ROS 2 package's folder on the path, and messages and a node without ROS."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

PACKAGE = Path(__file__).parents[2] / "examples" / "ros2" / "ambinav_ros"
sys.path.insert(0, str(PACKAGE))


class Message(SimpleNamespace):
    """A message whose fields are messages until they are set."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        setattr(self, name, Message())
        return getattr(self, name)


class Status(Message):
    OK, WARN, ERROR, STALE = b"\x00", b"\x01", b"\x02", b"\x03"


class Moment:
    """rclpy.time.Time, as far as it is used."""

    def __init__(self, nanoseconds: int = 0) -> None:
        self.nanoseconds = nanoseconds

    def __sub__(self, other: Moment) -> Moment:
        return Moment(self.nanoseconds - other.nanoseconds)

    def to_msg(self) -> Message:
        return Message(sec=self.nanoseconds // 10**9, nanosec=self.nanoseconds % 10**9)

    @classmethod
    def from_msg(cls, stamp: Message) -> Moment:
        return cls(stamp.sec * 10**9 + stamp.nanosec)


class Publisher:
    def __init__(self) -> None:
        self.sent: list[Any] = []

    def publish(self, message: Any) -> None:
        self.sent.append(message)


class StubNode:
    """rclpy.node.Node, as far as it is used; what it is given is kept by topic."""

    given: dict[str, Any] = {}  # noqa: RUF012
    time = 100.0

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: dict[str, Any] = {}
        self.made: dict[str, Any] = {}

    def declare_parameter(self, name: str, usual: Any) -> None:
        self.parameters[name] = self.given.get(name, usual)

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value=self.parameters[name])

    def create_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        self.made[topic] = (kind, qos, Publisher())
        return self.made[topic][2]

    def create_subscription(self, kind: type, topic: str, call: Any, qos: Any) -> None:
        self.made[topic] = (kind, qos, call)

    def create_service(self, kind: type, topic: str, call: Any) -> None:
        self.made[topic] = (kind, None, call)

    def create_timer(self, period: float, call: Any) -> None:
        self.made["timer"] = (period, None, call)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: Moment(int(self.time * 1e9)))

    def get_name(self) -> str:
        return self.name

    def destroy_node(self) -> None:
        pass


class TransformException(Exception):  # noqa: N818
    pass


class Buffer:
    def __init__(self) -> None:
        self.transforms: dict[tuple[str, str], Any] = {}

    def lookup_transform(self, target: str, source: str, stamp: Moment) -> Any:
        if (target, source) not in self.transforms:
            raise TransformException(f"{source} is not connected to {target}")
        return SimpleNamespace(transform=self.transforms[target, source])


@pytest.fixture
def node_module(monkeypatch):
    """`ambinav_ros.node`, imported with stubs in the place of ROS."""

    def stub(name: str, **members: Any) -> None:
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)

    policy = SimpleNamespace(TRANSIENT_LOCAL="transient local", RELIABLE="reliable")
    stub("rclpy", init=lambda: None, spin=lambda node: None, shutdown=lambda: None,
         try_shutdown=lambda: None)  # fmt: skip
    stub("rclpy.node", Node=StubNode)
    stub("rclpy.qos", DurabilityPolicy=policy, ReliabilityPolicy=policy,
         QoSProfile=lambda **settings: settings, qos_profile_sensor_data="sensor data")  # fmt: skip
    stub("rclpy.time", Time=Moment)
    stub("ambinav_interfaces")
    service = type("GetAmbiguity", (), {"Request": Message, "Response": Message})
    stub("ambinav_interfaces.srv", GetAmbiguity=service)
    for package, names in {
        "diagnostic_msgs": ("DiagnosticArray", "KeyValue"),
        "nav_msgs": ("OccupancyGrid",),
        "sensor_msgs": ("LaserScan",),
    }.items():
        stub(package)
        stub(f"{package}.msg", **{name: type(name, (Message,), {}) for name in names})
    sys.modules["diagnostic_msgs.msg"].DiagnosticStatus = Status
    stub("tf2_ros", Buffer=Buffer, TransformException=TransformException,
         TransformListener=lambda buffer, node: None)  # fmt: skip
    monkeypatch.delitem(sys.modules, "ambinav_ros.node", raising=False)
    module = importlib.import_module("ambinav_ros.node")
    yield module
    sys.modules.pop("ambinav_ros.node", None)
