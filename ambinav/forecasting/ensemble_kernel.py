"""Kernels of an ensemble: whole runs of a localizer along a route, without Python in a step.

The true pose keeps to the route, so the true ranges at each sample are the same in all runs, and
computed once, whatever the building is made of; runs differ in the errors of the start, of odometry
and of the readings. A scan is read only where the localizer takes one in.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.drive.noise import PackedNoise, sample_odometry
from ambinav.drive.readings import capture
from ambinav.forecasting.likelihood_table import LikelihoodTable, likelihood_table, table_factors
from ambinav.forecasting.ray_factors import HitCurve, hit_curve, ray_factors
from ambinav.localization.ekf import update_runs
from ambinav.localization.filter_state import FilterModel
from ambinav.localization.mcl_update import (
    BLOCK,
    carry_along,
    is_due,
    kept_weight,
    start_run,
    take_in,
    update_run,
)
from ambinav.localization.odometry import apply_motions, deviations, motion_between, wrapped
from ambinav.localization.random import normals, ziggurats
from ambinav.runtime.array_types import Floats, UInts
from ambinav.runtime.kernels import kernel


class RouteScans(NamedTuple):
    """Arrays that all runs along a route share.

    Attributes:
        poses: True poses, shape (n, 3), metres and radians, map frame.
        mean: See `Readings.moments`, shape (n, B).
        std: See there.
        sensors: See `Readings.sensors`.
        deviations: Of x, y (metres) and heading (radians) of the first estimate, shape (3,).
        noise: Errors of the odometry.
    """

    poses: Floats
    mean: Floats
    std: Floats
    sensors: Floats
    deviations: Floats
    noise: PackedNoise


class QuickTables(NamedTuple):
    """Tables that scans are weighed with where a filter's model allows it: one of the two.

    Attributes:
        table: For likelihood fields, see there.
        curve: For the ray model, see there.
    """

    table: LikelihoodTable | None
    curve: HitCurve | None


def quick_tables(model: FilterModel) -> QuickTables | None:
    """Return what the scans of a model are weighed with; None if by `mcl_update.weigh`."""
    tables = QuickTables(likelihood_table(model), hit_curve(model))
    return tables if tables.table is not None or tables.curve is not None else None


class RunStreams(NamedTuple):
    """States of the random numbers of R runs, uint64, shape (R, 4) each.

    Attributes:
        start: Of the first estimates.
        odometry: Of the odometry.
        readings: Of the readings.
        own: Of the localizer.
    """

    start: UInts
    odometry: UInts
    readings: UInts
    own: UInts


@kernel
def start_pose(scans, random, pose):
    """Draw a first estimate about the first true pose into `pose`, shape (3,)."""
    for j in range(3):
        pose[j] = scans.poses[0, j] + scans.deviations[j] * normals(random)[0]


@kernel
def next_odometry(x, y, t, k, scans, random):
    """Return the odometry pose at sample k from that at the sample before it."""
    a, b = scans.poses[k - 1], scans.poses[k]
    return sample_odometry(x, y, t, a[0], a[1], a[2], b[0], b[1], b[2], scans.noise, random)


@kernel
def write_error(mean, pose, error):
    """Write an estimate minus the true pose, float32, shape (3,)."""
    error[0], error[1] = mean[0] - pose[0], mean[1] - pose[1]
    error[2] = wrapped(mean[2] - pose[2])


@kernel
def drive_particles(low, high, scans, streams, root, model, cast, quick, plain, state, errors):
    """Run Monte Carlo localization along the route, runs low to high - 1.

    Args:
        low: First run.
        high: One past the last.
        scans: See `RouteScans`.
        streams: See `RunStreams`.
        root: Root of the first covariance, shape (3, 3).
        model: See `filter_state.FilterModel`.
        cast: See `filter_state.filter_tables`.
        quick: See `QuickTables`; None: scans are taken in by `mcl_update.update_run`.
        plain: None where `quick` is not, else True: the branch of the other is then not compiled.
        state: `FilterState` of one run, which is used for one after the other.
        errors: Written, float32, shape (R, n, 3).
    """
    readings = np.empty((1, scans.mean.shape[1]), dtype=np.float32)
    pose = np.empty(3)
    for r in range(low, high):
        for j in range(4):
            state.random[0, j] = streams.own[r, j]
        start_pose(scans, streams.start[r], pose)
        start_run(0, pose, root, model, state)
        x = y = t = 0.0
        for k in range(scans.poses.shape[0]):
            if k > 0:
                x, y, t = next_odometry(x, y, t, k, scans, streams.odometry[r])
            due = is_due(0, x, y, t, model, state)
            if due:
                capture(
                    scans.mean[k : k + 1], scans.std[k : k + 1], scans.sensors,
                    streams.readings[r : r + 1], readings,
                )  # fmt: skip
            if plain is not None:
                update_run(0, x, y, t, readings[0], model, cast, state, None, readings[0])
            if quick is not None:
                if due:
                    prior = move_quickly(x, y, t, model, state)
                    scale = weigh_quickly(readings[0], model, quick.table, quick.curve, state)
                    take_in(0, prior, scale, model, state)
                else:
                    carry_along(0, x, y, t, model, state)
            write_error(state.mean[0], scans.poses[k], errors[r, k])


@kernel
def weigh_quickly(readings, model, table, curve, state):
    """Weigh particles as `mcl_update.weigh` does, with one of `QuickTables`; the other is None."""
    particles, count, scratch = state.particles[0], state.number[0], state.sums[0]
    beams = model.beam.size
    # What is None when a kernel is compiled leaves its branch out.
    if table is not None:
        end, cell = np.empty((2, beams), dtype=np.float32), np.empty(beams, dtype=np.int32)
        return table_factors(particles, count, readings, model, table, end, cell, scratch)
    if curve is not None:
        return ray_factors(particles, count, readings, model, curve, np.empty((4, beams)), scratch)
    return math.nan


@kernel
def move_quickly(x, y, t, model, state):
    """Move the particles as `mcl_update.move_particles` does; return `mcl_update.kept_weight`.

    The errors of their motion come from the ziggurat: a quarter of the time.
    """
    particles, count, anchor = state.particles[0], state.number[0], state.anchor[0]
    random = state.random[0]
    if state.ticks[0, 0] > 0:
        rot1, trans, rot2 = motion_between(anchor[0], anchor[1], anchor[2], x, y, t)
        sd1, sd_trans, sd2 = deviations(rot1, trans, rot2, model.alpha)
        drawn, error = np.empty(3 * BLOCK), np.empty((3, BLOCK))
        for first in range(0, count, BLOCK):
            n = min(BLOCK, count - first)
            ziggurats(random, drawn[: 3 * n])
            for i in range(n):
                error[0, i], error[1, i] = sd1 * drawn[3 * i], sd_trans * drawn[3 * i + 1]
                error[2, i] = sd2 * drawn[3 * i + 2]
            apply_motions(
                particles[first : first + n], rot1, trans, rot2,
                error[0, :n], error[1, :n], error[2, :n],
            )  # fmt: skip
    state.ticks[0, 0] = 1
    anchor[0], anchor[1], anchor[2] = x, y, t
    return kept_weight(particles, count)


@kernel
def drive_kalman(low, high, scans, streams, covariance, alpha, gate, cast, noise, errors):
    """Run a Kalman filter along the route, runs low to high - 1.

    Args:
        low: First run.
        high: One past the last.
        scans: See `RouteScans`.
        streams: See `RunStreams`.
        covariance: Of the first estimate, shape (3, 3).
        alpha: See `ekf.update_runs`, as the next three.
        gate: See there.
        cast: See there.
        noise: See there.
        errors: Written, float32, shape (R, n, 3).
    """
    beams = scans.mean.shape[1]
    readings, ranges = np.empty((1, beams), dtype=np.float32), np.empty((1, beams))
    mean, cov, before, now = (
        np.empty((1, 3)),
        np.empty((1, 3, 3)),
        np.empty((1, 3)),
        np.empty((1, 3)),
    )
    used, intensities = np.empty(1, dtype=np.int64), np.empty((1, 0))
    for r in range(low, high):
        start_pose(scans, streams.start[r], mean[0])
        for i in range(3):
            before[0, i] = now[0, i] = 0.0
            for j in range(3):
                cov[0, i, j] = covariance[i, j]
        for k in range(scans.poses.shape[0]):
            if k > 0:
                now[0, 0], now[0, 1], now[0, 2] = next_odometry(
                    before[0, 0], before[0, 1], before[0, 2], k, scans, streams.odometry[r]
                )
            capture(
                scans.mean[k : k + 1], scans.std[k : k + 1], scans.sensors,
                streams.readings[r : r + 1], readings,
            )  # fmt: skip
            for b in range(beams):
                ranges[0, b] = readings[0, b]
            update_runs(
                mean, cov, before, now, ranges, alpha, gate, cast, noise, used, None, intensities
            )
            for i in range(3):
                before[0, i] = now[0, i]
            write_error(mean[0], scans.poses[k], errors[r, k])
