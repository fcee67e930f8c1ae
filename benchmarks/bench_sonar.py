"""A ring of sonars evaluated again: the map, its cones, and the localizers' results.

The preset `polaroid-6500-ring` (16 cones of 30 degrees, 10.67 m, echoes up to 25 degrees off a
wall's normal, 5 % random readings) on a robot of 0.21 m radius, in the drawn demo and in recorded
maps.

- Pairs of places are drawn by a seed and chosen on the map alone: those where the ambiguity-aware
  route saves most metres in corridor and open zones. Routes by the planner `reference`: the
  shortest, and the one with the least such metres among the weights 2, 5 and 20 that is at most
  10 % longer.
- Drives: 30 paired seeds, odometry of 4.5 degrees and 6 cm in a metre, or twice as bad, of which
  every localizer knows; open loop (the robot keeps to its route, whatever it believes) and
  closed loop. A robot is lost whose error is above 0.5 m or 30 degrees for over a second.
- Localizers: AMCL's own default; its product of the field, tuned as elsewhere in these benchmarks;
  its sum of cubes with its own weights, and with those that suit cones; the product of the ray
  model's beams, the library's default for cones (`MclParameters.for_scanner`); and the Kalman
  filter. That one takes in every scan (5 a second), the others one every 0.25 m or 0.2 rad; all are
  given the variances of the odometry from one scan that they take in to the next.
- One by one, open loop and in the same building, on the same routes: the cones replaced by single
  rays at their axes, with and without the limit of incidence; four times as many of them; three
  times as many cones; and the product's own settings changed one at a time.
- Intervals of 95 % are about other seeds on these routes, not about other pairs or buildings: of
  shares Wilson's over all runs of a row, of errors by the bootstrap over them.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from harness import appended, arguments, environment_of, kept_rows, option, report, table
from numpy.typing import NDArray
from plan_case import pairs

from ambinav.drive.bootstrap import bootstrap, share
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.localizers import Localizer
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION, metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import ZONES
from ambinav.routes.evaluate import zone_codes
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner

PRESET = "polaroid-6500-ring"
ENVIRONMENTS = ("demo", "stata_hallways_5cm", "aces")
ROBOT = Robot(radius=0.21)
"""The ring, of 0.2 m radius, stands within it."""
CLEARANCE = 0.15
WEIGHTS = (2.0, 5.0, 20.0)
LONGEST = 1.1
ROUTES = ("shortest", "aware")
RATE = 5.0
NOISE = OdometryNoise()
ROUGH = OdometryNoise(scale=0.5)
"""Odometry twice as bad."""
TUNED_FIELD = {"importance_factor": 0.3, "sigma_hit": 0.1}

# What localizes in the main table: parameters in addition to what suits the ring.
LOCALIZERS: dict[str, dict[str, Any] | None] = {
    "AMCL's own default (`likelihood_field`)": {"laser_model_type": "likelihood_field"},
    "its product (`likelihood_field_prob`, power 0.3)": {
        "laser_model_type": "likelihood_field_prob", **TUNED_FIELD,
    },
    "AMCL's sum of cubes (`beam`)": {
        "laser_model_type": "beam", "z_hit": 0.5, "z_max": 0.05, "z_rand": 0.5,
    },
    "sum of cubes (`beam`)": {"laser_model_type": "beam"},
    "product (`beam_prob`, power 0.3)": {},
    "Kalman filter, every scan": None,
}  # fmt: skip
PRODUCT = "product (`beam_prob`, power 0.3)"
EKF = "Kalman filter, every scan"
FIELD_PRODUCT = "its product (`likelihood_field_prob`, power 0.3)"
# The product's settings, one changed at a time.
SETTINGS: dict[str, dict[str, Any]] = {
    "power 0.1": {"importance_factor": 0.1},
    "power 1": {"importance_factor": 1.0},
    "sigma_hit 0.05 m": {"sigma_hit": 0.05},
}
RING = "the ring"
Floats = NDArray[np.float64]


def main() -> None:
    """Run the missing drives, then report."""
    args = arguments(
        __doc__,
        folder=option(Path("out/sonar"), "keeps what has been driven"),
        jobs=2,
        pairs=option(2, "of each building"),
        drawn=option(16, "pairs to choose from"),
        runs=30,
        seed=41,
        environments=ENVIRONMENTS,
        report_only=option(False, "report what has been driven, drive nothing"),
        summary=option(
            Path(__file__).with_name("sonar_summary.md"),
            "Markdown, written by hand, that stands at the end of the report",
        ),
    )
    summary = args.summary.read_text(encoding="utf-8")
    with ProcessPoolExecutor(args.jobs) as pool:
        todo = [pool.submit(driven, name, args) for name in args.environments]
        rows = [row for job in todo for row in job.result()]
    report(
        "The sonar ring, one thing at a time",
        ["numpy", "numba"],
        f"{body(rows)}\n\n{summary}",
        args.out,
    )


def driven(name: str, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Return all drives of a building, new or stored; one line of a file for each group."""
    numba.set_num_threads(1)
    path = args.folder / f"{name}_{args.pairs}_{args.drawn}_{args.runs}_{args.seed}.jsonl"
    by_key = {row["key"]: row for row in kept_rows(path)}
    if args.report_only:
        # Localizers changed since then have other labels.
        return [row for row in by_key.values() if row["label"] in {*LOCALIZERS, *SETTINGS}]
    environment = environment_of(name)
    scanner = RangeScanner.from_preset(PRESET)
    amap = build_map(environment, scanner, store=False)
    chosen = list(routes(amap, args))
    rows = []
    with appended(path) as append:
        for study, scanners, label, guide, open_loop in groups(scanner):
            for number, pair in chosen:
                for which, route in pair.items():
                    key = json.dumps([study, scanners.name, label, open_loop, number, which])
                    if key not in by_key:
                        row = {
                            "key": key, "study": study, "scanner": scanners.name, "label": label,
                            "open_loop": open_loop, "environment": name, "pair": number,
                            "route": which, **figures(route),
                        }  # fmt: skip
                        rng = np.random.default_rng([args.seed, number])
                        noise = ROUGH if study == "rough odometry" else NOISE
                        runs = drives_of(
                            environment, scanners, route, guide, rng, args.runs, noise, open_loop
                        )
                        by_key[key] = row | measured(runs, amap)
                        append(by_key[key])
                    rows.append(by_key[key])
    return rows


