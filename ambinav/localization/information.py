"""Fisher information that a scan gives about its pose.

A beam's range changes with the pose of the robot by a gradient that the surface's normal n gives:
for a ray in the direction u at whose end e, held to sensor and ray, moves by de when the robot
moves, d range = -n . de / (n . u). Summed over the beams, g g^T / sigma^2 is the Fisher
information of the scan, whose inverse no unbiased localizer beats (Censi 2007, "On achievable
accuracy for range-finder localization", ICRA). Beams without an echo, or that end in unknown
space, tell nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ambinav.casting.mesh.mesh import Mesh
from ambinav.config import as_array, as_nonnegative
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.localization.casting import (
    CastTables,
    cast_tables,
    echo_normal,
    expected_ranges,
    nearest_echoes,
    vertical_part,
    work_space,
)
from ambinav.localization.mesh_rays import MeshRays, mesh_rays
from ambinav.localization.prism_tables import edge_kinds
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

# Entries of the tables of bias and deviation over the range.
TABLE = 512
# Rays cast in a mesh at a time; their hits are kept in memory until they are read.
RAYS_AT_ONCE = 4_000_000
# A range is taken to change no faster than at this cosine of the incidence angle (87 degrees):
# so near to grazing, a linear model is wrong.
GRAZING = 0.05
# No beams and no matrices, for `informations`.
NOBODY, NOTHING = np.empty(0), np.empty((0, 3, 3))


class BeamNoise(NamedTuple):
    """Measurement noise of the beams; TABLE entries each from range 0 to the maximum.

    Attributes:
        near: Minimum range, shape (B,), metres.
        far: Maximum range, shape (B,), metres.
        bias: Mean of reading minus true range, shape (rows, TABLE), metres; one row a beam.
        variance: Variance of the reading about it, with that of the map and of the rounding to a
            bin, shape (rows, TABLE), square metres.
        frontier: Which border edges are the frontier to unknown space, shape (K,); see
            `prism_tables.edge_kinds`.
        row: Which row of bias and variance each beam reads, shape (B,): a kernel that scans from
            many places in turn does better with one row a sensor, which stays in the cache.
        steady: Rows whose bias and variance are the same at any range, mask, shape (rows,).
    """

    near: Floats
    far: Floats
    bias: Floats
    variance: Floats
    frontier: Bools
    row: Ints
    steady: Bools


def beam_noise(environment: Environment, scanner: RangeScanner, map_std: float) -> BeamNoise:
    """Tabulate a scanner's beams; `map_std` is the deviation of the walls' position, metres."""
    bias, variance = [], []
    for sensor in scanner.sensors:
        ranges = np.linspace(0.0, sensor.max_range, TABLE)
        bias.append(sensor.bias_at(ranges))
        rounding = sensor.resolution**2 / 12.0
        variance.append(sensor.std_at(ranges) ** 2 + rounding + map_std**2)
    which = scanner.sensor_of_beam
    return BeamNoise(
        np.array([s.min_range for s in scanner.sensors])[which],
        np.array([s.max_range for s in scanner.sensors])[which],
        np.array(bias)[which],
        np.array(variance)[which],
        edge_kinds(environment) == FRONTIER,
        np.arange(scanner.beams),
        steady_rows(np.array(bias), np.array(variance))[which],
    )


def steady_rows(bias: Floats, variance: Floats) -> Bools:
    """Return which rows of tables (rows, TABLE) are constant, shape (rows,)."""
    flat: Bools = (np.ptp(bias, axis=1) == 0.0) & (np.ptp(variance, axis=1) == 0.0)
    return flat


def scan_information(
    environment: Environment, scanner: RangeScanner, poses: ArrayLike, map_std: float | None = None
) -> Floats:
    """Compute the Fisher information that one scan gives about its pose.

    Args:
        environment: The environment.
        scanner: The scanner.
        poses: x, y, theta, shape (N, 3) or (3,).
        map_std: Standard deviation of the walls' position, metres, which adds to the sensor's;
            None: the environment's `map_std`.

    Returns:
        Shape (N, 3, 3), about x, y (1 / square metres) and theta (1 / square radians), map frame.

    Raises:
        InputError: the poses have no such shape or are not finite, or map_std is negative.
    """
    rows = as_poses(poses, "poses")
    cast = ray_caster(environment, scanner, np.arange(scanner.beams))
    noise = beam_noise(environment, scanner, as_map_std(environment, map_std))
    out = np.empty((len(rows), 3, 3))
    informations(rows, cast, noise, out)
    return out


def as_poses(values: ArrayLike, name: str) -> Floats:
    """Return poses of shape (N, 3), or raise `InputError` that names them."""
    rows = np.atleast_2d(as_array(values, name, "x, y, theta, (N, 3)"))
    if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
        raise InputError(f"{name}: the shape is {rows.shape}; give finite x, y, theta, (N, 3).")
    return rows


def as_covariances(values: ArrayLike, name: str, number: int) -> Floats:
    """Return covariances of shape (N, 3, 3) from one or N, or raise `InputError` with `name`."""
    array = as_array(values, name, "a covariance of x, y, theta, (3, 3)")
    if array.shape not in ((3, 3), (number, 3, 3)) or not np.isfinite(array).all():
        raise InputError(
            f"{name}: the shape is {array.shape}; give a finite covariance of x, y, theta, (3, 3) "
            f"or {(number, 3, 3)}."
        )
    scale = max(float(np.abs(array).max(initial=0.0)), 1e-300)
    if np.abs(array - array.swapaxes(-1, -2)).max(initial=0.0) > 1e-9 * scale:
        raise InputError(f"{name} is not symmetric; give a covariance.")
    least = np.linalg.eigvalsh(array).min(initial=0.0)
    if least < -1e-9 * scale:
        raise InputError(
            f"{name} has the eigenvalue {least:g}; give a covariance, whose eigenvalues are at "
            "least 0."
        )
    return np.array(np.broadcast_to(array, (number, 3, 3)))


def as_map_std(environment: Environment, map_std: float | None) -> float:
    """Return the given deviation of the walls, or the environment's; `InputError` if negative."""
    value = environment.map_std if map_std is None else map_std
    return as_nonnegative(value, "map_std", "metres")


