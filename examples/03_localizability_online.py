"""How well does the scan just made fix the pose, along which direction, with people about?"""

import math

import numpy as np

import ambinav as an

environment = an.load_environment(an.DEMO_BUILDING)
scanner = an.RangeScanner.from_preset("turtlebot3-lds")
odometry = np.diag([0.1**2, 0.1**2, 0.05**2])  # covariance of the pose before the scan: m, m, rad
rng = np.random.default_rng(1)
for name, pose in {"office": (3.0, 3.0, 0.0), "corridor": (20.0, 13.0, 0.0)}.items():
    poses = np.array([pose])  # map frame: x, y (m), theta (rad, counter-clockwise)
    ranges = scanner.read(environment, *poses.T, rng)
    ranges[:, :40] = np.minimum(ranges[:, :40], 0.8)  # someone stands in front
    now = an.online_localizability(environment, scanner, poses, ranges, prior=odometry)
    major, minor, direction = (values[0] for values in now.radii)
    print(
        f"{name}: {major:.3f} m along {math.degrees(direction):.0f} degrees, {minor:.3f} m across"
    )
    print(f"  {now.explained[0]:.0%} of the echoes are of the map")