def groups(
    ring: RangeScanner,
) -> Iterator[tuple[str, RangeScanner, str, dict[str, Any] | None, bool]]:
    """Return study, scanner, localizer's name and parameters, and whether the loop is open."""
    for open_loop in (True, False):
        for label, parameters in LOCALIZERS.items():
            yield "localizers", replace(ring, name=RING), label, parameters, open_loop
    for label, parameters in LOCALIZERS.items():
        yield "rough odometry", replace(ring, name=RING), label, parameters, True
    for scanner in scanners(ring):
        for label in (PRODUCT, FIELD_PRODUCT, EKF):
            yield "cones", scanner, label, LOCALIZERS[label], True
    for label, parameters in SETTINGS.items():
        yield "settings", replace(ring, name=RING), label, parameters, True


def scanners(ring: RangeScanner) -> Iterator[RangeScanner]:
    """Return the ring with one property changed at a time."""
    (sensor,) = ring.sensors
    radius, count = float(np.hypot(*ring.mounts[0, :2])), ring.beams
    ray = replace(sensor, aperture=0.0)
    bare = replace(ray, max_incidence=None)
    for name, sensor_used, number in (
        ("48 cones", sensor, 3 * count),
        ("16 single rays, echoes up to 25 degrees", ray, count),
        ("16 single rays, echoes at any incidence", bare, count),
        ("64 single rays, echoes at any incidence", bare, 4 * count),
    ):
        yield RangeScanner.ring(sensor_used, number, radius, name=name)


def routes(amap: AmbiguityMap, args: argparse.Namespace) -> Iterator[tuple[int, dict[str, Route]]]:
    """Return the pairs with most corridor and open metres to save, and their routes."""
    robot = RoutePlanner(AmbiguityService(amap), footprint=ROBOT.radius + CLEARANCE)
    candidates = []
    for number, (start, goal) in enumerate(pairs(robot, args.drawn, args.seed)):
        planned = [
            robot.plan(start, goal, planner_name="reference", weight=weight)
            for weight in (0.0, *WEIGHTS)
        ]
        allowed = [route for route in planned if route.length <= LONGEST * planned[0].length]
        aware = min(allowed, key=lambda r: (round(r.bad_metres, 1), r.exposure, r.length))
        saved = planned[0].bad_metres - aware.bad_metres
        candidates.append(
            (-saved, -planned[0].exposure, number, {"shortest": planned[0], "aware": aware})
        )
    for _, _, number, pair in sorted(candidates, key=lambda item: item[:3])[: args.pairs]:
        yield number, pair


def figures(route: Route) -> dict[str, Any]:
    """Return the stored figures of a route."""
    return {
        "length": route.length,
        "corridor": route.zone_metres["corridor"],
        "open": route.zone_metres["open"],
        "longest_bad": route.longest_bad,
    }


