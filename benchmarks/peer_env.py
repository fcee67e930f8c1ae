"""Steps of the navigation environments of any commit, requested by `bench_env_commits.py`.

It imports nothing but what all commits have.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numba
import numpy as np

from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.vector import NavigationVectorEnv

STEPS, ALONE = 2**16, 2000
"""Steps of all robots in a round, and of one robot."""


def towards(waypoint: Any) -> Any:
    """Return actions towards the waypoint: turn first, then drive."""
    angle = np.arctan2(waypoint[..., 2], waypoint[..., 1])
    speed = 2.0 * np.clip(1.5 * np.cos(angle) - 0.5, 0.0, 1.0) - 1.0
    return np.stack([speed, np.clip(angle, -1.0, 1.0)], axis=-1)


class Robots:
    """Robots that drive to the waypoint ahead; a call is a round."""

    def __init__(self, case: str) -> None:
        self.count, buildings, self.threads = map(int, case.split("/"))
        numba.set_num_threads(self.threads)
        options: dict[str, Any] = {
            "suite": "procedural", "buildings": buildings, "waypoint": True,
            "waypoint_distance": 0.5, "window": False,
        }  # fmt: skip
        self.envs: Any = NavigationVectorEnv(self.count, **options)
        if self.count == 1:
            self.envs = NavigationEnv(**options)
        for building in range(buildings):
            self.envs.reset(seed=0, options={"building": building})
        self.seen, _ = self.envs.reset(seed=0)
        self.steps = ALONE if self.count == 1 else STEPS // self.count

    def __call__(self) -> tuple[float, float]:
        """Return thousand steps per second by elapsed and processor time, without the policy."""
        numba.set_num_threads(self.threads)
        elapsed = worked = 0.0
        for _ in range(self.steps):
            actions = towards(self.seen["waypoint"])
            begin, busy = time.perf_counter(), time.process_time()
            self.seen, _, ended, cut, _ = self.envs.step(actions)
            if self.count == 1 and (ended or cut):
                self.seen, _ = self.envs.reset()
            elapsed += time.perf_counter() - begin
            worked += time.process_time() - busy
        taken = self.steps * self.count / 1e3
        return taken / elapsed, taken / worked


def main() -> None:
    """Run a round of each case named on standard input."""
    made: dict[str, Robots] = {}
    for line in sys.stdin:
        case = line.strip()
        if case not in made:
            made[case] = Robots(case)
        print(*made[case](), flush=True)


if __name__ == "__main__":
    main()