@kernel
def beam_lines(x, y, theta, cast, noise, work, ranges, ray, edge, line):
    """Compute the expected reading of each beam at a pose, and its derivatives by the pose.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        theta: Radians.
        cast: See `casting.CastTables`; all beams.
        noise: See `BeamNoise`.
        work: See `casting.work_space`.
        ranges: Work space, shape (B,).
        ray: Work space, int32, shape (B,).
        edge: Work space, int32, shape (B,).
        line: Written, shape (B, 5): mean reading (metres), its derivatives by x, y (1) and theta
            (metres per radian), and its variance; inf where the beam tells nothing.
    """
    expected_ranges(x, y, theta, cast, work, ranges, ray, edge)
    linear_readings(theta, cast, noise, ranges, ray, edge, line)


@kernel(forceinline=True)
def linear_readings(theta, cast, noise, ranges, ray, edge, line):
    """Compute `beam_lines` from ranges, rays and edges that are known already."""
    co, si = math.cos(theta), math.sin(theta)
    in_space = cast.tilt.size > 0
    for b in range(ranges.size):
        d, j, k = ranges[b], ray[b], edge[b]
        line[b, 4] = math.inf
        if j < 0 or not d > noise.near[b] or noise.frontier[k]:
            continue
        shift, rise, line[b, 4] = sensor_line(d, b, noise)
        line[b, 0] = d + shift
        bx, by = cast.cosine[j], cast.sine[j]
        ux, uy = co * bx - si * by, si * bx + co * by
        nx, ny = echo_normal(cast.inner[j], ux, uy, cast.normal[k, 0], cast.normal[k, 1])
        vertical = 0.0
        if in_space:
            vertical = vertical_part(cast.inner[j], ux, uy, cast.up[j], cast.tilt[k])
        line[b, 1], line[b, 2], line[b, 3] = gradient(
            d, rise, co, si, bx, by, cast.start[j, 0], cast.start[j, 1], nx, ny,
            vertical,
        )  # fmt: skip


@kernel(forceinline=True)
def sensor_line(d, b, noise):
    """Return beam b's bias at a range, metres, its slope over the range, and the variance."""
    r = np.uint64(noise.row[b])
    # A fifth of the work, which a sensor that is the same at any range can do without.
    if noise.steady[r]:
        return noise.bias[r, 0], 0.0, noise.variance[r, 0]
    per_metre = (TABLE - 1) / noise.far[b]
    place = d * per_metre
    low = np.uint64(min(max(int(place), 0), TABLE - 2))
    share, after = place - float(low), low + np.uint64(1)
    rise = (noise.bias[r, after] - noise.bias[r, low]) * per_metre
    shift = noise.bias[r, low] * (1.0 - share) + noise.bias[r, after] * share
    variance = noise.variance[r, low] * (1.0 - share) + noise.variance[r, after] * share
    return shift, rise, variance


