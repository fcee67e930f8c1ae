"""How well is it forecast whether a robot gets lost on a route, in buildings left out?

`lost-routes`: robots with four odometries and several scanners drive sampled shortest routes, 32
times each, in all recorded maps, three plans and 42 drawn buildings (`lost_case.py`). This fits a
class of localizers to the drives, five times without a fifth of the buildings, and scores the
forecasts of routes in buildings left out.

- Brier's skill against the base rate, with an interval of 95 % over buildings, and the ceiling that
  chance from run to run leaves.
- An ensemble: on each route the share of one half of the robots, as a forecast for the other half.
- The rivals get the same fit of log odds, left out in the same way: the longest stretch above level
  0.65, alone and times the odometry's variances; the length of the route times these.
- Reliability: routes sorted by their forecast, the mean of forecasts and of drives in each part.
- Coverage: how often the position of a robot that is not lost lies within the ellipse of 68 and
  95 % of its forecast.

Another forecast is scored beside them, without a fit, with `--forecast module:function`: it takes a
map (`ambinav.AmbiguityMap`), poses along the route, (n, 3), and the odometry's errors
(`ambinav.OdometryNoise`), and returns the probability that a robot gets lost (docs/lost-routes.md).

A new class: `python benchmarks/bench_lost.py --localizer NAME --fit FILE` writes its file.
"""

from __future__ import annotations

import argparse
import importlib
import math
import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from harness import commit, option, parser_of, report, run_script, table
from localizers import LOCALIZERS, REGISTERED
from lost_case import LOOPS, ODOMETRIES, SCANNERS, START_STD, WORLDS, building, building_names
from numpy.typing import NDArray
from truth_case import scanner_of

from ambinav.drive.bootstrap import Interval
from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.calibrate import (
    Calibration,
    DrivenRoute,
    brier_skill,
    calibrate,
    skill_ceiling,
    skill_interval,
)
from ambinav.forecasting.filter_kernel import forecast_rows
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.localizer_class import ECHO_GAINS, LocalizerClass
from ambinav.forecasting.reliability import reliability_of
from ambinav.localization.parameters import MclParameters
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap

Floats = NDArray[np.float64]
Predictor = Callable[[AmbiguityMap, Floats, OdometryNoise], float]

TITLES = {
    "product": "Monte Carlo localization that multiplies the beams",
    "rays": "Monte Carlo localization with the ray model",
    "sum": "Monte Carlo localization that adds the beams",
    "amcl": "Monte Carlo localization with AMCL's defaults",
    "kalman": "a Kalman filter on the ranges of every scan",
}
"""Names of the classes of localizers in reports."""
BAD = 0.65
"""Level above which a stretch is bad."""
LARGE = 4000.0
"""From this many square metres on a map has cells of 0.2 m."""
LARGEST = 15_000.0
"""Larger buildings are left out, for the time that their maps take."""
SEED = 2
CHI_68, CHI_95 = -2.0 * math.log(0.32), -2.0 * math.log(0.05)


@dataclass(frozen=True, eq=False)
class Case:
    """A driven route with what rivals and coverage need.

    Attributes:
        driven: The route and its outcome.
        scanner: Name of the scanner.
        odometry: Name of the odometry.
        error: Of each run at the poses, shape (R, n, 3).
        lost_at: Metres at which each run was lost, nan if never, shape (R,).
        distance: Metres up to each pose, shape (n,).
        stretch: Longest stretch above `BAD`, metres.
        other: What `--forecast` says; nan without.
    """

    driven: DrivenRoute
    scanner: str
    odometry: str
    error: NDArray[np.float32]
    lost_at: Floats
    distance: Floats
    stretch: float
    other: float


