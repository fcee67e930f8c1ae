"""Inputs and outputs of the kernels of Monte Carlo localization: two named tuples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ambinav.casting.scans import check_rays
from ambinav.geometry.environment import Environment
from ambinav.localization.bins import WINDOW, table_size
from ambinav.localization.casting import CastTables, cast_tables
from ambinav.localization.information import BeamNoise, beam_noise
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.parameters import LASER_MODELS, MclParameters
from ambinav.localization.range_table import RangeTable, empty_range_table, range_table
from ambinav.localization.resampling import CODES
from ambinav.runtime.array_types import Floats, Floats32, Ints, Ints32, UInts
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

FIELD_SUM, FIELD_PRODUCT, BEAM_SUM, BEAM_PRODUCT = range(4)


class FilterModel(NamedTuple):
    """Parameters, scanner and map of a filter; the same for all runs, read-only.

    Attributes:
        alpha: alpha1 to alpha4.
        kind: `FIELD_SUM`, `FIELD_PRODUCT`, `BEAM_SUM` or `BEAM_PRODUCT`.
        z_hit: As in `MclParameters`, as are those that follow.
        power: importance_factor.
        least: min_particles.
        most: max_particles.
        error: pf_err.
        quantile: pf_z.
        update_d: update_min_d, metres.
        update_a: update_min_a, radians.
        interval: resample_interval.
        slow: recovery_alpha_slow.
        fast: recovery_alpha_fast.
        reset: recovery_reset.
        method: See `resampling.CODES`.
        mean_of_all: True if the estimate is the mean of all particles.
        beam: Which of the scanner's beams are used, shape (U,).
        mount: x, y (metres), and x, y of the unit vector along each of them, shape (U, 4).
        near: Readings up to here are too near, shape (U,), metres.
        far: Readings from here on are out of range, shape (U,), metres.
        hits: See `LikelihoodField.hits`; (1, 1) for the ray model.
        field_x: x of hits[0, 0], metres.
        field_y: y of it.
        inverse: Points of the field per metre.
        smooth: Whether to interpolate between them.
        areas: Cumulated areas of the free space's triangles, shape (T,), square metres.
        corner: Their corners, shape (3 T, 2), metres.
        trust: localizability_weighting.
        noise: Noise of the beams used; of none where `trust` is 0.
        table: Without sensors where rays are cast.
    """

    alpha: Floats
    kind: int
    z_hit: float
    z_short: float
    z_max: float
    z_rand: float
    sigma_hit: float
    lambda_short: float
    power: float
    least: int
    most: int
    error: float
    quantile: float
    update_d: float
    update_a: float
    interval: int
    slow: float
    fast: float
    reset: bool
    method: int
    mean_of_all: bool
    beam: Ints
    mount: Floats
    near: Floats
    far: Floats
    hits: Floats32
    field_x: float
    field_y: float
    inverse: float
    smooth: bool
    areas: Floats
    corner: Floats
    trust: float
    noise: BeamNoise
    table: RangeTable


class FilterState(NamedTuple):
    """Mutable state; one row per run. M is max_particles, H the size of a hash table.

    Attributes:
        particles: x, y, theta, weight, and 1 for those that the last resampling put anywhere
            (else 0), shape (R, M, 5).
        spare: Where the next set is drawn into, shape (R, M, 5).
        number: Particles in use, shape (R,); 0 before a start.
        random: States of the generators, uint64, shape (R, 4).
        anchor: Odometry pose at the last update, shape (R, 3).
        base: Estimate at the last update, shape (R, 3).
        base_covariance: Its covariance, shape (R, 3, 3).
        mean: Estimate now, shape (R, 3).
        covariance: Its covariance, shape (R, 3, 3).
        averages: Slow and fast average of the likelihood, shape (R, 2).
        ticks: Whether a scan was taken in since the start, and how many updates there were,
            int64, shape (R, 2).
        keys: Bins of the particles, int64, shape (R, H).
        entry: Entries of `keys` in use, int32, shape (R, M).
        places: Entry of each particle's bin, int32, shape (R, M).
        found: Work space, int64, shape (R, M).
        label: Work space, int32, shape (R, H).
        stack: Work space, int32, shape (R, M).
        headings: Work space, int64, shape (R, 2, W), see `bins.label_clusters`.
        sums: Work space, shape (R, M).
    """

    particles: Floats
    spare: Floats
    number: Ints
    random: UInts
    anchor: Floats
    base: Floats
    base_covariance: Floats
    mean: Floats
    covariance: Floats
    averages: Floats
    ticks: Ints
    keys: Ints
    entry: Ints32
    places: Ints32
    found: Ints
    label: Ints32
    stack: Ints32
    headings: Ints
    sums: Floats


def filter_model(
    environment: Environment,
    scanner: RangeScanner,
    parameters: MclParameters,
    field: LikelihoodField | None,
) -> FilterModel:
    """Build the model that the kernels read.

    Args:
        environment: The map.
        scanner: The scanner.
        parameters: The parameters.
        field: A likelihood field of the environment; None: one is made if it is needed.

    Raises:
        InputError: no beam is left between laser_min_range and laser_max_range, or the building
            and the scanner do not go together (`casting.scans.check_rays`).
    """
    check_rays(environment, *scanner.upright.T)
    p = parameters
    step = max((scanner.beams - 1) // (p.max_beams - 1), 1)
    beam = np.arange(0, scanner.beams, step, dtype=np.int64)
    sensors = [scanner.sensors[k] for k in scanner.sensor_of_beam[beam]]
    near, far = (np.array([getattr(s, k) for s in sensors]) for k in ("min_range", "max_range"))
    if p.laser_max_range > 0.0:
        far = np.minimum(far, p.laser_max_range)
    if p.laser_min_range > 0.0:
        near = np.maximum(near, p.laser_min_range)
    if (near >= far).any():
        b = int(np.argmax(near >= far))
        raise InputError(
            f"laser_min_range is {p.laser_min_range:g} and laser_max_range {p.laser_max_range:g}, "
            f"which leaves beam {beam[b]} of scanner {scanner.name!r} nothing to read; move them "
            "apart."
        )
    kind = LASER_MODELS.index(p.laser_model_type)
    if kind >= BEAM_SUM:
        hits, origin, inverse = np.zeros((1, 1), dtype=np.float32), (0.0, 0.0), 1.0
    else:
        if field is None:
            reach = p.laser_likelihood_max_dist
            field = LikelihoodField.of(environment, p.likelihood_resolution, reach)
        hits, origin, inverse = field.hits(p.sigma_hit), field.origin, 1.0 / field.resolution
    table = empty_range_table()
    if kind >= BEAM_SUM and p.beam_table_resolution > 0.0:
        table = range_table(environment, scanner, beam, p.beam_table_resolution)
    noise = beam_noise(environment, scanner, environment.map_std)
    weighed = beam if p.localizability_weighting > 0.0 else beam[:0]
    noise = BeamNoise(
        noise.near[weighed], noise.far[weighed], noise.bias[weighed], noise.variance[weighed],
        noise.frontier, np.arange(len(weighed)), noise.steady[weighed],
    )  # fmt: skip
    corner = environment.triangulation.corner
    (ax, ay), (bx, by), (cx, cy) = corner.reshape(-1, 3, 2).transpose(1, 2, 0)
    areas = np.cumsum(np.abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) / 2.0)
    return FilterModel(
        p.odometry.array, kind, p.z_hit, p.z_short, p.z_max, p.z_rand, p.sigma_hit,
        p.lambda_short, p.importance_factor, p.min_particles, p.max_particles, p.pf_err, p.pf_z,
        p.update_min_d, p.update_min_a, p.resample_interval, p.recovery_alpha_slow,
        p.recovery_alpha_fast, p.recovery_reset, CODES[p.resampling], p.estimate == "mean", beam,
        scanner.axes(beam), near, far, hits, origin[0], origin[1],
        inverse, p.likelihood_interpolation == "bilinear", areas, corner,
        p.localizability_weighting, noise, table,
    )  # fmt: skip


def filter_tables(
    environment: Environment, scanner: RangeScanner, model: FilterModel
) -> CastTables | None:
    """Return the tables with which filters of a model cast rays; None if it uses no ray model.

    Kernels that are given None are compiled without all that works on rays, which halves the time
    it takes. Where ranges are looked up no ray is cast: a table without rays will do, in any
    building.

    Raises:
        InputError: rays are cast, and the building is a mesh.
    """
    if model.trust == 0.0 and model.kind < BEAM_SUM:
        return None
    if model.trust == 0.0 and len(model.table.ranges):
        return cast_tables(environment.plan, scanner, model.beam[:0])
    return cast_tables(environment, scanner, model.beam)


def covariance_roots(covariances: Floats) -> Floats:
    """Return roots L of covariances L L^T, both of shape (R, 3, 3).

    Raises:
        InputError: one has a negative eigenvalue.
    """
    values, vectors = np.linalg.eigh(covariances)
    if values.min() < -1e-9 * max(float(np.abs(values).max()), 1.0):
        raise InputError(
            f"covariance has the eigenvalue {values.min():g}; give a covariance, whose "
            "eigenvalues are at least 0."
        )
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis, :]
    return np.ascontiguousarray(root)


def filter_bytes(parameters: MclParameters) -> int:
    """Return the bytes of a run's rows in a `FilterState`, except for a few hundred."""
    most = parameters.max_particles
    return 108 * most + 12 * table_size(most) + 16 * WINDOW * WINDOW


