"""The node and the launch file of a mask with ROS 2 itself, where it is installed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

from ambinav import export_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from tests.maps import synthetic
from tests.ros2.conftest import PACKAGE

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("ros2") is None, reason="there is no ROS 2: stubs only"),
]


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "map.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    return path


def test_ros2_launch_reads_the_launch_file(stored, tmp_path):
    *_, launch = export_map(AmbiguityMap.open(stored), "nav2-speed", tmp_path / "mask.yaml")
    done = subprocess.run(
        ["ros2", "launch", str(launch), "--show-args"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert "'container_name'" in done.stdout and str(tmp_path / "mask_params.yaml") in done.stdout


def test_the_node_becomes_active_and_ends_by_sigterm(stored):
    pytest.importorskip("ambinav_interfaces", reason="the service of the example is not built")
    pytest.importorskip("nav2_msgs", reason="there is no Nav2")
    path = os.pathsep.join((str(PACKAGE), os.environ.get("PYTHONPATH", "")))
    node = subprocess.Popen(
        [
            sys.executable, "-c", "from ambinav_ros.node import main; main()", "--ros-args",
            "-r", "__ns:=/robot1", "-p", f"map:={stored}", "-p", "filter:=nav2-speed",
        ],
        env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        state, until = "", time.monotonic() + 90.0
        while "active [3]" not in state and node.poll() is None and time.monotonic() < until:
            ask = ["ros2", "lifecycle", "get", "/robot1/ambinav"]
            state = subprocess.run(ask, capture_output=True, text=True, timeout=30).stdout
        node.send_signal(signal.SIGTERM)
        _, errors = node.communicate(timeout=30)
    finally:
        node.kill()
    assert "active [3]" in state, errors
    assert node.returncode == 0 and "Traceback" not in errors
