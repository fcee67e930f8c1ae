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
    """rclpy.lifecycle.LifecyclePublisher: it publishes only while it is active."""

    active = False

    def __init__(self, topic: str) -> None:
        self.sent: list[Any] = []
        self.topic_name = topic

    def publish(self, message: Any) -> None:
        if self.active:
            self.sent.append(message)


class Timer:
    running = True

    def cancel(self) -> None:
        self.running = False

    def reset(self) -> None:
        self.running = True


class StubNode:
    """rclpy.lifecycle.LifecycleNode, as far as it is used; what it is given is kept by topic.

    Triggers do as rclpy does: they move on only after a success.
    """

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

    def _make(self, topic: str, *what: Any) -> Any:
        self.made[topic] = what
        return what[2]

    def create_lifecycle_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        name = topic if topic.startswith("/") else f"/robot1/{topic}"
        return self._make(topic, kind, qos, Publisher(name))

    def create_subscription(self, kind: type, topic: str, call: Any, qos: Any) -> Any:
        return self._make(topic, kind, qos, call)

    def create_service(self, kind: type, topic: str, call: Any) -> Any:
        return self._make(topic, kind, None, call)

    def create_timer(self, period: float, call: Any) -> Timer:
        return self._make("timer", period, call, Timer())

    def _destroy(self, entity: Any) -> None:
        self.made = {topic: what for topic, what in self.made.items() if what[2] is not entity}

    destroy_lifecycle_publisher = destroy_service = destroy_subscription = destroy_timer = _destroy

    def on_configure(self, state: Any) -> str:
        return "success"

    on_cleanup = on_configure

    def on_activate(self, state: Any, active: bool = True) -> str:
        for _, _, entity in self.made.values():
            if isinstance(entity, Publisher):
                entity.active = active
        return "success"

    def on_deactivate(self, state: Any) -> str:
        return StubNode.on_activate(self, state, False)

    def trigger_configure(self) -> str:
        return self.on_configure(None)

    def trigger_activate(self) -> str:
        return self.on_activate(None)

    def get_logger(self) -> Any:
        return SimpleNamespace(error=print)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: Moment(int(self.time * 1e9)))

    def get_fully_qualified_name(self) -> str:
        return f"/robot1/{self.name}"

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
    stub("rclpy", init=lambda: None, spin=lambda node: None, ok=lambda: True,
         try_shutdown=lambda: None)  # fmt: skip
    returns = SimpleNamespace(SUCCESS="success", FAILURE="failure")
    stub("rclpy.lifecycle", LifecycleNode=StubNode, TransitionCallbackReturn=returns)
    stub("rclpy.qos", DurabilityPolicy=policy, ReliabilityPolicy=policy,
         QoSProfile=lambda **settings: settings, qos_profile_sensor_data="sensor data")  # fmt: skip
    stub("rclpy.time", Time=Moment)
    stub("ambinav_interfaces")
    service = type("GetAmbiguity", (), {"Request": Message, "Response": Message})
    stub("ambinav_interfaces.srv", GetAmbiguity=service)
    for package, names in {
        "diagnostic_msgs": ("DiagnosticArray", "KeyValue"),
        "nav2_msgs": ("CostmapFilterInfo",),
        "nav_msgs": ("OccupancyGrid",),
        "sensor_msgs": ("LaserScan",),
    }.items():
        stub(package)
        stub(f"{package}.msg", **{name: type(name, (Message,), {}) for name in names})
    sys.modules["diagnostic_msgs.msg"].DiagnosticStatus = Status
    stub("tf2_ros", Buffer=Buffer, TransformException=TransformException,
         TransformListener=lambda buffer, node: SimpleNamespace(unregister=print))  # fmt: skip
    monkeypatch.delitem(sys.modules, "ambinav_ros.node", raising=False)
    module = importlib.import_module("ambinav_ros.node")
    yield module
    sys.modules.pop("ambinav_ros.node", None)