def drives_of(
    environment: Environment,
    scanner: RangeScanner,
    route: Route,
    parameters: dict[str, Any] | None,
    rng: np.random.Generator,
    runs: int,
    noise: OdometryNoise,
    open_loop: bool,
) -> Drives:
    """Drive a route with a localizer of these parameters; None: the Kalman filter."""
    guide: Localizer | MclParameters
    if parameters is None:
        model = noise.modelled_every(ROBOT.max_speed / RATE, ROBOT.max_turn_rate / RATE)
        guide = ExtendedKalmanFilter(environment, scanner, model, runs=runs)
    else:
        alphas = {key: getattr(noise.modelled, key) for key in ALPHAS if key != "alpha5"}
        # The ring's settings stay where it has single rays: one thing is changed at a time.
        ring = RangeScanner.from_preset(PRESET)
        guide = MclParameters.for_scanner(ring, **alphas, **parameters)
    with warnings_off():
        return drive_route(
            environment, scanner, ROBOT, route, guide, rng, runs, noise=noise,
            open_loop=open_loop, rate=RATE,
        )  # fmt: skip


def measured(drives: Drives, amap: AmbiguityMap) -> dict[str, Any]:
    """Return the stored figures of a route's drives, and the zones where robots got lost."""
    measured = metrics(drives, amap)
    error = drives.errors()
    far = (np.hypot(error[..., 0], error[..., 1]) > LOST_POSITION) | (
        np.abs(error[..., 2]) > LOST_HEADING
    )
    first = far.argmax(axis=1)[measured.lost]
    at = drives.truth[measured.lost, first]
    zones = zone_codes(amap, at) if len(at) else np.zeros(0, dtype=np.int64)
    return {
        "lost": measured.lost.tolist(),
        "error": np.round(measured.position_p95, 4).tolist(),
        "collided": measured.collided.tolist(),
        "arrived": measured.arrived.tolist(),
        "nees": np.round(measured.nees, 3).tolist(),
        "lost_in": [ZONES[code] for code in zones],
        "lost_at": np.round(at[:, :2], 2).tolist(),
        "found_again": (measured.lost & ~far[np.arange(len(far)), drives.samples - 1]).tolist(),
    }


@contextmanager
def warnings_off() -> Iterator[None]:
    """Suppress the warnings about fields with cones, which are driven on purpose here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        yield


def body(all_rows: list[dict[str, Any]]) -> str:
    """Return the tables of the report."""
    parts = [str(__doc__).split("\n\n", 1)[1].strip()]
    main_rows = [row for row in all_rows if row["study"] == "localizers"]
    parts += ["## Routes", table(
        ("building", "pair", "route", "length, m", "corridor, m", "open, m", "longest of both, m"),
        unique(route_line(row) for row in main_rows), 3,
    )]  # fmt: skip
    for open_loop, title in ((True, "open loop"), (False, "closed loop")):
        rows = [row for row in main_rows if row["open_loop"] == open_loop]
        parts += [f"## Localizers, {title}", results(rows, "label", ("localizer",), not open_loop)]
        parts += ["Lost, % of the runs on both routes, by building:", by_building(rows)]
    rough = [row for row in all_rows if row["study"] == "rough odometry"]
    if rough:
        parts += ["## Localizers, open loop, odometry twice as bad"]
        parts += [results(rough, "label", ("localizer",)), by_building(rough)]
    cones = [row for row in all_rows if row["study"] == "cones"]
    ring = [row for row in main_rows if row["open_loop"]]
    parts.append("## The cones, one thing at a time, open loop")
    for label in (PRODUCT, FIELD_PRODUCT, EKF):
        rows = common([row for row in (*ring, *cones) if row["label"] == label], "scanner")
        parts += [f"### {label}", results(rows, "scanner", ("scanner",))]
    settings = [row for row in ring if row["label"] == PRODUCT]
    settings += [row for row in all_rows if row["study"] == "settings" and row["label"] in SETTINGS]
    parts += ["## The product's settings, one at a time, open loop"]
    parts += [results(common(settings, "label"), "label", ("settings",))]
    parts += ["## Where robots got lost, open loop", lost_in(ring)]
    parts += ["## In words, runs on both routes", in_words([*main_rows, *rough])]
    return "\n\n".join(parts)


def unique(rows: Iterable[tuple[object, ...]]) -> list[tuple[object, ...]]:
    """Return each row once, in the order of first occurrence."""
    return list(dict.fromkeys(rows))


def route_line(row: dict[str, Any]) -> tuple[object, ...]:
    """Return a route's line in the table of routes."""
    metres = (f"{row[key]:.1f}" for key in ("length", "corridor", "open", "longest_bad"))
    return (row["environment"], row["pair"], row["route"], *metres)


