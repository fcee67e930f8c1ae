"""Start the node: `ros2 launch ambinav_ros ambinav.launch.py map:=/maps/office.zarr`."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode


def generate_launch_description() -> LaunchDescription:
    """The node with the parameters of config/ambinav.yaml, or of another file."""
    usual = Path(get_package_share_directory("ambinav_ros")) / "config" / "ambinav.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("map", description="An ambiguity map (.zarr)."),
            DeclareLaunchArgument("params", default_value=str(usual)),
            DeclareLaunchArgument("scan", default_value="scan", description="Topic of the scans."),
            DeclareLaunchArgument("namespace", default_value=""),
            DeclareLaunchArgument("use_sim_time", default_value="false"),
            LifecycleNode(
                package="ambinav_ros",
                executable="ambinav",
                name="ambinav",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("params"),
                    {
                        "map": LaunchConfiguration("map"),
                        "use_sim_time": LaunchConfiguration("use_sim_time"),
                    },
                ],
                remappings=[
                    ("scan", LaunchConfiguration("scan")),
                    ("/tf", "tf"),
                    ("/tf_static", "tf_static"),
                ],
                output="screen",
            ),
        ]
    )
