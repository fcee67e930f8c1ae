"""VFH+ in the loop of a ROS robot: LaserScan, Odometry and pose in, Twist out."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np

import ambinav_envs
from ambinav_envs import as_actions, load_policy

sys.path.insert(0, str(Path(__file__).parent / "ros2" / "ambinav_ros"))
from ambinav_ros.messages import odometry_message, pose_message, scan_message
from ambinav_ros.policy_loop import PolicyLoop

gym.register_envs(ambinav_envs)
env = gym.make("ambinav/Office-v1", buildings=1, **load_policy("vfh").seeing)
env.reset(seed=1)
# The robot, which anything could simulate: its readings, wheels and localizer are all that is read.
robot = env.unwrapped.simulation
state, parameters, task = robot.state, robot.parameters, robot.tasks[0]
loop = PolicyLoop(
    "vfh", robot.sites[0].building.environment, parameters.scanner, parameters.robot,
    task.start, task.goal,
)  # fmt: skip
angles, sensor = parameters.scanner.mounts[:, 2], parameters.scanner.sensors[0]
now, ended = 0.0, False
while not ended:
    scan = scan_message(now, robot.readings[0], angles, sensor.min_range, sensor.max_range)
    loop.on_scan(scan)
    loop.on_odometry(odometry_message(now, *state["speeds"][0]))
    loop.on_pose(pose_message(now, state["mean"][0], state["covariance"][0]))
    twist = loop.command(now)
    wanted = np.array([[twist.linear.x, twist.angular.z]])
    action = as_actions(wanted, parameters)[0]
    _, _, over, cut, info = env.step(action)
    now, ended = now + parameters.dt, over or cut
print(f"{info['outcome']} after {now:.1f} s")