def main() -> None:
    """Drive what is missing, fit, score, and print the report."""
    parser = parser_of(
        __doc__,
        localizer=option("product", "the localizer", choices=LOCALIZERS),
        scanners=option(SCANNERS[:4], "scanners to fit and score together"),
        buildings=option((), "names of buildings; all by default"),
        world=option("map", choices=WORLDS),
        loop=option("open", choices=LOOPS),
        folder=option(Path("out/lost"), "where the drives are kept", type=Path),
        fit=option(None, "write the fitted class to this file", type=Path),
        kept=option(False, "drive nothing"),
        score=option(None, "score a class as it is, by name or file; fit nothing"),
        forecast=option(None, "score another forecast too", metavar="MODULE:FUNCTION"),
    )
    args = parser.parse_args()
    predictor = None if args.forecast is None else function_of(args.forecast)
    names = list(args.buildings) or building_names()
    if not args.kept:
        with ThreadPoolExecutor(2) as pool:
            words = ["--localizers", args.localizer, "--world", args.world, "--loop", args.loop]
            words += ["--folder", str(args.folder), "--scanners", *args.scanners]
            list(pool.map(lambda name: run_script("lost_case.py", name, *words), names))
    begin = to_fit(args.localizer) if args.score is None else LocalizerClass.load(args.score)
    cases = [case for name in names for case in cases_of(args, name, begin, predictor)]
    rng = np.random.default_rng(SEED)
    routes = [case.driven for case in cases]
    if args.score is None:
        fitted = calibrate(begin, routes, rng, start_std=START_STD)
    else:
        fitted = as_it_is(begin, routes, rng)
    if args.fit is not None:
        write_class(args.fit, fitted, cases)
    parts = [summary(fitted, cases, rng), reliability(fitted.left_out, cases)]
    if args.loop == "open":
        parts.append(coverage(fitted.localizer, cases))
    report(
        f"Lost on a route, forecast: {args.localizer}",
        ("numpy", "numba", "scipy"),
        "\n\n".join(parts),
        args.out,
    )


def to_fit(name: str) -> LocalizerClass:
    """Return a class before its fit."""
    driven: dict[str, Any] = REGISTERED[name]
    begin = LocalizerClass(name=name, title=TITLES[name], gain=0.25, **driven)
    parameters = begin.chosen(scanner_of("laser-4m"), OdometryNoise()).parameters
    if not isinstance(parameters, MclParameters):
        return begin
    return replace(begin, echo_gain=ECHO_GAINS.get(parameters.laser_model_type))


def function_of(place: str) -> Predictor:
    """Return the function that "module:function" names; modules are looked for here first."""
    module, _, name = place.partition(":")
    if not name:
        raise SystemExit(f"--forecast: {place!r} names no function; give module:function.")
    sys.path.insert(0, "")
    function: Predictor = getattr(importlib.import_module(module), name)
    return function


def cases_of(
    args: argparse.Namespace, name: str, begin: LocalizerClass, predictor: Predictor | None
) -> list[Case]:
    """Return the driven routes of a building; none where it is too large."""
    folder: Path = args.folder / name
    ending = f"{args.localizer}_{args.world}_{args.loop}.npz"
    environment, cases = None, []
    for scanner in args.scanners:
        paths = sorted(folder.glob(f"{scanner}_*_{ending}"))
        if not paths:
            continue
        environment = building(name) if environment is None else environment
        if environment.free.area > LARGEST:
            return []
        spacing = 0.2 if environment.free.area > LARGE else 0.1
        amap = build_map(environment, scanner_of(scanner), spacing=spacing, store=True)
        field = InformationField.of(amap, echoes=begin.limited_by_echoes(scanner_of(scanner)))
        for path in paths:
            with np.load(path) as archive:
                record = {key: archive[key] for key in archive.files}
            odometry = path.name.split("_")[2]
            lost = ~np.isnan(record["lost_at"])
            poses = np.ascontiguousarray(record["poses"], dtype=np.float64)
            driven = DrivenRoute(
                family(name), field, poses, ODOMETRIES[odometry], int(lost.sum()), len(lost)
            )
            stretch = longest_bad(amap, poses, record["distance"])
            guess = math.nan if predictor is None else predictor(amap, poses, driven.noise)
            if predictor is not None and not 0.0 <= guess <= 1.0:
                raise SystemExit(
                    f"--forecast: {guess} for {path} is not a probability; give 0 to 1."
                )
            cases.append(
                Case(
                    driven, scanner, odometry, record["error"], record["lost_at"],
                    record["distance"], stretch, float(guess),
                )
            )  # fmt: skip
    return cases


def family(name: str) -> str:
    """Return what maps of the same building have in common: they are left out together."""
    name = re.sub(r"_furnitures$|_scan$", "", name.removesuffix("_furnitures"))
    return {"ipa_Freiburg79": "freiburg-079", "ipa_lab_intel": "intel"}.get(name, name)


def longest_bad(amap: AmbiguityMap, poses: Floats, distance: Floats) -> float:
    """Return the metres of the longest stretch above `BAD`."""
    theta = poses[:, 2] if amap.has_theta else None
    bad = np.asarray(amap.sample("level", poses[:, 0], poses[:, 1], theta)) > BAD
    longest = current = 0.0
    for step, high in zip(np.diff(distance), bad[1:], strict=True):
        current = current + float(step) if high else 0.0
        longest = max(longest, current)
    return longest


