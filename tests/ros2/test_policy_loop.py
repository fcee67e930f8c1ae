"""A policy driven by messages does what it does in the environment; no ROS anywhere."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from ambinav_ros.messages import (
    LaserScan,
    Odometry,
    PoseWithCovarianceStamped,
    Twist,
    odometry_message,
    pose_message,
    scan_message,
)
from ambinav_ros.policy_loop import PolicyLoop

from ambinav.runtime.errors import InputError
from ambinav_envs.commands import as_commands
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.policies import load_policy
from tests.envs.cases import room

POLICY = "vfh"


def made() -> tuple[NavigationEnv, PolicyLoop]:
    env = NavigationEnv(map=room(), odometry_scale=2.0, **load_policy(POLICY).seeing)
    env.reset(seed=3)
    simulation = env.simulation
    parameters, task = simulation.parameters, simulation.tasks[0]
    assert task is not None
    return env, PolicyLoop(
        POLICY, room(), parameters.scanner, parameters.robot, tuple(task.start), tuple(task.goal)
    )


def messages(env: NavigationEnv, now: float, turned: int = 0) -> tuple[Any, ...]:
    """What a robot would publish; the scan may begin at another beam."""
    simulation = env.simulation
    state, scanner = simulation.state, simulation.parameters.scanner
    step = math.tau / scanner.beams
    angles = scanner.mounts[0, 2] + step * (turned + np.arange(scanner.beams))
    ranges = np.roll(simulation.readings[0], -turned)
    sensor = scanner.sensors[0]
    return (
        scan_message(now, ranges, angles, sensor.min_range, sensor.max_range),
        odometry_message(now, *state["speeds"][0]),
        pose_message(now, state["mean"][0], state["covariance"][0]),
    )


def tell(loop: PolicyLoop, told: tuple[Any, ...]) -> None:
    scan, odometry, pose = told
    loop.on_scan(scan)
    loop.on_odometry(odometry)
    loop.on_pose(pose)


@pytest.mark.slow
def test_its_time_step_is_that_of_the_training() -> None:
    env, loop = made()
    assert loop.dt == env.simulation.parameters.dt
    parameters, task = env.simulation.parameters, env.simulation.tasks[0]
    assert task is not None
    given = room(), parameters.scanner, parameters.robot, tuple(task.start), tuple(task.goal)
    assert PolicyLoop(POLICY, *given, rate=10.0).dt == 0.1


@pytest.mark.slow
def test_actions_are_those_in_the_environment() -> None:
    env, loop = made()
    policy, parameters = load_policy(POLICY), env.simulation.parameters
    policy.configure(parameters)
    policy.prepare(env.observation_space, env.action_space)
    seen, _ = env.reset(seed=3)
    begun, now, ended, driven = True, 0.0, False, 0
    while not ended:
        tell(loop, messages(env, now, turned=7 * (driven % 3)))
        twist = loop.command(now)
        rows = {name: part[None] for name, part in seen.items()}
        action = policy.act(rows, np.array([begun]))[0]
        (wanted,) = as_commands(action[None], parameters)
        assert [twist.linear.x, twist.angular.z] == pytest.approx(wanted, abs=1e-5)
        seen, _, over, cut, _ = env.step(action)
        begun, now, ended, driven = False, now + parameters.dt, over or cut, driven + 1
    assert driven > 20


@pytest.mark.slow
def test_it_stands_without_news_and_refuses_nonsense() -> None:
    env, loop = made()
    assert loop.waiting_for(0.0) == ("scan", "odometry", "pose")
    assert loop.command(0.0) == Twist()
    scan, odometry, pose = messages(env, 5.0)
    tell(loop, (scan, odometry, pose))
    assert loop.waiting_for(5.4) == ()
    # Another clock: its stamps would never become too old.
    assert loop.waiting_for(4.0) == ("scan", "odometry", "pose") == loop.waiting_for(math.nan)
    assert loop.command(5.4) != Twist()
    loop.on_scan(messages(env, 5.6)[0])
    assert loop.waiting_for(5.7) == ("odometry", "pose")
    assert loop.command(5.7) == Twist()
    half = LaserScan(scan.header, -1.5, 1.5, 0.1, range_max=4.0, ranges=np.ones(31, np.float32))
    with pytest.raises(InputError, match=r"31 readings .* leave out \d+ of the policy's 60 beams"):
        loop.on_scan(half)
    pose.pose.covariance = [0.0] * 9
    with pytest.raises(InputError, match="9 numbers; give 36"):
        loop.on_pose(pose)
    pose.pose.pose.position.x = math.nan
    with pytest.raises(InputError, match=r"pose: \[nan, .*\] is not finite"):
        loop.on_pose(pose)
    odometry.twist.twist.linear.x = math.inf
    with pytest.raises(InputError, match=r"odometry: .* is not finite"):
        loop.on_odometry(odometry)
    pose.pose.pose.orientation.w = pose.pose.pose.orientation.z = 0.0
    with pytest.raises(InputError, match="not a rotation"):
        loop.on_pose(pose)


@pytest.mark.slow
def test_failed_readings_are_no_echo() -> None:
    """Without a policy: what the loop keeps of a scan."""
    loop = PolicyLoop.__new__(PolicyLoop)
    env = NavigationEnv(map=room())
    env.reset(seed=1)
    scanner = env.simulation.parameters.scanner
    loop._scanner, loop._mounted, loop._heard = scanner, (0.0, 0.0, 0.0, 1.0), {}
    loop._ranges = np.zeros((1, scanner.beams), np.float32)
    scan = messages(env, 0.0)[0]
    scan.ranges = np.full(scanner.beams, 2.0, np.float32)
    scan.range_min = 0.1
    scan.ranges[:5] = math.nan, 0.0, math.inf, 9.0, 0.05
    loop.on_scan(scan)
    assert loop._ranges[0, :6].tolist() == [math.inf] * 4 + [-math.inf, 2.0]


def test_messages_are_shaped_as_those_of_ros() -> None:
    """Fields by name and order, as the definitions of ROS 2 Jazzy have them."""
    shapes = {
        LaserScan: "header angle_min angle_max angle_increment time_increment scan_time range_min "
        "range_max ranges intensities",
        Odometry: "header child_frame_id pose twist",
        PoseWithCovarianceStamped: "header pose",
        Twist: "linear angular",
    }
    for kind, names in shapes.items():
        assert list(kind.__dataclass_fields__) == names.split()
    pose = pose_message(1.25, [1.0, 2.0, -3.0], np.arange(9.0).reshape(3, 3))
    assert (pose.header.stamp.sec, pose.header.stamp.nanosec) == (1, 250_000_000)
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    assert [covariance[0, 5], covariance[5, 1], covariance[5, 5]] == [2.0, 7.0, 8.0]
