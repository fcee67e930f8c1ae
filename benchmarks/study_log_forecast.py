"""Forecasts for the scans of real logs, against the errors of a localizer that is replayed on them.

The logs, their maps and `SPARSE_SCANS`, which multiplies the beams as the class `product` does, are
those of `bench_replay.py`. The odometry's variances are fitted to each log's own steps; the filter
of a forecast then goes from scan to scan along the log's poses, one update each. How much of the
errors lies within its ellipses is counted over runs that have not been lost before. The reference
is the log's corrected poses, of which the maps are made too: what is wrong with both is not seen.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from bench_replay import CORRECTED, HALL, Case, cases_of
from harness import arguments, kept_or_made, option, report, table
from numpy.typing import NDArray
from scipy.optimize import nnls

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.filter_kernel import between, filter_room, filter_step
from ambinav.forecasting.forecast import Forecaster
from ambinav.geometry.frames import between as motion_between
from ambinav.geometry.frames import wrap_angles
from ambinav.logs.localize import SPARSE_SCANS, START_STD, localize
from ambinav.logs.log import Log
from ambinav.logs.registration import register
from ambinav.map_building.build import build_map

Floats = NDArray[np.float64]
LIBRARIES = ("ambinav", "numba", "numpy", "scipy")
SPACING = 0.2
SHARES = {0.68: 2.2789, 0.95: 5.9915}
"""Squared Mahalanobis distance, of two dimensions, within which a share lies."""


def main() -> None:
    """Replay, forecast and report."""
    args = arguments(
        __doc__,
        runs=10,
        seed=1,
        logs=option((HALL, *CORRECTED), choices=(HALL, *CORRECTED), metavar="LOG"),
        folder=option(Path("out/log-forecast"), "keeps what this code computed"),
    )
    rows: list[dict[str, Any]] = []
    for name in args.logs:
        key = {"log": name, "runs": args.runs, "seed": args.seed}
        made = kept_or_made(
            args.folder / "logs.jsonl", key,
            lambda name=name: {"cases": [judged(c, args.runs, args.seed) for c in cases_of(name)]},
        )  # fmt: skip
        rows += made["cases"]
    report("Forecasts of real logs", LIBRARIES, body_of(rows, args.runs), args.out)


def judged(case: Case, runs: int, seed: int) -> dict[str, Any]:
    """Return errors, forecasts and coverage of a log."""
    log, environment = case.log, case.environment
    if case.name == HALL:
        # Its ground truth is not in the frame of its map.
        log = register(log, environment).applied(log)
    noise = fitted_odometry(log)
    amap = build_map(environment, log.scanner(), spacing=SPACING, store=False)
    forecaster = Forecaster(amap, noise, start_std=START_STD, environment=environment)
    covariance, lost = forecast_scans(log, forecaster)
    replay = localize(
        log, environment, SPARSE_SCANS, rng=np.random.default_rng(seed), runs=runs, field=case.field
    )
    so_far = ~np.logical_or.accumulate(replay.lost, axis=1)
    poses = log.required_poses()
    error = replay.estimates - poses
    error[..., 2] = wrap_angles(error[..., 2])
    inverse = np.linalg.inv(covariance[:, :2, :2])
    squares = np.einsum("rki,kij,rkj->rk", error[..., :2], inverse, error[..., :2])
    turns = np.abs(error[..., 2]) / np.sqrt(covariance[:, 2, 2])
    counted = so_far[:, 1:]
    return {
        "name": case.name,
        "scans": log.scans,
        "noise": [noise.alpha1, noise.alpha2, noise.alpha3, noise.alpha4],
        "within": [float((squares[:, 1:] <= limit)[counted].mean()) for limit in SHARES.values()],
        "heading_within": float((turns[:, 1:] <= 1.96)[counted].mean()),
        "error": rms(np.hypot(error[..., 0], error[..., 1])[:, 1:][counted]),
        "forecast": rms(
            np.broadcast_to(
                np.sqrt(covariance[1:, 0, 0] + covariance[1:, 1, 1]), counted.shape
            )[counted]
        ),
        "turn": rms(error[:, 1:, 2][counted]),
        "turn_forecast": rms(
            np.broadcast_to(np.sqrt(covariance[1:, 2, 2]), counted.shape)[counted]
        ),
        "lost": int(replay.lost.any(axis=1).sum()),
        "lost_forecast": float(forecaster.localizer.calibrated(lost[-1:])[0]),
    }  # fmt: skip


def fitted_odometry(log: Log) -> OdometryNoise:
    """Fit variances, and the two systematic errors, to the steps of a log."""
    poses = log.required_poses()
    steps, odometry = (motion_between(p[:-1], p[1:]) for p in (poses, log.odometry))
    metres, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    off = odometry - steps
    off[:, 2] = wrap_angles(off[:, 2])
    bias_distance = float(off[:, 0] @ steps[:, 0] / max(steps[:, 0] @ steps[:, 0], 1e-9))
    bias_turn = float(off[:, 2] @ metres / max(metres @ metres, 1e-9))
    along = off[:, 0] - bias_distance * steps[:, 0]
    heading = off[:, 2] - bias_turn * metres
    base = OdometryNoise()
    # var = scale^2 (a |metres| distance + b |turn| angle), with 2 alpha2 and alpha1 for the
    # heading; each step weighs by the inverse of its size, and the largest hundredth are jumps.
    factors = []
    for wrong in (heading, along):
        usual = np.abs(wrong) <= np.quantile(np.abs(wrong), 0.99)
        usual &= metres + turn > 0.0
        size = (metres + turn)[usual]
        design = np.column_stack([metres[usual] * base.distance, turn[usual] * base.angle])
        factors.append(nnls(design / size[:, None], wrong[usual] ** 2 / size)[0])
    (turn_trans, turn_turn), (trans_trans, trans_turn) = factors
    return OdometryNoise(
        alpha1=float(turn_turn), alpha2=float(0.5 * turn_trans), alpha3=float(trans_trans),
        alpha4=float(trans_turn * base.angle / base.distance), scale=1.0,
    )  # fmt: skip


def forecast_scans(log: Log, forecaster: Forecaster) -> tuple[Floats, Floats]:
    """Return covariances after each scan, (S, 3, 3), and raw lost shares up to it, (S,)."""
    poses = np.ascontiguousarray(log.required_poses())
    cov, total = forecaster.start.copy(), forecaster.start.copy()
    room = filter_room()
    covariance, lost = np.empty((log.scans, 3, 3)), np.zeros(log.scans)
    covariance[0], outside, tracked = cov, 0.0, 1.0
    predicted = cov.copy()
    for k in range(1, log.scans):
        metres = max(float(np.hypot(*(poses[k] - poses[k - 1])[:2])), 1e-6)
        # The log has one scan here, however far the robot has come: one update.
        settings = forecaster.settings._replace(distance=metres, angle=math.inf)
        outside, tracked = filter_step(
            poses[k - 1], poses[k], cov, total, outside, tracked, forecaster.field.fields,
            forecaster.field.lattice, forecaster.odometry.packed, settings, predicted, room,
        )  # fmt: skip
        covariance[k] = cov
        lost[k] = between(outside, 1.0 - tracked)
    return covariance, lost


def rms(values: Floats) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def body_of(rows: list[dict[str, Any]], runs: int) -> str:
    """Compose the report."""
    lines = [
        [
            row["name"], row["scans"],
            ", ".join(f"{value:.2g}" for value in row["noise"]),
            *(f"{100.0 * share:.1f}" for share in row["within"]),
            f"{100.0 * row['heading_within']:.1f}",
            f"{row['error']:.3f}", f"{row['forecast']:.3f}",
            f"{math.degrees(row['turn']):.2f}", f"{math.degrees(row['turn_forecast']):.2f}",
            f"{row['lost']} of {runs}", f"{100.0 * row['lost_forecast']:.1f}",
        ]
        for row in rows
    ]  # fmt: skip
    header = [
        "log", "scans", "alpha1 to alpha4 (scale 1)", "within 68 %", "within 95 %",
        "heading within 95 %", "rms error, m", "forecast, m", "degrees", "forecast",
        "runs ever lost", "forecast, %",
    ]  # fmt: skip
    return (
        f"{runs} runs of each log. Shares are of all scans and runs, in per cent.\n\n"
        f"{table(header, lines, words=3)}"
    )


if __name__ == "__main__":
    main()