@kernel(forceinline=True)
def gradient(d, rise, co, si, cosine, sine, start_x, start_y, nx, ny, vertical):
    """Return derivatives of a beam's reading by the robot's x, y and theta.

    Args:
        d: Distance at which its ray meets a wall, metres.
        rise: See `sensor_line`.
        co: Cosine of the robot's heading.
        si: Sine of it.
        cosine: Cosine of the ray's angle in the robot's frame.
        sine: Likewise.
        start_x: x of the start of the ray there, metres.
        start_y: Likewise.
        nx: x of the unit normal in the map frame, see `casting.echo_normal`.
        ny: Likewise.
        vertical: See `casting.vertical_part`.
    """
    ux = co * cosine - si * sine
    uy = si * cosine + co * sine
    facing = nx * ux + ny * uy + vertical
    facing = math.copysign(max(abs(facing), GRAZING), facing)
    # How the sensor and the end of its beam swing when the robot turns.
    sx = -si * start_x - co * start_y - d * uy
    sy = co * start_x - si * start_y + d * ux
    scale = -(1.0 + rise) / facing
    return nx * scale, ny * scale, (nx * sx + ny * sy) * scale


@kernel
def line_space(beams, rays):
    """Return the last five arguments of `beam_lines` for given numbers of beams and rays."""
    return (
        work_space(rays), np.empty(beams), np.empty(beams, dtype=np.int32),
        np.empty(beams, dtype=np.int32), np.empty((beams, 5)),
    )  # fmt: skip


@kernel
def _informations(low, high, poses, cast, noise, out, share, echoes):
    work, ranges, ray, edge, line = line_space(noise.far.size, cast.cosine.size)
    for p in range(low, high):
        beam_lines(
            poses[p, 0], poses[p, 1], poses[p, 2], cast, noise, work, ranges, ray, edge, line
        )
        _sum_lines(line, out[p])
        if share.size > 0:
            _sum_normals(line, share, echoes[p])


@kernel
def _informations_of_hits(low, high, theta, tables, noise, distance, hit, out, share, echoes):
    work, ranges, ray, edge, line = line_space(noise.far.size, tables.cosine.size)
    ux, uy, _, _, stack = work
    for p in range(low, high):
        nearest_echoes(tables, (ux, uy, distance[p], hit[p], stack), ranges, ray, edge)
        linear_readings(theta[p], tables, noise, ranges, ray, edge, line)
        _sum_lines(line, out[p])
        if share.size > 0:
            _sum_normals(line, share, echoes[p])


@kernel(forceinline=True)
def _sum_lines(line, out):
    """Write the information of the beams whose lines are given, shape (3, 3)."""
    out[:] = 0.0
    for b in range(line.shape[0]):
        if line[b, 4] < math.inf:
            for i in range(3):
                for j in range(3):
                    out[i, j] += line[b, 1 + i] * line[b, 1 + j] / line[b, 4]


@kernel(forceinline=True)
def _sum_normals(line, share, out):
    """Write sums over the beams with an echo: see `informations`."""
    out[:] = 0.0
    for b in range(line.shape[0]):
        square = line[b, 1] * line[b, 1] + line[b, 2] * line[b, 2]
        # What is level, or a foot at rest, moves no echo in the plane.
        if line[b, 4] < math.inf and square > 0.0:
            for i in range(3):
                for j in range(3):
                    out[i, j] += line[b, 1 + i] * line[b, 1 + j] * share[b] / square


def informations(
    poses: Floats,
    cast: CastTables | MeshRays,
    noise: BeamNoise,
    out: Floats,
    share: Floats = NOBODY,
    echoes: Floats = NOTHING,
) -> None:
    """Write the information of a scan at each pose, and what its echoes alone tell.

    Args:
        poses: Shape (N, 3), metres and radians.
        cast: Rays of the beams.
        noise: Noise of the beams.
        out: Written: the Fisher information, shape (N, 3, 3).
        share: Shares of the beams in `echoes`, shape (B,); empty to leave these out.
        echoes: Written: sums of share n n^T over the beams with an echo, shape (N, 3, 3), n the
            derivatives by x, y (1) and theta (m) of how far the surface is from the beam's end,
            along the surface's normal.
    """
    if not isinstance(cast, MeshRays):
        run_rows(_informations, len(poses), poses, cast, noise, out, share, echoes, least=16)
        return
    step = max(RAYS_AT_ONCE // len(cast.incidence), 1)
    for low in range(0, len(poses), step):
        part = slice(low, low + step)
        distance, face = cast.cast(poses[part])
        run_rows(
            _informations_of_hits, len(distance), poses[part, 2].copy(), cast.tables, noise,
            distance, face, out[part], share, echoes[part], least=16,
        )  # fmt: skip


def ray_caster(
    environment: Environment, scanner: RangeScanner, beams: Ints
) -> CastTables | MeshRays:
    """Return what casts the rays of some beams, which are renumbered from 0, in any building.

    Raises:
        InputError: the building and the beams do not go together (`casting.scans.check_rays`).
    """
    if isinstance(environment.space, Mesh):
        return mesh_rays(environment, environment.space, scanner, beams)
    return cast_tables(environment, scanner, beams)
