"""What zone of floor tells best, of scanners that do not look all around, who gets lost there?

Straight drives of 6 m in free directions through buildings, of robots that know their start, with
poor odometry and Monte Carlo localization. Each is judged by the share of its cells that are bad

- at the heading driven;
- in the zones of the radii in the mean over headings;
- at half or more of the headings (ties count as bad);

and compared with the share of robots that are more than 0.5 m off at its end. The criterion,
written before the whole run: zones of floor that call few robots' losses good, as those of the
heading driven do, are to be the map's; among such the one that ranks lines best.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
from harness import environment_of, option, parser_of, report, table
from localizers import ROBOT, localizer_of
from numpy.typing import NDArray
from scipy.stats import spearmanr
from truth_case import NOISE, RATE, driven, reseed

from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.tensor import classify
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import BAD, NOT_FREE
from ambinav.routes.evaluate import evaluate_route
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService

BUILDINGS = (
    "demo", "nav2_depot", "stata_basement", "stata_hallways_5cm", "intel", "edmonton", "aces",
    "belgioioso",
)  # fmt: skip
SCANNERS = "vl53l5cx", "hc-sr04", "hokuyo-urg-04lx"
JUDGES = "heading driven", "mean radii", "half of the headings"
LENGTH = 6.0
LOST = 0.5
RUNS = 8
GOOD, MOSTLY_BAD = 0.2, 0.8
"""A line is good up to the one share of bad cells, and bad from the other."""
MOST_TRIES = 50_000

Floats = NDArray[np.float64]


def main() -> None:
    """Drive along the lines and print the report."""
    args = parser_of(
        __doc__,
        environments=option(BUILDINGS, "names of environments"),
        scanners=option(SCANNERS, "presets"),
        lines=option(40, "lines in each"),
    ).parse_args()
    rows: list[list[str]] = []
    for preset in args.scanners:
        scanner = RangeScanner.from_preset(preset)
        parts = [figures(environment_of(name), scanner, args.lines) for name in args.environments]
        rows += [
            [preset, judge, *summary([(part[:, k], part[:, -2], part[:, -1]) for part in parts])]
            for k, judge in enumerate(JUDGES)
        ]
    head = [
        "scanner", "judged by", "bad cells, %", "good lines", "lost there, %", "bad lines",
        "lost there, %", "rank correlation",
    ]  # fmt: skip
    body = (
        f"Up to {args.lines} lines of {LENGTH:g} m in each of {', '.join(args.environments)}, "
        f"{RUNS} robots each. Good lines have at most {GOOD:.0%} bad cells, bad ones at least "
        f"{MOSTLY_BAD:.0%}. Rank correlation: of the share of bad cells with the root mean square "
        "error at the end, in the mean over buildings where both vary.\n\n" + table(head, rows, 2)
    )
    report("Zones of floor and losses on straight lines", ("numpy", "numba"), body, args.out)


def figures(environment: Environment, scanner: RangeScanner, count: int) -> Floats:
    """Return, of each line: shares of bad cells by `JUDGES`, RMS error (m), share lost."""
    amap = build_map(environment, scanner, spacing=0.25, store=False)
    bad = judged_bad(amap)
    checker = CollisionChecker(environment, ROBOT.footprint, Steering())
    localizer = localizer_of("product", environment, scanner, NOISE, RUNS, RATE)
    assert isinstance(localizer, MclParameters)
    mcl = MonteCarloLocalizer(
        environment, scanner, localizer, runs=RUNS, rng=np.random.default_rng(0)
    )
    service = AmbiguityService(amap)
    rows = []
    for number, (heading, line) in enumerate(lines(amap, checker, count)):
        rng, localizer_rng = np.random.default_rng([9, number]).spawn(2)
        reseed(mcl, localizer_rng)
        route = evaluate_route(service, line, Steering(), planner="line")
        errors = driven(environment, scanner, route, mcl, environment, rng, RUNS).errors()[:, -1]
        off = np.hypot(errors[:, 0], errors[:, 1])
        cells = np.linspace(0.0, 1.0, 49)[:, None] * (line[1] - line[0]) + line[0]
        column = np.rint((cells[:, 0] - amap.dataset["x"].values[0]) / amap.spacing).astype(int)
        row = np.rint((cells[:, 1] - amap.dataset["y"].values[0]) / amap.spacing).astype(int)
        shares = [layer[row, column].mean() for layer in (bad[0][heading], *bad[1:])]
        rows.append([*shares, np.sqrt(np.mean(off**2)), np.mean(off > LOST)])
    return np.array(rows).reshape(len(rows), len(JUDGES) + 2)


def judged_bad(amap: AmbiguityMap) -> tuple[NDArray[np.bool_], ...]:
    """Return which cells are bad at each heading, in the mean of radii, and at half of them."""
    zone, major, minor = (
        amap.dataset[name].transpose("theta", "y", "x").values
        for name in ("zone", "major", "minor")
    )
    bad, possible = np.isin(zone, BAD), (zone != NOT_FREE).sum(axis=0)
    half = (possible > 0) & (2 * bad.sum(axis=0) >= possible)
    model = AmbiguityModel(radius=0.5, map_std=0.05, tau=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no heading is possible in a wall
        mean = classify(np.nanmean(major, 0), np.nanmean(minor, 0), model.low, model.high)
    return bad, np.isin(mean, BAD), half


def lines(
    amap: AmbiguityMap, checker: CollisionChecker, count: int
) -> Iterator[tuple[int, Floats]]:
    """Draw free lines of `LENGTH`: index of the heading, both poses, shape (2, 3)."""
    rng = np.random.default_rng(5)
    x, y, theta = (amap.dataset[name].values for name in ("x", "y", "theta"))
    rows, columns = np.nonzero(amap.judged.counted)
    for _ in range(MOST_TRIES):
        if not count:
            return
        k, heading = rng.integers(len(rows)), int(rng.integers(len(theta)))
        start = np.array([x[columns[k]], y[rows[k]], theta[heading]])
        ahead = LENGTH * np.array([np.cos(start[2]), np.sin(start[2]), 0.0])
        line = np.array([start, start + ahead])
        if checker.poses_free(line).all() and checker.motions_free(line[:1], line[1:])[0]:
            count -= 1
            yield heading, line


def summary(parts: list[tuple[Floats, Floats, Floats]]) -> list[str]:
    """Return bad cells, number of good and bad lines with losses, and the rank correlation."""
    share, _, lost = (np.concatenate(column) for column in zip(*parts, strict=True))
    cells = [f"{share.mean():.0%}"[:-1]]
    for group in (share <= GOOD, share >= MOSTLY_BAD):
        cells += [str(group.sum()), f"{100.0 * lost[group].mean():.1f}" if group.any() else "-"]
    ranks = [
        spearmanr(part, errors).statistic
        for part, errors, _ in parts
        if len(part) > 2 and np.ptp(part) > 0.0 and np.ptp(errors) > 0.0
    ]
    return [*cells, f"{np.mean(ranks):.2f} ({len(ranks)})" if ranks else "-"]


if __name__ == "__main__":
    main()
