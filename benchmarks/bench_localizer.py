"""Updates per second of Monte Carlo localization, and its error against the bound.

One thread, one run: a drive along the demo building's corridor with an update every 0.3 m. Then
many runs at once on all threads. An update is the motion of all particles, the likelihood of one
scan, resampling and the estimate.
"""

from __future__ import annotations

import argparse
import math
import time
from functools import partial

import numba
import numpy as np
from harness import add_out, environment_path, interleave, report, spread, table
from localizers import alphas_of
from numpy.typing import NDArray

from ambinav.buildings.load import load_environment
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import LASER_MODELS, RESAMPLING, MclParameters
from ambinav.localization.random import states
from ambinav.map_building.build import build_map
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_planners import RoutePlanner

LIBRARIES = ("ambinav", "numba", "numpy")
# Required updates per second on one core with 1 000 particles and 60 beams.
WANTED = 100
STEP = 0.3
ODOMETRY = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4"), 0.02)
START = np.diag([0.05**2, 0.05**2, 0.03**2])
Floats = NDArray[np.float64]


def scanner_of(beams: int, reach: float) -> RangeScanner:
    """Return a laser that sees all around."""
    sensor = RangeSensor(max_range=reach, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, beams, 2 * math.pi)


def corridor() -> Floats:
    """Return poses along the demo building's long corridor, (S, 3)."""
    x = np.arange(7.0, 30.0, STEP)
    return np.column_stack((x, 13.0 + 0.3 * np.sin(x), np.arctan(0.3 * np.cos(x))))


def localizer(
    env: Environment, scanner: RangeScanner, field: LikelihoodField, runs: int, particles: int,
    **values: str | float,
) -> MonteCarloLocalizer:  # fmt: skip
    """Return a localizer with a fixed number of particles."""
    parameters = MclParameters.from_dict(
        {"min_particles": particles, "max_particles": particles, **ODOMETRY, **values}
    )
    rng = np.random.default_rng(1)
    return MonteCarloLocalizer(env, scanner, parameters, runs=runs, rng=rng, field=field)


def rows_of_rates(
    env: Environment, field: LikelihoodField, repeats: int, runs: int
) -> list[tuple[str, ...]]:
    """Return updates per second of one run on one thread, and of `runs` runs on all threads."""
    route = corridor()
    cases = [(m, 1000, 60, "systematic") for m in LASER_MODELS]
    cases += [
        ("likelihood_field", 1000, 60, resampling)
        for resampling in RESAMPLING
        if resampling != "systematic"
    ]
    cases += [("likelihood_field", n, b, "systematic") for n, b in ((2000, 60), (5000, 180))]
    rows = []
    for model, particles, beams, resampling in cases:
        scanner = scanner_of(beams, 8.0)
        scans = scanner.read(env, *route.T, np.random.default_rng(2))
        values = {"laser_model_type": model, "resampling": resampling, "max_beams": beams}
        single = localizer(env, scanner, field, 1, particles, **values)
        many = localizer(env, scanner, field, runs, particles, **values)

        def drive(loc: MonteCarloLocalizer, scans: NDArray[np.float32] = scans) -> None:
            loc.start(route[0], START)
            for pose, scan in zip(route, scans, strict=True):
                loc.update(np.tile(pose, (loc.runs, 1)), np.tile(scan, (loc.runs, 1)))

        timings = interleave({"one": partial(drive, single), "many": partial(drive, many)}, repeats)
        rates = [
            spread([n * len(route) / t for t in timings[key].seconds], 0)
            for key, n in (("one", 1), ("many", runs))
        ]
        rows.append((model, resampling, str(particles), str(beams), *rates))
    return rows


