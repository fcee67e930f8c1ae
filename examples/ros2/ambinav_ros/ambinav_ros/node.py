"""The lifecycle node: the map, a filter mask, costs of poses, and how localizable the robot is."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import rclpy
from ambinav_interfaces.srv import GetAmbiguity
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav2_msgs.msg import CostmapFilterInfo
from nav_msgs.msg import OccupancyGrid
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import LaserScan
from tf2_ros import Buffer, TransformException, TransformListener

from ambinav import AmbiguityMap, AmbiguityService, InputError, RangeScanner
from ambinav_ros import conversions
from ambinav_ros.monitor import Localizability, Monitor, State, Thresholds, measure

LEVELS = {
    State.OK: DiagnosticStatus.OK,
    State.WARN: DiagnosticStatus.WARN,
    State.ERROR: DiagnosticStatus.ERROR,
    State.STALE: DiagnosticStatus.STALE,
}
PARAMETERS = {
    "map": "", "autostart": True, "filter": "", "layer": "level", "weight": 5.0,
    "map_frame": "map", "base_frame": "base_link",
    "max_beams": 180, "period": 0.5, "stale_after": 2.0, "prior": [0.5, 0.5, 0.26],
    "pose": [0.1, 0.1, 0.05], "warn": 0.1, "error": 0.25, "explained": 0.5, "hysteresis": 0.2,
}  # fmt: skip
"""With the values of config/ambinav.yaml."""


class AmbinavNode(LifecycleNode):
    """See the README beside; all thinking is in `conversions` and `monitor`.

    Configured, it has read the map and answers the service; active, it publishes.
    """

    def __init__(self) -> None:
        super().__init__("ambinav")
        for name, usual in PARAMETERS.items():
            self.declare_parameter(name, usual)
        self.problem = ""

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Read the map, and make what is published and listened to."""
        try:
            self._read()
        except InputError as error:
            self.problem = str(error)
            self.get_logger().error(self.problem)
            return TransitionCallbackReturn.FAILURE
        latched = QoSProfile(
            depth=1,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
            reliability=ReliabilityPolicy.RELIABLE,
        )
        publisher = self.create_lifecycle_publisher
        self.grid = publisher(OccupancyGrid, "ambiguity", latched)
        self.mask = publisher(OccupancyGrid, "filter_mask", latched)
        self.info = publisher(CostmapFilterInfo, "costmap_filter_info", latched)
        self.status = publisher(DiagnosticStatus, "localizability", 10)
        self.diagnostics = publisher(DiagnosticArray, "/diagnostics", 10)
        self.answers = self.create_service(GetAmbiguity, "get_ambiguity", self.on_request)
        self.scan: LaserScan | None = None
        self.scans = self.create_subscription(
            LaserScan, "scan", self.on_scan, qos_profile_sensor_data
        )
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.timer = self.create_timer(self._value("period"), self.on_timer)
        self.timer.cancel()
        return super().on_configure(state)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Publish the grids, and measure from now on."""
        result = super().on_activate(state)
        self.grid.publish(self._grid_message(self.levels))
        if self.filter is not None:
            grid, numbers = self.filter
            self.mask.publish(self._grid_message(grid))
            info = CostmapFilterInfo()
            info.header.stamp = self.get_clock().now().to_msg()
            info.filter_mask_topic = self.mask.topic_name  # with the namespace
            info.type, info.base, info.multiplier = numbers
            self.info.publish(info)
        self.timer.reset()
        return result

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Measure no more."""
        self.timer.cancel()
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Forget what `on_configure` made."""
        result = super().on_cleanup(state)
        for publisher in (self.grid, self.mask, self.info, self.status, self.diagnostics):
            self.destroy_lifecycle_publisher(publisher)
        self.destroy_service(self.answers)
        self.destroy_subscription(self.scans)
        self.destroy_timer(self.timer)
        self.listener.unregister()
        return result

    def _read(self) -> None:
        path = self._value("map")
        if not path:
            raise InputError("map: no ambiguity map is named; give map:=/maps/office.zarr.")
        self.amap = AmbiguityMap.open(path)
        for name in ("period", "stale_after", "prior", "pose"):
            value = np.array(self._value(name), dtype=np.float64)
            if not (np.isfinite(value) & (value > 0.0)).all():
                raise InputError(f"{name} is {self._value(name)}; give what is above 0.")
        self.levels = conversions.occupancy_grid(self.amap, self._value("layer"))
        self.service = AmbiguityService(self.amap, weight=self._value("weight"))
        text = self.amap.dataset.attrs["scanner_yaml"]
        self.scanner = RangeScanner.from_yaml_text(text).thinned(self._value("max_beams"))
        self.environment = self.amap.environment
        self.monitor = Monitor(
            Thresholds(
                *(self._value(name) for name in ("warn", "error", "explained", "hysteresis"))
            )
        )
        kind = self._value("filter")
        self.filter = conversions.filter_mask(self.amap, kind) if kind else None
        # The machine code is made before the first scan is waited for.
        self._measure((*self._any_place(), 0.0), np.full(self.scanner.beams, np.nan))

    def on_scan(self, scan: LaserScan) -> None:
        """Keep the last scan: by the next tick of the timer its transforms have come."""
        self.scan = scan

    def on_timer(self) -> None:
        """Measure the last scan, and say so."""
        now = None
        try:
            now = self._localizability()
        except TransformException as error:
            self.monitor.stale(f"no pose: {error}")
        except InputError as error:
            self.monitor.stale(str(error))
        message = self._diagnostics_message(now)
        self.diagnostics.publish(message)
        self.status.publish(message.status[0])

    def on_request(
        self, request: GetAmbiguity.Request, response: GetAmbiguity.Response
    ) -> GetAmbiguity.Response:
        """Answer what poses cost."""
        frame, own = request.header.frame_id, self._value("map_frame")
        try:
            if frame not in ("", own):
                raise InputError(f"frame_id: {frame!r}; give poses in {own!r}.")
            cost, level, state = conversions.ask(self.service, request.x, request.y, request.theta)
        except InputError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.cost, response.level = cost.tolist(), level.tolist()
        response.state = state.tolist()
        return response

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _localizability(self) -> Localizability | None:
        scan = self.scan
        if scan is None:
            self.monitor.stale("no scan yet")
            return None
        stamp = Time.from_msg(scan.header.stamp)
        age = (self.get_clock().now() - stamp).nanoseconds * 1e-9
        if age > self._value("stale_after"):
            self.monitor.stale(f"the last scan is {age:.1f} s old")
            return None
        base = self._value("base_frame")
        mounted = self.buffer.lookup_transform(base, scan.header.frame_id, stamp).transform
        robot = self.buffer.lookup_transform(self._value("map_frame"), base, stamp).transform
        towards = conversions.directions(
            scan.angle_min, scan.angle_increment, len(scan.ranges), _quaternion(mounted.rotation)
        )
        ranges = conversions.readings(scan.ranges, scan.range_min, scan.range_max)
        beams = conversions.beams_of(self.scanner, ranges, towards, scan.angle_increment)
        yaw = conversions.yaw_of(_quaternion(robot.rotation))
        now = self._measure((robot.translation.x, robot.translation.y, yaw), beams)
        if not now.beams:
            self.monitor.stale("the scan has no reading in the direction of any of the map's beams")
            return None
        self.monitor.update(now)
        return now

    def _measure(self, pose: tuple[float, float, float], ranges: np.ndarray) -> Localizability:
        return measure(
            self.environment, self.scanner, pose, ranges, self._value("prior"), self._value("pose")
        )

    def _any_place(self) -> tuple[float, float]:
        row, column = np.argwhere(self.amap.dataset["free"].values)[0]
        data = self.amap.dataset
        return float(data["x"].values[column]), float(data["y"].values[row])

    def _grid_message(self, grid: conversions.Grid) -> OccupancyGrid:
        message = OccupancyGrid()
        message.header.frame_id = self._value("map_frame")
        message.header.stamp = self.get_clock().now().to_msg()
        message.info.map_load_time = message.header.stamp
        message.info.resolution = grid.resolution
        message.info.width, message.info.height = grid.width, grid.height
        message.info.origin.position.x, message.info.origin.position.y = grid.origin
        message.info.origin.orientation.w = 1.0
        message.data = grid.data.tolist()
        return message

    def _diagnostics_message(self, now: Localizability | None) -> DiagnosticArray:
        status = DiagnosticStatus()
        status.level = LEVELS[self.monitor.state]
        status.name = f"{self.get_fully_qualified_name().strip('/')}: localizability"
        status.hardware_id = self.scanner.name
        status.message = self.monitor.text
        if now is not None:
            values = {
                "along (m)": f"{now.along:.3f}",
                "across (m)": f"{now.across:.3f}",
                "weak direction (rad)": f"{now.direction:.3f}",
                "explained": f"{now.explained:.3f}",
                "beams": str(now.beams),
            }
            status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        message.status = [status]
        return message


def _quaternion(rotation: Any) -> conversions.Quaternion:
    return rotation.x, rotation.y, rotation.z, rotation.w


def main() -> None:
    """Run the node until it is interrupted or terminated."""
    rclpy.init()
    node = AmbinavNode()
    try:
        if node.get_parameter("autostart").value:
            node.trigger_configure()
            if node.problem:
                sys.exit(f"ambinav: error: {node.problem}")
            node.trigger_activate()
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    except Exception:
        # SIGTERM ends the context: whatever fails from then on is the end itself.
        if rclpy.ok():
            raise
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
