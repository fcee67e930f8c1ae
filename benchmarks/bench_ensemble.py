"""Ensembles of a localizer along a route, beside ordinary drives of the same route.

Routes in Willow Garage and in an empty hall that is wider than the laser reaches, where about half
of the robots get lost; a laser of 4 m with 60 beams, the default odometry, 10 time steps a second.
`drive_route(..., open_loop=True)` is the peer. Time is that of the process over all its threads, so
that a busy machine changes it little, and wall-clock time beside it. Both make what the localizer
needs of the building beforehand: an ensemble in its runner, a drive in the localizer that it is
given.

Then what a sequential ensemble needs to say whether more robots than a threshold get lost.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable

import numba
import numpy as np
import shapely
from harness import arguments, environment_path, interleave, report, spread, table
from lasers import laser
from localizers import ROBOT, parameters_of
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ambinav.buildings.load import load_environment
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.localizer_spec import chosen_localizer
from ambinav.drive.localizers import Localizer
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.shares import Evidence, newcombe
from ambinav.forecasting.ensemble import BATCH, Ensemble, EnsembleRunner
from ambinav.forecasting.stopping import StoppingRule, confidence_sequence
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments, edges_of
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.routes.route import Route

LIBRARIES = ("ambinav", "numba", "numpy")
NAMES = ("product", "amcl", "rays", "kalman")
STEP, MARGIN = 0.25, 0.3
SEQUENCES, MOST = 400, 2000
NOISE = OdometryNoise()
Floats = NDArray[np.float64]


def main() -> None:
    """Time, compare, and report."""
    args = arguments(
        __doc__, lengths=[12.5, 25.0, 50.0], names=list(NAMES), runs=32, repeats=3, compared=320
    )
    willow = load_environment(environment_path("willow_full_005"))
    times, agreement = [], []
    for name in args.names:
        for length in args.lengths:
            route = shortest(willow, length)
            times.append(timed_row(willow, route, name, length, args.runs, args.repeats))
    for name in args.names:
        for label, building, route in (
            ("Willow Garage, 25 m", willow, shortest(willow, 25.0)),
            ("hall, 10.5 m", hall(), Route.through([[1.5, 6.0], [12.0, 6.0]])),
        ):
            agreement.append(compared_row(building, route, name, label, args.compared))
    report(
        "Ensembles",
        LIBRARIES,
        "\n\n".join(
            [
                f"{args.runs} runs, {numba.get_num_threads()} threads; medians, with the extremes.",
                table(
                    (
                        "localizer", "route, m", "drives, CPU ms", "ensemble, CPU ms",
                        "times as fast, CPU", "drives, ms", "ensemble, ms", "prepared in, ms",
                    ),
                    times,
                ),
                f"The same in distribution? {args.compared} runs each; rms error of the position: "
                "geometric mean over the runs.",
                table(
                    (
                        "localizer", "route", "lost, drives", "lost, ensemble",
                        "difference, 95 %", "rms error, drives, m", "rms error, ensemble, m",
                        "ratio, 95 %",
                    ),
                    agreement,
                    words=2,
                ),
                f"Runs until the interval lies on one side of a threshold: median, and 90th "
                f"percentile, of {SEQUENCES} sequences of {MOST} runs at most, looked at every "
                f"{BATCH} runs.",
                table(
                    ("truly lost", "threshold", "runs, median", "runs, 90 %", "undecided, %",
                     "wrong, %"),
                    stopping_rows(),
                ),
            ]
        ),
        args.out,
    )  # fmt: skip


def hall() -> Environment:
    """Return a hall in whose middle a laser of 4 m sees nothing."""
    free = shapely.box(0.0, 0.0, 13.5, 12.0)
    edges = edges_of(free)
    return Environment(Segments(edges, np.zeros(len(edges), dtype=np.uint8)), free, name="hall")


def shortest(building: Environment, length: float, seed: int = 1) -> Route:
    """Return a shortest path of about a length between places of a lattice, some metres apart."""
    xmin, ymin, xmax, ymax = building.bounds
    x, y = np.meshgrid(np.arange(xmin, xmax, STEP), np.arange(ymin, ymax, STEP))
    free = building.is_free(x, y, MARGIN)
    number = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
    starts, ends, weights = [], [], []
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = number, np.full_like(number, -1)
        kept = number[rows:, max(columns, 0) : number.shape[1] + min(columns, 0)]
        first = max(-columns, 0)
        there[: number.shape[0] - rows, first : first + kept.shape[1]] = kept
        both = (here >= 0) & (there >= 0)
        starts.append(here[both])
        ends.append(there[both])
        weights.append(np.full(int(both.sum()), STEP * math.hypot(rows, columns)))
    places = np.column_stack([x[free], y[free]])
    graph = coo_array(
        (np.concatenate(weights), (np.concatenate(starts), np.concatenate(ends))),
        shape=(len(places), len(places)),
    )
    rng = np.random.default_rng(seed)
    while True:
        start = int(rng.integers(len(places)))
        far, before = dijkstra(graph, False, start, return_predecessors=True)
        reached = np.flatnonzero(np.isfinite(far) & (np.abs(far - length) < STEP))
        if len(reached):
            path = [int(reached[0])]
            while path[-1] != start:
                path.append(int(before[path[-1]]))
            points = places[path[::-1]]
            turns = np.abs(np.diff(points, n=2, axis=0)).sum(axis=1) > 1e-9
            return Route.through(points[np.concatenate([[True], turns, [True]])])


def chosen(name: str) -> MclParameters | str:
    """Return a localizer as an ensemble takes it."""
    return "ekf" if name == "kalman" else parameters_of(name, laser(), NOISE)


def made(name: str, building: Environment, runs: int) -> Localizer:
    """Return the same as drives take it, made beforehand."""
    scanner = laser()
    if name != "kalman":
        parameters = parameters_of(name, scanner, NOISE)
        rng = np.random.default_rng(1)
        return MonteCarloLocalizer(building, scanner, parameters, runs=runs, rng=rng)
    odometry = chosen_localizer("ekf", NOISE, ROBOT, 10.0).parameters.odometry
    return ExtendedKalmanFilter(building, scanner, odometry, runs=runs)


def driven(building: Environment, route: Route, localizer: Localizer, runs: int) -> Drives:
    """Return ordinary drives."""
    return drive_route(
        building, laser(), ROBOT, route, localizer, np.random.default_rng(2), runs,
        noise=NOISE, open_loop=True,
    )  # fmt: skip


def timed_row(
    building: Environment, route: Route, name: str, length: float, runs: int, repeats: int
) -> tuple[object, ...]:
    """Return the row of a localizer and a route."""
    started = time.perf_counter()
    runner = EnsembleRunner(building, laser(), chosen(name), robot=ROBOT, noise=NOISE)
    prepared = time.perf_counter() - started
    localizer = made(name, building, runs)
    walls = defaultdict(list)

    def walled(kind: str, run: Callable[[], Drives | Ensemble]) -> Callable[[], None]:
        def clocked() -> None:
            start = time.perf_counter()
            run()
            walls[kind].append(1e3 * (time.perf_counter() - start))

        return clocked

    timings = interleave(
        {
            "drives": walled("drives", lambda: driven(building, route, localizer, runs)),
            "ensemble": walled(
                "ensemble", lambda: runner.drive(route, np.random.default_rng(3), runs)
            ),
        },
        repeats,
        clock=time.process_time,
    )
    ours, theirs = timings["ensemble"], timings["drives"]
    cpu = [spread([1e3 * s for s in timing.seconds], 0) for timing in (theirs, ours)]
    wall = [spread(walls[kind][1:], 0) for kind in ("drives", "ensemble")]
    return name, f"{length:g}", *cpu, ours.ratio(theirs), *wall, f"{1e3 * prepared:.0f}"


def compared_row(
    building: Environment, route: Route, name: str, label: str, runs: int
) -> tuple[object, ...]:
    """Return the row of lost shares and errors."""
    runner = EnsembleRunner(building, laser(), chosen(name), robot=ROBOT, noise=NOISE)
    ours = runner.drive(route, np.random.default_rng(3), runs)
    theirs = driven(building, route, made(name, building, runs), runs)
    lost = ours.lost.mean(), metrics(theirs).lost.mean()
    low, high = newcombe(*lost, Evidence(runs, 1.96), Evidence(runs, 1.96))
    logs = [
        0.5 * np.log(np.square(error[..., :2]).sum(axis=-1).mean(axis=1))
        for error in (ours.error.astype(np.float64), theirs.errors())
    ]
    apart = logs[0].mean() - logs[1].mean()
    half = 1.96 * math.sqrt((logs[0].var() + logs[1].var()) / runs)
    ratio = [f"{math.exp(value):.3f}" for value in (apart, apart - half, apart + half)]
    return (
        name, label, f"{lost[1]:.3f}", f"{lost[0]:.3f}",
        f"{lost[0] - lost[1]:+.3f} ({low:+.3f} to {high:+.3f})",
        *(f"{math.exp(log.mean()):.3f}" for log in logs[::-1]),
        f"{ratio[0]} ({ratio[1]} to {ratio[2]})",
    )  # fmt: skip


def stopping_rows() -> list[tuple[str, ...]]:
    """Return how many runs sequences of robots need, by the share that truly gets lost."""
    rows = []
    for truth, threshold in (
        (0.0, 0.05), (0.01, 0.05), (0.02, 0.05), (0.1, 0.05), (0.2, 0.05), (0.5, 0.05),
        (0.0, 0.02), (0.1, 0.02),
    ):  # fmt: skip
        rng, rule = np.random.default_rng(5), StoppingRule(threshold=threshold)
        needed, wrong, undecided = [], 0, 0
        for _ in range(SEQUENCES):
            events = np.cumsum(rng.random(MOST) < truth)
            for count in range(BATCH, MOST + 1, BATCH):
                interval = confidence_sequence(int(events[count - 1]), count)
                if rule.met(interval):
                    wrong += (interval.high < threshold) != (truth < threshold)
                    break
            else:
                undecided += 1
            needed.append(count)
        rows.append(
            (
                f"{100 * truth:g} %", f"{100 * threshold:g} %", f"{np.median(needed):.0f}",
                f"{np.quantile(needed, 0.9):.0f}", f"{100 * undecided / SEQUENCES:.1f}",
                f"{100 * wrong / SEQUENCES:.1f}",
            )
        )  # fmt: skip
    return rows


if __name__ == "__main__":
    main()
