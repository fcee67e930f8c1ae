"""Is a route of least time faster? Stamped drives of routes that minimise time, length and cost.

Pairs of places drawn in each building, 15 m and more apart, for a planar laser of 4 m and the
odometry `poor`. All routes keep to the same limits, and to the braking rule at 3 standard
deviations of their own forecast. Times over that of the shortest route: median and range over the
pairs. "places' error" and "no error" are the two routes of which `ambinav plan --minimise time`
takes the faster one, "least time".
"""

from __future__ import annotations

import sys

import numpy as np
from harness import arguments, environment_of, report, spread, table
from lasers import laser

import ambinav as an
from ambinav_planners import RoutePlanner

BUILDINGS = ("demo", "stata_hallways_5cm", "willow_full_005")
SPEEDS = (0.5, 1.5)
ACCELERATION = 1.0
ODOMETRY = "poor"
SEED = 0


def main() -> None:
    """Plan and print one table."""
    args = arguments(__doc__, pairs=15, spacing=0.2)
    rows = []
    for name in BUILDINGS:
        building = environment_of(name)
        amap = an.build_map(building, laser(), args.spacing, store=False)
        forecaster = an.Forecaster(amap, ODOMETRY)
        ends = pairs(amap, args.pairs)
        for fastest in SPEEDS:
            limits = an.SpeedLimits(max_speed=fastest, acceleration=ACCELERATION)
            rule, blind = (
                an.BrakingRule(radius=0.2, acceleration=ACCELERATION, sigmas=sigmas)
                for sigmas in (3.0, 0.0)
            )
            services = {"shortest": an.AmbiguityService(amap, weight=0.0)}
            services["weight 5"] = services["shortest"].with_weight(5.0)
            for title, how in (("places' error", rule), ("no error", blind)):
                slower = an.with_slowness(amap, how, fastest, odometry=ODOMETRY)
                services[title] = an.AmbiguityService(slower, "slowness", weight=1.0)
            seconds, lengths = {}, {}
            for title, service in services.items():
                robot = RoutePlanner(service)
                routes = [robot.plan(*pair) for pair in ends]
                bounds = [rule.bound(amap, forecaster(route)) for route in routes]
                drives = [r.timed(limits, bound=b) for r, b in zip(routes, bounds, strict=True)]
                seconds[title] = np.array([drive.duration for drive in drives])
                lengths[title] = np.array([drive.length for drive in drives])
            faster = seconds["places' error"] <= seconds["no error"]
            for part in (seconds, lengths):
                part["least time"] = np.where(faster, part["places' error"], part["no error"])
            for title in seconds:
                shares = (
                    spread((part[title] / part["shortest"]).tolist(), 2)
                    for part in (seconds, lengths)
                )
                mean = f"{seconds[title].mean():.0f}"
                rows.append((name, f"{fastest:g}", title, mean, *shares))
                print(*rows[-1], file=sys.stderr, flush=True)
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n"
    columns = (
        "building",
        "max speed, m/s",
        "route",
        "mean, s",
        "time / shortest",
        "length / shortest",
    )
    report("Least time", ["ambinav", "numpy"], body + table(columns, rows), args.out)


def pairs(amap: an.AmbiguityMap, count: int) -> list[tuple[list[float], list[float]]]:
    """Return poses drawn on the judged floor, half a metre from walls, 15 m and more apart."""
    rng = np.random.default_rng(SEED)
    row, column = np.nonzero((amap.dataset["clearance"].values > 0.5) & amap.judged.counted)
    x, y = (amap.dataset[axis].values for axis in "xy")
    places = np.column_stack([x[column], y[row], np.zeros(len(row))])
    drawn: list[tuple[list[float], list[float]]] = []
    while len(drawn) < count:
        a, b = places[rng.integers(len(places), size=2)].tolist()
        if np.hypot(b[0] - a[0], b[1] - a[1]) > 15.0:
            drawn.append((a, b))
    return drawn


if __name__ == "__main__":
    main()