def as_it_is(
    localizer: LocalizerClass, routes: list[DrivenRoute], rng: np.random.Generator
) -> Calibration:
    """Return forecasts of a class that was fitted elsewhere."""
    from ambinav.forecasting.calibrate import raw_shares

    shares = np.array([route.lost / route.runs for route in routes])
    forecasts = localizer.calibrated(raw_shares(localizer, routes, np.diag(np.square(START_STD))))
    buildings = np.array([route.building for route in routes])
    return Calibration(
        localizer, forecasts, skill_interval(forecasts, shares, buildings, rng),
        skill_ceiling(shares, np.array([route.runs for route in routes])),
    )  # fmt: skip


def summary(fitted: Calibration, cases: list[Case], rng: np.random.Generator) -> str:
    """Return the tables of skills, the class and the rivals, for all scanners and each."""
    shares = np.array([case.driven.lost / case.driven.runs for case in cases])
    buildings = np.array([case.driven.building for case in cases])
    runs = np.array([case.driven.runs for case in cases])
    variance = np.array([ODOMETRIES[case.odometry].growth(2.0) for case in cases])
    stretch = np.array([case.stretch for case in cases])
    length = np.array([case.distance[-1] for case in cases])
    rivals: dict[str, Floats] = {
        "longest stretch": np.log(stretch + 0.1),
        "longest stretch times odometry": np.log((stretch + 0.1) * variance),
        "length times odometry": np.log((length + 0.1) * variance),
    }
    forecasts = {"forecast": fitted.left_out}
    forecasts |= {name: left_out_line(x, shares, buildings) for name, x in rivals.items()}
    predictions = np.array([case.other for case in cases])
    if np.isfinite(predictions).all():
        forecasts["--forecast"] = predictions
    rows = []
    scanners = list(dict.fromkeys(case.scanner for case in cases))
    for scanner in ["all", *scanners]:
        part = np.array([scanner in ("all", case.scanner) for case in cases])
        if not 0.0 < shares[part].mean() < 1.0:
            continue
        losing = len(np.unique(buildings[part & (shares > 0.0)]))
        each = [
            skill_interval(p[part], shares[part], buildings[part], rng) for p in forecasts.values()
        ]
        each.insert(
            1, ensemble_skill([case for case in cases if scanner in ("all", case.scanner)], rng)
        )
        rows.append(
            [
                scanner, part.sum(), len(np.unique(buildings[part])), losing,
                f"{100.0 * shares[part].mean():.1f}",
                f"{skill_ceiling(shares[part], runs[part]):.3f}",
                *(f"{i.value:.3f} [{i.low:.2f}, {i.high:.2f}]" for i in each),
            ]
        )  # fmt: skip
    header = ["scanner", "routes", "buildings", "that lose robots", "% lost", "ceiling", *forecasts]
    header.insert(7, "half of the robots")
    better = paired_gain(
        fitted.left_out, forecasts["longest stretch times odometry"], shares, buildings, rng
    )
    per = {name: float(shares[buildings == name].sum()) for name in np.unique(buildings)}
    three = sum(sorted(per.values())[-3:]) / shares.sum()
    fit = fitted.localizer
    return "\n\n".join(
        [
            table(header, rows),
            f"Class: gain {fit.gain:.3g}, turn_gain {fit.turn_gain:.3g}, offset "
            f"{fit.offset:.2f}, slope {fit.slope:.2f}. The three buildings that lose most have "
            f"{100.0 * three:.0f} % of the losses. Skill more than the longest stretch times "
            f"odometry, paired: {better}.",
        ]
    )


def ensemble_skill(cases: list[Case], rng: np.random.Generator) -> Interval:
    """Return the skill of half of the robots as a forecast for the other half, and vice versa."""
    halves = [np.array_split(~np.isnan(case.lost_at), 2) for case in cases]
    first, second = (np.array([half[k].mean() for half in halves]) for k in (0, 1))
    buildings = np.array([case.driven.building for case in cases])
    return skill_interval(
        np.concatenate([first, second]), np.concatenate([second, first]), np.tile(buildings, 2), rng
    )


