"""Steps of ir-sim for `bench_env.py`, in a separate Python because of its dependencies.

The first line on standard input is the file of the world; every other line is a number of steps,
which is answered by the seconds that they took. Answers begin with `ANSWER`: ir-sim prints too.
"""

from __future__ import annotations

import sys
import time

import irsim
import numpy as np

ANSWER = "answer:"
# Speed (m/s) and turn rate (rad/s): slow circles, so that nothing is hit.
ACTION = np.array([[0.0025], [0.2]])


def main() -> None:
    """Answer requests until standard input ends."""
    env = irsim.make(sys.stdin.readline().strip(), display=False, log_level="ERROR")
    robots = len(env.robot_list)
    scan = env.robot_list[0].get_lidar_scan()
    print(ANSWER, irsim.__version__, robots, len(scan["ranges"]), flush=True)
    for line in sys.stdin:
        begin = time.perf_counter()
        for _ in range(int(line)):
            env.step([ACTION] * robots if robots > 1 else ACTION)
            for robot in env.robot_list:
                robot.get_lidar_scan()
        print(ANSWER, time.perf_counter() - begin, flush=True)


if __name__ == "__main__":
    main()
