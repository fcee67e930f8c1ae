"""A peer of the navigation environments: ir-sim, with the same walls, robot and beams."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from ambinav_envs.simulation.simulation import Simulation

SCRIPT = Path(__file__).with_name("peer_irsim.py")
# As in that script, which cannot be imported here.
ANSWER = "answer:"


def world_of(simulation: Simulation) -> dict[str, Any]:
    """Return ir-sim's world for a simulation: its robots in the first one's building.

    Without localizer, odometry, reward and paths to the goal, which ir-sim has none of.
    """
    site, p = simulation.sites[0], simulation.parameters
    assert site is not None
    free = site.building.environment.free
    left, low, right, high = site.building.environment.bounds
    rings = [ring for part in shapely.get_parts(free) for ring in (part.exterior, *part.interiors)]
    sensor = p.scanner.sensors[0]
    robots = [
        {
            "kinematics": {"name": "diff"},
            "shape": {"name": "circle", "radius": p.robot.radius},
            "state": pose.tolist(),
            "vel_max": [p.robot.max_speed, p.robot.max_turn_rate],
            "sensors": [
                {
                    "name": "lidar2d", "range_min": sensor.min_range,
                    "range_max": sensor.max_range, "angle_range": 2.0 * np.pi,
                    "number": p.scanner.beams, "noise": True, "std": 0.03,
                }
            ],
        }
        for pose in simulation.state["truth"]
    ]  # fmt: skip
    walls = [
        {"shape": {"name": "linestring", "vertices": shapely.get_coordinates(ring).tolist()}}
        for ring in rings
    ]
    world = {
        "width": right - left, "height": high - low, "offset": [left, low], "step_time": p.dt,
        "sample_time": p.dt, "collision_mode": "stop",
    }  # fmt: skip
    return {"world": world, "robot": robots, "obstacle": walls}


class IrSim:
    """ir-sim in a separate process.

    Args:
        python: Python of an environment where `pip install ir-sim` was run.
        world: See `world_of`.
        folder: Output folder of the world.
        steps: That a call takes.
    """

    def __init__(self, python: Path, world: dict[str, Any], folder: Path, steps: int) -> None:
        # JSON is YAML too.
        file = folder / f"world-{len(world['robot'])}.yaml"
        file.write_text(json.dumps(world))
        self.robots, self.steps = len(world["robot"]), steps
        self._process = subprocess.Popen(
            [python, SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder
        )
        self.version, robots, beams = self._ask(str(file)).split()
        if (int(robots), int(beams)) != (self.robots, world["robot"][0]["sensors"][0]["number"]):
            raise RuntimeError(f"ir-sim made {robots} robots with {beams} beams of {file}")

    def __enter__(self) -> IrSim:
        return self

    def __exit__(self, *error: object) -> None:
        """End the process."""
        self._process.communicate()

    def seconds(self) -> float:
        """Make the steps with all robots; return the seconds."""
        return float(self._ask(str(self.steps)))

    def _ask(self, line: str) -> str:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        for answer in self._process.stdout:
            if answer.startswith(ANSWER):
                return answer.removeprefix(ANSWER)
        raise RuntimeError("ir-sim has ended; its message stands above")
