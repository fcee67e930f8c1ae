"""Time of forecasts on maps that are open already: of routes, layers, an audit and ensembles.

Of layers and of the routes of an audit it is processor time, of the demo for a TurtleBot3's laser.
Ensembles drive the longest of the sampled routes; their time is stated for 50 m of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from harness import environment_of, interleave, option, parser_of, report, spread, table
from lasers import laser
from localizers import ROBOT

from ambinav.drive.odometries import odometry_of
from ambinav.forecasting.ensemble import EnsembleRunner
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.localizer_class import LocalizerClass, localizer_classes
from ambinav.geometry.collision.reach import find_reach, reach_of
from ambinav.layers.build import with_layers
from ambinav.map_building.build import build_map
from ambinav.routes.sampled import sample_routes
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.lost_routes import find_lost_routes

LENGTH = 50.0
RUNS = (32, 200)
"""Robots of an ensemble."""


def main() -> None:
    """Time the forecasts, and print the report."""
    parser = parser_of(
        __doc__,
        environments=option(("demo", "aces"), "names of environments"),
        routes=option(200, "routes that are sampled in each"),
        repeats=option(5, "rounds"),
    )
    args = parser.parse_args()
    header = [
        "environment", "metres a route", "routes a second", f"ms for {LENGTH:g} m, in batch",
        "ms for one route, causes included", "ms to prepare the map's information",
    ]  # fmt: skip
    rows = [timed_rows(name, args.routes, args.repeats) for name in args.environments]
    parts = table(header, rows), layers_and_audit(args.repeats), ensembles(args.repeats)
    body = "\n\n".join(parts)
    report("Forecasts", ("numpy", "numba"), body, args.out)


def timed_rows(name: str, count: int, repeats: int) -> list[str]:
    """Return the row of an environment."""
    environment = environment_of(name)
    amap = build_map(environment, laser(), store=False)
    forecaster = Forecaster(amap, "poor")
    rng = np.random.default_rng(7)
    drawn = sample_routes(environment, reach_of(environment, 0.2), count, rng)
    routes = [route for route in drawn for _ in range(5)]
    metres = 5.0 * sum(float(forecaster(route).distance[-1]) for route in drawn)
    timing = interleave(
        {
            "all": lambda: forecaster.lost_probabilities(routes),
            "one": lambda: forecaster(drawn[0]),
            "field": lambda: InformationField.of(amap, echoes=True),
        },
        repeats,
    )
    seconds = timing["all"].seconds
    return [
        name,
        f"{metres / len(routes):.1f}",
        spread([len(routes) / s for s in seconds], 0),
        spread([1e3 * s / metres * LENGTH for s in seconds], 3),
        spread([1e3 * s for s in timing["one"].seconds]),
        spread([1e3 * s for s in timing["field"].seconds], 0),
    ]


def layers_and_audit(repeats: int) -> str:
    """Return the table of layers of the forecast beside others, and of an audit's routes."""
    environment = environment_of("demo")
    amap = build_map(environment, RangeScanner.from_preset("turtlebot3-lds"), store=False)
    reach = find_reach(environment, 0.2)
    tasks: dict[str, Callable[[], object]] = {
        name: lambda name=name: with_layers(amap, [name])
        for name in ("expected_error", "lost_rate", "fisher", "localizability")
    }
    tasks["routes of an audit"] = lambda: find_lost_routes(amap, environment, reach)
    rows = []
    for name, task in tasks.items():
        task()  # compiles
        seconds = []
        for _ in range(repeats):
            begin = time.process_time()
            task()
            seconds.append(time.process_time() - begin)
        rows.append([name, spread(seconds, 1)])
    return table(["demo, 0.1 m", "s of processor time"], rows)


def ensembles(repeats: int) -> str:
    """Return the table of ensembles, of the localizers that drive in kernels."""
    environment, noise, rng = environment_of("demo"), odometry_of("poor"), np.random.default_rng(7)
    drawn = sample_routes(environment, reach_of(environment, ROBOT.radius), 50, rng)
    lengths = [np.hypot(*np.diff(each.poses[:, :2], axis=0).T).sum() for each in drawn]
    route, length = drawn[int(np.argmax(lengths))], max(lengths)
    rows = []
    localizers: dict[str, Any] = {
        name: LocalizerClass.load(name).chosen(laser(), noise) for name in localizer_classes()
    }
    for name, localizer in {**localizers, "ekf": "ekf"}.items():
        runner = EnsembleRunner(environment, laser(), localizer, robot=ROBOT, noise=noise)
        tasks: dict[str, Callable[[], object]] = {
            str(runs): lambda runs=runs, runner=runner: runner.drive(
                route, np.random.default_rng(1), runs
            )
            for runs in RUNS
        }
        timing = interleave(tasks, repeats)
        scaled = LENGTH / length
        rows.append(
            [name, *(spread([scaled * s for s in timing[run].seconds], 3) for run in tasks)]
        )
    header = [f"demo, {length:.0f} m", *(f"{n} runs, s for {LENGTH:g} m" for n in RUNS)]
    return table(header, rows)


if __name__ == "__main__":
    main()
