"""Updates per second of Monte Carlo localization, and its error against the bound.

One thread, one run: a drive along the demo building's corridor with an update every 0.3 m. Then
many runs at once on all threads. An update is the motion of all particles, the likelihood of one
scan, resampling and the estimate.
"""

from __future__ import annotations

import time
from functools import partial

import numba
import numpy as np
from harness import arguments, environment_of, interleave, report, spread, table
from lasers import laser
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import LASER_MODELS, RESAMPLING, MclParameters
from ambinav.sensing.scanner import RangeScanner

LIBRARIES = ("ambinav", "numba", "numpy")
# Required updates per second on one core with 1 000 particles and 60 beams.
WANTED = 100
STEP = 0.3
ODOMETRY = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4"), 0.02)
START = np.diag([0.05**2, 0.05**2, 0.03**2])
Floats = NDArray[np.float64]


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
        scanner = laser(8.0, beams=beams)
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


def main() -> None:
    """Measure and report."""
    args = arguments(__doc__, repeats=3, runs=30, environment="demo")
    env = environment_of(args.environment)
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
    body = "\n\n".join(
        [
            f"Wanted: {WANTED} updates a second at 1000 particles and 60 beams on one core. The "
            f"likelihood field ({columns} x {rows} points, 2.5 cm) took {took:.2f} s on {threads} "
            "threads.",
            rates,
        ]
    )
    report("The localizer", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
