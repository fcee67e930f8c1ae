"""Launch file of a mask's servers, for `ros2 launch` (ROS 2 Humble and later).

It reads the parameters that lie beside it and puts in the mask's path and the namespace, so that
the files work from any folder, and installed together in the share of a package.
"""

from __future__ import annotations

from typing import Final

_LAUNCH: Final = '''\
"""Start the servers of the mask beside this file: ros2 launch ./FILE [namespace:=robot1].

Written by ambinav. It needs the packages nav2_map_server and nav2_lifecycle_manager.
"""

from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LoadComposableNodes, Node
from launch_ros.descriptions import ComposableNode

FILTER = "keepout"
BESIDE = str(Path(__file__).absolute()).removesuffix("_launch.py")
ARGUMENTS = {
    "namespace": ("", "Namespace of the nodes and of their topics."),
    "use_sim_time": ("false", "Whether the clock is that of a simulator."),
    "params_file": (f"{BESIDE}_params.yaml", "Parameters of the nodes."),
    "mask": (f"{BESIDE}.yaml", "The mask, a map_server file."),
    "use_composition": ("false", "Whether to load the nodes into a running container."),
    "container_name": ("nav2_container", "The container, in the namespace."),
}
# Package, executable and plugin of each node.
NODES = {
    f"{FILTER}_filter_mask_server": ("nav2_map_server", "map_server", "MapServer"),
    f"{FILTER}_costmap_filter_info_server": (
        "nav2_map_server", "costmap_filter_info_server", "CostmapFilterInfoServer",
    ),
    f"lifecycle_manager_{FILTER}_filter": (
        "nav2_lifecycle_manager", "lifecycle_manager", "LifecycleManager",
    ),
}


def nodes(context):
    """The mask server, the costmap filter info server, and their lifecycle manager."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    root = f"/{value['namespace'].strip('/')}".rstrip("/")
    document = yaml.safe_load(Path(value["params_file"]).read_text())
    composable, processes = [], []
    for name, (package, executable, plugin) in NODES.items():
        parameters = {"use_sim_time": value["use_sim_time"].lower() == "true"}
        for key, own in document[name]["ros__parameters"].items():
            if key == "yaml_filename":
                own = value["mask"]
            elif "topic" in key:
                own = f"{root}/{own.strip('/')}"
            parameters[key] = own
        known = {
            "package": package, "name": name, "namespace": root or "/", "parameters": [parameters],
        }
        composable.append(ComposableNode(plugin=f"{package}::{plugin}", **known))
        processes.append(Node(executable=executable, output="screen", **known))
    if value["use_composition"].lower() == "true":
        container = f"{root}/{value['container_name']}"
        return [
            LoadComposableNodes(
                target_container=container, composable_node_descriptions=composable
            )
        ]
    return processes


def generate_launch_description():
    """The arguments and the nodes."""
    arguments = [
        DeclareLaunchArgument(name, default_value=usual, description=text)
        for name, (usual, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])
'''


def launch_file(name: str) -> str:
    """Return the launch file of a filter's servers, Python.

    Args:
        name: Name of the filter, as in its parameters: "keepout", "preference", "speed", "binary".
    """
    return _LAUNCH.replace('FILTER = "keepout"', f'FILTER = "{name}"')