def left_out_line(x: Floats, shares: Floats, buildings: NDArray[np.str_]) -> Floats:
    """Return forecasts by a logistic line in x, fitted without the building of each route."""
    from scipy.optimize import minimize

    def loss(line: Floats, x: Floats, y: Floats) -> float:
        z = line[0] + line[1] * x
        return float(np.mean(np.logaddexp(0.0, z) - y * z))

    out = np.empty(len(x))
    names = np.unique(buildings)
    part = np.random.default_rng(SEED).permutation(np.arange(len(names)) % 5)
    for fold in range(5):
        is_left_out = np.isin(buildings, names[part == fold])
        line = minimize(loss, np.array([-2.0, 0.5]), (x[~is_left_out], shares[~is_left_out])).x
        out[is_left_out] = 1.0 / (1.0 + np.exp(-(line[0] + line[1] * x[is_left_out])))
    return out


def paired_gain(
    ours: Floats,
    theirs: Floats,
    shares: Floats,
    buildings: NDArray[np.str_],
    rng: np.random.Generator,
) -> str:
    """Return the difference of two skills with its interval over buildings."""
    from ambinav.drive.bootstrap import grouped_weights

    drawn = [
        brier_skill(ours, shares, w) - brier_skill(theirs, shares, w)
        for w in np.concatenate(list(grouped_weights(buildings, rng, 1000)))
        if 0.0 < (w * shares).sum() < w.sum()
    ]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{brier_skill(ours, shares) - brier_skill(theirs, shares):.3f} [{low:.3f}, {high:.3f}]"


def reliability(forecasts: Floats, cases: list[Case]) -> str:
    """Return the table of forecasts against drives, with an interval of the latter."""
    driven = [case.driven for case in cases]
    lost, runs = (np.array([getattr(route, key) for route in driven]) for key in ("lost", "runs"))
    buildings = np.array([route.building for route in driven])
    rows = []
    for each in reliability_of(forecasts, lost, runs, buildings):
        part = (forecasts >= each.forecast_low) & (forecasts <= each.forecast_high)
        rows.append(
            [
                f"{100 * each.forecast_low:g} to {100 * each.forecast_high:g}", each.routes,
                f"{100.0 * forecasts[part].mean():.1f}", f"{100.0 * each.lost:.1f}",
                f"{100.0 * each.lost_low:.1f} to {100.0 * each.lost_high:.1f}",
            ]
        )  # fmt: skip
    return table(["forecast, %", "routes", "mean forecast, %", "lost, %", "95 %"], rows)


def coverage(localizer: LocalizerClass, cases: list[Case]) -> str:
    """Return how often positions of robots that are not lost lie within their ellipses."""
    settings = localizer.settings(0.5, math.radians(30.0))
    start = np.diag(np.square(START_STD))
    distances: dict[str, list[Floats]] = {}
    for case in cases:
        driven = case.driven
        covariance, lost = np.empty((len(driven.poses), 3, 3)), np.empty(len(driven.poses))
        forecast_rows(
            0, 1, np.array([0, len(driven.poses)]), driven.poses, start, driven.field.fields,
            driven.field.lattice, driven.noise.packed, settings, covariance, lost,
        )  # fmt: skip
        tracked = ~(case.distance[None] >= np.nan_to_num(case.lost_at, nan=np.inf)[:, None])
        error = case.error[..., :2].astype(np.float64)
        d = np.einsum("rni,nij,rnj->rn", error, np.linalg.inv(covariance[:, :2, :2]), error)
        distances.setdefault(case.scanner, []).append(d[tracked & np.isfinite(d)])
    rows = []
    for scanner, parts in distances.items():
        d = np.concatenate(parts)
        rows.append(
            [scanner, f"{100 * np.mean(d < CHI_68):.1f}", f"{100 * np.mean(d < CHI_95):.1f}"]
        )
    return table(["scanner", "within 68 %, %", "within 95 %, %"], rows)


def write_class(path: Path, fitted: Calibration, cases: list[Case]) -> None:
    """Write the file of a class, with where it comes from."""
    skill, buildings = fitted.skill, {case.driven.building for case in cases}
    made = (
        f"{datetime.now(UTC):%Y-%m-%d}, commit {commit()}: {len(cases)} routes with "
        f"{', '.join(dict.fromkeys(case.scanner for case in cases))} in {len(buildings)} "
        "buildings, "
        f"{cases[0].driven.runs} runs each; Brier skill on buildings left out {skill.value:.2f} "
        f"[{skill.low:.2f}, {skill.high:.2f}], at most {fitted.ceiling:.2f}"
    )
    replace(fitted.localizer, made=made).to_yaml(path)


if __name__ == "__main__":
    main()