def rows_of_errors(env: Environment, field: LikelihoodField, runs: int) -> list[tuple[str, ...]]:
    """Return errors on simulated drives through the corridor, and the bound by the scans."""
    route, rows = corridor(), []
    model = OdometryModel(**ODOMETRY)
    for reach in (30.0, 8.0, 4.0):
        scanner = scanner_of(60, reach)
        rng = np.random.default_rng(3)
        generator = states(rng, 1)[0]
        truth = np.tile(route[0], (runs, 1))
        odometry = np.tile(route[0], (runs, 1))
        names = [*LASER_MODELS, "ekf"]
        filters: list[MonteCarloLocalizer | ExtendedKalmanFilter] = [
            localizer(env, scanner, field, runs, 2000, laser_model_type=m) for m in LASER_MODELS
        ]
        filters.append(ExtendedKalmanFilter(env, scanner, model, runs=runs, map_std=0.0, gate=5.0))
        for loc in filters:
            loc.start(route[0], START)
        errors = np.empty((len(filters), len(route), runs, 3))
        for k in range(len(route)):
            if k > 0:
                # Odometry is the true motion along the route with errors added.
                odometry = model.sampled(odometry, route[k - 1], route[k], generator)
                truth = np.tile(route[k], (runs, 1))
            scans = scanner.read(env, *truth.T, rng)
            for loc, error in zip(filters, errors, strict=True):
                loc.update(odometry, scans)
                error[k] = loc.mean - truth
        ekf = filters[-1]
        assert isinstance(ekf, ExtendedKalmanFilter)
        bound = ekf.predicted_covariances(route, START)
        # The corridor runs along x; the median of |normal| is 0.674 deviations.
        deviation = 0.674 * np.sqrt(bound[:, (0, 1), (0, 1)]).mean(axis=0)
        forecast = [f"{value:.3f}" for value in deviation]
        for name, error in zip(names, errors, strict=True):
            off = np.abs(error[..., :2]).reshape(-1, 2)
            middle, most = np.percentile(off, (50, 95), axis=0)
            along_across = [f"{m:.3f} ({n:.3f})" for m, n in zip(middle, most, strict=True)]
            row = (along_across[0], forecast[0], along_across[1], forecast[1])
            rows.append((f"{reach:g} m", name, *row))
    return rows


def rows_of_drives(env: Environment, runs: int, repeats: int) -> list[tuple[str, ...]]:
    """Return the seconds of whole drives, and how they end."""
    scanner = scanner_of(60, 4.0)
    planner = RoutePlanner(build_map(env, scanner, store=False), footprint=0.3)
    route = planner.plan((3.0, 3.0), (42.2, 20.0), weight=0.0)
    noise = OdometryNoise()
    alphas = alphas_of(noise)
    rows = []
    for model in LASER_MODELS:
        parameters = MclParameters.from_dict({"laser_model_type": model, **alphas})

        def run(open_loop: bool, parameters: MclParameters = parameters) -> Drives:
            rng = np.random.default_rng(1)
            how = {"noise": noise, "open_loop": open_loop}
            return drive_route(env, scanner, Robot(0.105), route, parameters, rng, runs, **how)

        times = interleave({"open": partial(run, True), "closed": partial(run, False)}, repeats)
        closed = run(False)
        travelled = float(np.nanmax(closed.travelled(), axis=1).mean())
        rows.append(
            (
                model,
                f"{route.length:.1f} m",
                spread(times["open"].seconds),
                spread(times["closed"].seconds),
                f"{travelled:.1f} m, {int(closed.collided.sum())} of {runs} collided",
            )
        )
    return rows


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--environment", default="demo")
    add_out(parser)
    args = parser.parse_args()
    env = load_environment(environment_path(args.environment))
    LikelihoodField.of(env, 0.1)
    begin = time.perf_counter()
    field = LikelihoodField.of(env)
    took = time.perf_counter() - begin
    rows, columns = field.distance.shape
    threads = numba.get_num_threads()
    rates = table(
        ("model", "resampling", "particles", "beams", "updates a second, one run on one thread",
         f"{args.runs} runs on {threads} threads"),
        rows_of_rates(env, field, args.repeats, args.runs),
        words=2,
    )  # fmt: skip
    errors = table(
        (
            "range",
            "localizer",
            "along m: median (95 %)",
            "forecast",
            "across m: median (95 %)",
            "forecast",
        ),
        rows_of_errors(env, field, args.runs),
        words=2,
    )
    runs = args.runs
    drives = table(
        ("localizer", "route", "open loop, s", "closed loop, s", "closed loop: distance driven"),
        rows_of_drives(env, runs, args.repeats),
    )
    body = "\n\n".join(
        [
            f"Wanted: {WANTED} updates a second at 1000 particles and 60 beams on one core. The "
            f"likelihood field ({columns} x {rows} points, 2.5 cm) took {took:.2f} s on {threads} "
            "threads.",
            rates,
            f"## Errors in the corridor\n\n{args.runs} drives with odometry errors (alpha1 to "
            "alpha4 0.02) and readings of their own, 2000 particles, AMCL's other defaults. The "
            "forecast is the median error that the extended Kalman filter expects before the "
            "drive; AMCL's sigma_hit of 0.2 m gives away most of what a laser of 3 cm knows.",
            errors,
            f"## Whole drives\n\n{runs} seeds of a drive from the lobby to the store, a laser of "
            f"4 m, AMCL's defaults but for the alphas; seconds for all {runs} together on "
            f"{threads} threads. Wanted: 60 s for 30 drives of 50 m on 2 cores.",
            drives,
        ]
    )
    report("The localizer", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
