"""Is the `reference` a yardstick? Long runs of PRM* against it, with and without limits.

- Six buildings, the pairs of `bench_plan.py`, weight 5, a disc of 0.2 m: plain; with at most 95,
  80, 60 or 40 % of the longest bad stretch of the shortest route (`max_bad_metres`); and with the
  open zone closed (`avoid_open`).
- Drawn rooms of 8 x 6 m, cut by slanted walls with slots that are 1 mm to 40 cm wider than the
  robot, with crates, robots of 0.1 to 0.3 m and lattices of 0.1 to 0.4 m.

A gap is how much more PRM* costs than the reference, in per cent: below 0, PRM* found a cheaper
route. Missed: routes that PRM* found where the reference found none.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from bench_plan import ENVIRONMENTS
from harness import arguments, option, report, table
from lasers import laser
from plan_case import RADIUS, pairs, service

import ambinav as an
from ambinav.runtime.errors import InputError
from ambinav_planners import NoPathError, NotFoundError, RoutePlanner
from ambinav_planners.search.limit import longest_bad

BAD_LEVEL = 0.4
SHARES = (0.95, 0.8, 0.6, 0.4)
LEAST_BAD = 0.5
SIZE = (8.0, 6.0)
WIDER = (0.001, 0.003, 0.01, 0.03, 0.06, 0.15, 0.4)
"""Extra width of a slot compared with the robot, metres."""
MODES = ("plain", "limit", "open zone closed")

Row = tuple[str, str, float | None, bool]


def main() -> None:
    """Compare and print one table."""
    args = arguments(
        __doc__, pairs=10, rooms=40, iterations=option(4000, "milestones of PRM*"), seed=7
    )
    rows: list[Row] = []
    for name in ENVIRONMENTS:
        rows += in_building(name, args.pairs, args.seed, args.iterations)
        print(name, file=sys.stderr, flush=True)
    for number in range(args.rooms):
        rows += in_room(np.random.default_rng([args.seed, number]), args.iterations // 2)
    print("rooms", file=sys.stderr, flush=True)
    cells = [
        line([row for row in rows if row[:2] == (place, mode)], place, mode)
        for place in (*ENVIRONMENTS, "rooms")
        for mode in MODES
    ]
    header = ("where", "what", "routes", "least gap %", "median %", "most %", "missed")
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n"
    body += table(header, [cell for cell in cells if cell[2] != "0"], words=2)
    report("The reference as a yardstick", ["ambinav", "numpy", "ompl"], body, args.out)


def line(rows: Sequence[Row], place: str, mode: str) -> tuple[str, ...]:
    """Return one line of the table."""
    gaps = np.array([gap for _, _, gap, _ in rows if gap is not None])
    missed = sum(miss for *_, miss in rows)
    if not len(gaps):
        return place, mode, str(missed), "", "", "", str(missed)
    least, middle, high = gaps.min(), np.median(gaps), gaps.max()
    return place, mode, str(len(gaps)), f"{least:.3f}", f"{middle:.3f}", f"{high:.2f}", str(missed)


def in_building(name: str, count: int, seed: int, iterations: int) -> list[Row]:
    """Compare pairs of points in a building, without and with limits."""
    cost = service(name)
    robot = RoutePlanner(cost, footprint=RADIUS)
    closed = RoutePlanner(cost, footprint=RADIUS, avoid_open=True)
    rows = []
    for number, (start, goal) in enumerate(pairs(robot, count, seed)):
        rows.append(compared(name, MODES[0], robot, start, goal, iterations))
        shortest = robot.plan(start, goal, planner_name="reference", weight=0.0)
        longest = longest_bad(shortest.poses, cost, robot.checker.steering, BAD_LEVEL)
        if longest > LEAST_BAD:
            limit = longest * SHARES[number % len(SHARES)]
            kept = RoutePlanner(cost, footprint=RADIUS, max_bad_metres=limit, bad_level=BAD_LEVEL)
            rows.append(compared(name, MODES[1], kept, start, goal, iterations))
        rows.append(compared(name, MODES[2], closed, start, goal, iterations))
    return rows


def in_room(rng: np.random.Generator, iterations: int) -> list[Row]:
    """Compare three plans in a random room."""
    radius = float(rng.choice([0.1, 0.2, 0.3]))
    amap = an.build_map(
        drawn(rng, radius), laser(beams=36), spacing=float(rng.choice([0.1, 0.2, 0.4])), store=False
    )
    level = amap.dataset["level"].values
    options: dict[str, dict[str, Any]] = {
        MODES[0]: {},
        MODES[1]: {
            "max_bad_metres": float(rng.uniform(0.3, 2.5)),
            "bad_level": float(np.nanquantile(level, rng.uniform(0.3, 0.8))),
        },
        MODES[2]: {"avoid_open": True},
    }
    cost = an.AmbiguityService(amap, weight=float(rng.choice([0.0, 5.0])))
    rows = []
    for mode, options_of_mode in options.items():
        robot = RoutePlanner(cost, footprint=radius, **options_of_mode)
        for _ in range(60):
            low, high = [0.3, 0.3, 0.0], [SIZE[0] - 0.3, SIZE[1] - 0.3, 0.0]
            start, goal = rng.uniform(low, high, (2, 3))
            if abs(start[0] - goal[0]) > 2.5 and robot.checker.poses_free([start, goal]).all():
                rows.append(compared("rooms", mode, robot, start, goal, iterations))
                break
    return rows


def drawn(rng: np.random.Generator, radius: float) -> an.Environment:
    """Draw a room with one to three slanted walls, slots in them, and crates."""
    width, height = SIZE
    solid = []
    for _ in range(rng.integers(1, 4)):
        lean, x = math.tan(rng.uniform(-0.6, 0.6)), rng.uniform(2.0, 6.0)
        base = shapely.LineString([(x - 4.0 * lean, -1.0), (x + 5.0 * lean, height + 1.0)])
        wall = base.buffer(rng.choice([0.02, 0.1, 0.3, 1.0]) / 2, cap_style="flat")
        for _ in range(rng.integers(1, 4)):
            middle = base.interpolate(rng.uniform(1.8, base.length - 1.8))
            across = math.atan2(7.0, 9.0 * lean) + math.pi / 2 + rng.uniform(-0.5, 0.5)
            run = 2.0 * np.array([math.cos(across), math.sin(across)])
            at = np.array([middle.x, middle.y])
            slot = shapely.LineString([at - run, at + run])
            wide = radius + rng.choice(WIDER) / 2
            wall = wall.difference(slot.buffer(wide, cap_style="flat"))
        solid.append(wall)
    for x, y, size, turn in rng.uniform((0.5, 0.5, 0, 0), (7.5, 5.5, 0.5, 90), (5, 4)):
        solid.append(
            shapely.affinity.rotate(shapely.box(x - 0.1, y - 0.1, x + size, y + 0.1), turn)
        )
    free = shapely.difference(shapely.box(0.0, 0.0, width, height), shapely.union_all(solid))
    return an.environment_from_shapes(
        [part for part in shapely.get_parts(free) if part.area > 0.05]
    )


def compared(
    place: str, mode: str, robot: RoutePlanner, start: Any, goal: Any, iterations: int
) -> Row:
    """Return the gap of PRM* to the reference, or None, and whether only PRM* found a path."""
    ours = cost_of(robot, start, goal, "reference")
    theirs = cost_of(robot, start, goal, "prmstar", iterations=iterations, seconds=math.inf)
    gap = 100.0 * (theirs / ours - 1.0) if ours and theirs else None
    return place, mode, gap, theirs is not None and ours is None


def cost_of(robot: RoutePlanner, start: Any, goal: Any, name: str, **budget: Any) -> float | None:
    """Return the cost of the route that a planner finds; None for none."""
    try:
        return robot.plan(start, goal, planner_name=name, **budget).cost
    except (NotFoundError, NoPathError, InputError):
        return None


if __name__ == "__main__":
    main()
