"""Is a replan as good as a new plan, and how much faster?

Pairs of points in the buildings of `bench_plan.py`, weight 5, a disc of 0.2 m. A robot has a route;
then it has moved on by a quarter of it; then an obstacle of 0.6 m stands in the middle of what is
left; then it is gone. Each time the replan is compared with a plan from nothing at the same costs,
which has the lattice of the building, but not that with the obstacle.
"""

from __future__ import annotations

import sys

import numpy as np
import shapely
from bench_plan import ENVIRONMENTS
from harness import arguments, report, table, timed
from plan_case import RADIUS, pairs, service

from ambinav_planners import NoPathError, Replanner, RoutePlanner

STEPS = ("moved", "obstacle", "gone")


def main() -> None:
    """Replan and print one table."""
    args = arguments(__doc__, pairs=5, seed=7, environments=list(ENVIRONMENTS))
    rows: dict[str, list[tuple[float, float, float]]] = {step: [] for step in STEPS}
    closed = 0
    for name in args.environments:
        robot = RoutePlanner(service(name), footprint=RADIUS)
        for start, goal in pairs(robot, args.pairs, args.seed):
            planner = Replanner(robot, goal)
            first = planner.replan(start).route
            x, y, _ = first.poses[len(first.poses) // 4]
            remaining = first.poses[len(first.poses) // 4 :]
            middle = shapely.Point(remaining[len(remaining) // 2, :2]).buffer(0.3)
            barred = RoutePlanner(robot.service, footprint=RADIUS, keep_out=middle.buffer(RADIUS))
            for step, obstacles, fresh in zip(
                STEPS, (None, middle, shapely.GeometryCollection()), (robot, barred, robot),
                strict=True,
            ):  # fmt: skip
                try:
                    ours = planner.replan((x, y), obstacles=obstacles)
                except NoPathError:
                    closed += 1
                    continue
                seconds, new = timed(lambda fresh=fresh, at=(x, y), to=goal: fresh.plan(at, to))
                rows[step].append((ours.seconds, seconds, 100.0 * (ours.route.cost / new.cost - 1)))
        print(name, file=sys.stderr, flush=True)
    cells = []
    for step in STEPS:
        ours, new, dearer = np.array(rows[step]).T
        share = ours / new
        cells.append(
            (step, len(ours), f"{1e3 * np.median(ours):.0f}", f"{1e3 * np.median(new):.0f}",
             f"1/{1.0 / np.median(share):.0f}", f"1/{1.0 / np.quantile(share, 0.95):.0f}",
             f"{np.median(dearer):.2f}", f"{dearer.max():.2f}")
        )  # fmt: skip
    header = (
        "after", "plans", "replan ms", "new plan ms", "share, median", "share, 95th", "dearer %",
        "most %",
    )  # fmt: skip
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n"
    body += f"In {closed} cases the obstacle closes the way.\n\n{table(header, cells)}"
    report("Replanning", ["ambinav", "numpy"], body, args.out)


if __name__ == "__main__":
    main()
