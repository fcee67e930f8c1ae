"""Do forecasts hold where few beams return an echo, of localizers with a likelihood field?

Routes between places that are drawn in each building are forecast, and driven with the same
localizer, for two lasers of short range and poor odometry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from harness import environment_of, option, parser_of, report, table
from numpy.typing import NDArray

from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.forecasting.information_field import ECHOES, InformationField
from ambinav.geometry.collision.reach import reach_of
from ambinav.map_building.build import build_map
from ambinav.routes.sampled import sample_routes
from ambinav.sensing.scanner import RangeScanner

BUILDINGS = (
    "demo", "nav2_depot", "edmonton", "aces", "stata_hallways_5cm", "mrpt_uwb_hall", "belgioioso",
)  # fmt: skip
LASERS = "turtlebot3-lds", "hokuyo-urg-04lx"
RADIUS = 0.25
DRAWS = 4000
FEW = 0.1
"""Share of the beams that is few, if not none: without any the forecast is of dead reckoning."""
NOTABLE = 1.0
"""Metres with few echoes from which a route is of the first group."""


def main() -> None:
    """Forecast and drive the routes, and print the report."""
    parser = parser_of(
        __doc__,
        environments=option(BUILDINGS, "names of environments"),
        localizers=option(("product", "amcl"), "classes of localizers"),
        routes=option(30, "routes in each"),
        drives=option(64, "drives of each route"),
    )
    args = parser.parse_args()
    rows = []
    for localizer in args.localizers:
        groups = [
            figures(name, laser, localizer, args.routes, args.drives)
            for name in args.environments
            for laser in LASERS
        ]
        for text, expected in (
            (f"at least {NOTABLE:g} m", True),
            (f"less than {NOTABLE:g} m", False),
        ):
            parts = [group[(group[:, 2] >= NOTABLE) == expected] for group in groups]
            rows.append([localizer, text, *summary([part for part in parts if len(part)])])
    head = ["localizer", "few echoes on", "routes", "forecast lost, %", "driven lost, %", "points"]
    body = (
        f"{args.routes} routes in each of {', '.join(args.environments)} for "
        f"{' and '.join(LASERS)}, odometry poor, {args.drives} drives each. Points: driven "
        "less forecast, and the interval of 95 %, buildings and lasers resampled.\n\n"
        + table(head, rows, words=2)
    )
    report("Forecasts where few beams return an echo", ("numpy", "numba"), body, args.out)


def figures(name: str, laser: str, localizer: str, count: int, drives: int) -> NDArray[np.float64]:
    """Return forecast and driven share, and metres with few echoes, of each route."""
    environment = environment_of(name)
    amap = build_map(environment, RangeScanner.from_preset(laser), spacing=0.25, store=False)
    routes = sample_routes(
        environment, reach_of(environment, RADIUS), count, np.random.default_rng(7)
    )
    forecaster = Forecaster(amap, "poor", localizer)
    runner = forecaster.runner()
    rows = []
    for route in routes:
        forecast = forecaster(route)
        lost = runner.drive(route, np.random.default_rng(3), drives).lost
        few = few_echo_metres(forecast, forecaster.field)
        rows.append((forecast.lost_probability, lost.mean(), few))
    return np.array(rows)


def few_echo_metres(forecast: Forecast, field: InformationField) -> float:
    """Return the metres of a route with echoes in some beams, but in fewer than `FEW` of them."""
    echoes = replace(field, entries=field.entries[:, ECHOES:]).at(forecast.poses)
    share, along = np.sqrt(echoes[:, 0, 0] + echoes[:, 1, 1]), forecast.distance
    edges = np.concatenate([along[:1], (along[1:] + along[:-1]) / 2.0, along[-1:]])
    return float(np.diff(edges)[(share > 1e-3) & (share < FEW)].sum())


def summary(groups: list[NDArray[np.float64]]) -> list[str]:
    """Return how many routes there are, both shares, and their difference with its interval."""
    rows = np.concatenate(groups)
    rng = np.random.default_rng(1)
    drawn = [
        np.concatenate([groups[k] for k in rng.integers(len(groups), size=len(groups))])
        for _ in range(DRAWS)
    ]
    points = [100.0 * float((part[:, 1] - part[:, 0]).mean()) for part in (rows, *drawn)]
    low, high = np.percentile(points[1:], (2.5, 97.5))
    forecast, driven = 100.0 * rows[:, :2].mean(axis=0)
    return [
        str(len(rows)), f"{forecast:.1f}", f"{driven:.1f}",
        f"{points[0]:+.1f} ({low:+.1f} to {high:+.1f})",
    ]  # fmt: skip


if __name__ == "__main__":
    main()