def filter_state(parameters: MclParameters, runs: int, random: UInts) -> FilterState:
    """Make the state of filters that are not started yet."""
    most, size = parameters.max_particles, table_size(parameters.max_particles)
    return FilterState(
        particles=np.zeros((runs, most, 5)),
        spare=np.zeros((runs, most, 5)),
        number=np.zeros(runs, dtype=np.int64),
        random=random,
        anchor=np.zeros((runs, 3)),
        base=np.zeros((runs, 3)),
        base_covariance=np.zeros((runs, 3, 3)),
        mean=np.full((runs, 3), np.nan),
        covariance=np.full((runs, 3, 3), np.nan),
        averages=np.zeros((runs, 2)),
        ticks=np.zeros((runs, 2), dtype=np.int64),
        keys=np.full((runs, size), -1, dtype=np.int64),
        entry=np.zeros((runs, most), dtype=np.int32),
        places=np.zeros((runs, most), dtype=np.int32),
        found=np.zeros((runs, most), dtype=np.int64),
        label=np.zeros((runs, size), dtype=np.int32),
        stack=np.zeros((runs, most), dtype=np.int32),
        headings=np.zeros((runs, 2, WINDOW * WINDOW), dtype=np.int64),
        sums=np.zeros((runs, most)),
    )
