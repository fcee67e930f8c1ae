"""What is a detour in space worth? Flights through two buildings (IFC) at three weights.

Maps at five heights for a planar laser of 4 m, cells of 0.2 m, a sphere of 0.2 m; from and to the
two places farthest apart of 100 drawn at the lowest height. Informed RRT* with the same seeds at
each weight. Length and mean level along the route: median and range over the seeds; of the cheapest
one the share by which any could be cheaper, as it is proved, and the seconds of the proof.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from harness import arguments, data_file, option, report, spread, table
from lasers import laser
from scipy.ndimage import binary_erosion, label

import ambinav as an
from ambinav_planners import FlightPlanner, certify

BUILDINGS = {
    "office": ("plans/institute.ifc", "Erdgeschoss", 0.0),
    "flat": ("plans/duplex.ifc", "Level 1", 0.0),
}
"""File, storey, and z of its floor, metres."""
HEIGHTS = np.linspace(0.4, 2.2, 5)
WEIGHTS = (0.0, 5.0, 20.0)
RADIUS = 0.2
SEED = 7


def main() -> None:
    """Fly and print one table."""
    args = arguments(
        __doc__, seeds=5, seconds=4.0, picture=option(Path("out/flight.png"), "of the office")
    )
    rows = []
    for name, (file, level, floor) in BUILDINGS.items():
        building = an.load_environment(data_file(file), level=level, in_space=True)
        heights = (floor + HEIGHTS).tolist()
        volume = an.build_volume(building, laser(), heights, robot_radius=RADIUS, store=False)
        start, goal = ends(volume)
        for weight in WEIGHTS:
            service = an.VolumeService(volume, weight=weight)
            robot = FlightPlanner(service, building, radius=RADIUS)
            flights = []
            for seed in range(args.seeds):
                flight = robot.plan(
                    start, goal, planner_name="informed-rrtstar", seconds=args.seconds, seed=seed
                )
                flights.append(flight)
                if (name, weight, seed) == ("office", 5.0, 0):
                    args.picture.parent.mkdir(parents=True, exist_ok=True)
                    flight.draw(args.picture)
            proof = certify(robot, min(flights, key=lambda flight: flight.cost))
            lengths = [flight.length for flight in flights]
            levels = [flight.mean_level for flight in flights]
            proved = f"{100.0 * proof.gap:.1f}", f"{proof.seconds:.0f}"
            rows.append((name, f"{weight:g}", spread(lengths, 1), spread(levels, 3), *proved))
            print(*rows[-1], file=sys.stderr, flush=True)
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n"
    header = "building", "weight", "length, m", "mean level", "gap, %", "proof, s"
    body += table(header, rows)
    report("Flights", ["ambinav", "numpy", "ompl"], body, args.out)


def ends(volume: an.AmbiguityVolume) -> tuple[list[float], list[float]]:
    """Return the two places farthest apart of some drawn at the lowest height, in one free part.

    All neighbours of their cells are free, so the sphere fits there.
    """
    part, _ = label(volume.dataset["free"].values)
    largest = part == np.bincount(part[part > 0]).argmax()
    free = binary_erosion(largest[0], np.ones((3, 3)), iterations=2)
    row, column = np.nonzero(free)
    drawn = np.random.default_rng(SEED).integers(len(row), size=100)
    x, y = (volume.dataset[axis].values for axis in "xy")
    places = np.column_stack([x[column[drawn]], y[row[drawn]]])
    away = np.hypot(*(places[:, np.newaxis] - places).transpose(2, 0, 1))
    a, b = np.unravel_index(int(away.argmax()), away.shape)
    z = float(volume.heights[0])
    return [*places[a].tolist(), z], [*places[b].tolist(), z]


if __name__ == "__main__":
    main()