def results(
    rows: list[dict[str, Any]], key: str, words: tuple[str, ...], closed: bool = False
) -> str:
    """Return lost runs and errors on both routes, one line for each value of `key`."""
    header = [*words, "runs"]
    for route in ROUTES:
        header += [f"lost, {route}, %", f"95 % error, {route}, m", f"median run, {route}, m"]
        header += [f"collided, {route}, %"] if closed else [f"NEES, median, {route}"]
    lines = []
    for (value,) in unique((row[key],) for row in rows):
        cells: list[object] = [value, len(joined([r for r in rows if r[key] == value], "lost"))]
        for route in ROUTES:
            case_rows = [row for row in rows if row[key] == value and row["route"] == route]
            if not case_rows:
                cells += ["not driven yet"] * 4
                continue
            rng = np.random.default_rng(0)
            lost = share(joined(case_rows, "lost")).scaled(100.0)
            error = bootstrap(joined(case_rows, "error"), rng)
            cells += [
                f"{lost.value:.0f} ({lost.low:.0f} to {lost.high:.0f})",
                f"{error.value:.2f} ({error.low:.2f} to {error.high:.2f})",
                f"{np.median(joined(case_rows, 'error')):.2f}",
            ]
            if closed:
                cells.append(f"{100.0 * joined(case_rows, 'collided').mean():.0f}")
            else:
                cells.append(f"{np.nanmedian(joined(case_rows, 'nees')):.1f}")
        lines.append(cells)
    return table(header, lines, len(words))


def common(rows: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """Return the rows of the routes that have been driven with each value of `key`."""

    def case(row: dict[str, Any]) -> tuple[object, ...]:
        return row["environment"], row["pair"], row["route"]

    values = {row[key] for row in rows}
    if not values:
        return []
    shared = set.intersection(*({case(r) for r in rows if r[key] == v} for v in values))
    return [row for row in rows if case(row) in shared]


def by_building(rows: list[dict[str, Any]]) -> str:
    """Return the share of lost runs for each localizer and building."""
    buildings = [value for (value,) in unique((row["environment"],) for row in rows)]
    lines = []
    for (label,) in unique((row["label"],) for row in rows):
        cells = [label]
        for building in buildings:
            case_rows = [r for r in rows if r["label"] == label and r["environment"] == building]
            lost = 100.0 * joined(case_rows, "lost")
            cells.append(f"{lost.mean():.0f}" if len(lost) else "not driven yet")
        lines.append(cells)
    return table(("localizer", *buildings), lines)


def in_words(rows: list[dict[str, Any]]) -> str:
    """Return the lost runs of each localizer in sentences with their conditions."""
    sentences = []
    keys = ("study", "open_loop", "label")
    for case in unique(tuple(row[key] for key in keys) for row in rows):
        case_rows = [row for row in rows if tuple(row[key] for key in keys) == case]
        study, open_loop, label = case
        lost = share(joined(case_rows, "lost")).scaled(100.0)
        buildings = ", ".join(dict.fromkeys(row["environment"] for row in case_rows))
        noise = ROUGH if study == "rough odometry" else NOISE
        sentences.append(
            f"- {label}, {'open' if open_loop else 'closed'} loop, odometry of "
            f"{18 * noise.scale:g} degrees and {24 * noise.scale:g} cm in a metre, {buildings}: "
            f"{lost.value:.1f} % ({lost.low:.1f} to {lost.high:.1f}) of {lost.count} runs lost, "
            f"median of the 95 % error {np.median(joined(case_rows, 'error')):.2f} m."
        )
    return "\n".join(sentences)


def lost_in(rows: list[dict[str, Any]]) -> str:
    """Return lost runs by the zone in which the error first was too large."""
    lines = []
    for (label,) in unique((row["label"],) for row in rows):
        case_rows = [row for row in rows if row["label"] == label]
        zones = [zone for row in case_rows for zone in row["lost_in"]]
        found_again = int(joined(case_rows, "found_again").sum())
        lines.append((label, len(zones), *(zones.count(zone) for zone in ZONES), found_again))
    header = ("localizer", "runs lost", *(f"in {zone}" for zone in ZONES), "right again at the end")
    return table(header, lines)


def joined(rows: list[dict[str, Any]], key: str) -> Floats:
    """Return a figure of all runs of some rows, shape (runs,)."""
    parts = [np.asarray(row[key], dtype=np.float64) for row in rows]
    return np.concatenate([np.zeros(0), *parts])


if __name__ == "__main__":
    main()
