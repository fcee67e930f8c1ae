"""Return of each beam at each pose, with its derivative: the input of the ambiguity kernel."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.intensity_returns import intensity_returns
from ambinav.casting.added import AddedWalls
from ambinav.casting.scans import check_rays, scan_rays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, REFLECTOR
from ambinav.localization.casting import echo_normal
from ambinav.runtime.array_types import Bytes, Floats, Floats32, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.rays import RayTable
from ambinav.sensing.scanner import RangeScanner

# A beam is followed this far beyond its maximum range, metres: a surface just out of range is
# about to come into range, and the derivative says when.
BEYOND = 1.0
# An offset that moves a beam at the maximum range by less, metres, leaves it out of range: else the
# order in which sums are rounded would decide.
TIE = 1e-9
# A range changes no faster than at this cosine of the incidence angle (87 degrees): beyond it
# the linear model of a cell would be wrong by more than it tells.
GRAZING = 0.05
# The variance of a beam that ends in unknown space and so tells nothing, square metres. Products of
# three of them must stay finite in float32.
BLIND = 1e10
# Rays cast at a time; their hits are kept in memory until they are read.
RAYS_AT_ONCE = 4_000_000
# Rays whose directions (radians) and origins (metres) differ by less are one.
SAME_RAY = 1e-9


@dataclass(frozen=True, eq=False)
class Returns:
    """Beams at N poses; the columns are the beams, padded as in `BeamTable`.

    Where `BeamTable.intensity` has beams, columns follow that hold the intensity which each of them
    reads: row 0 its mean, in the unit of the sensor's `Intensity`, rows 1 to 3 zero, row 4 half its
    variance, or `BLIND` where there is no echo. `compare` takes them for beams like the others.

    One array holds all that the kernel reads of a pose side by side.

    Attributes:
        data: float32, shape (N, 5, P). Row 0: mean reading in metres (true range and bias),
            beyond the maximum range where nothing is in range. Rows 1 to 3: its derivative by
            x, y (1) and theta (metres per radian) of the robot. Row 4: half the squared effective
            deviation s^2 = sigma^2 + delta^2 / 12 + map_std^2, square metres; `BLIND` where the
            beam ends in unknown space. At poses that are impossible (`standing`) a sensor sees
            nothing: the numbers there are finite, and mean nothing.
    """

    data: Floats32

    @property
    def range(self) -> Floats32:
        """Mean reading, shape (N, P), metres."""
        return self.data[:, 0]

    @property
    def gradient(self) -> Floats32:
        """Derivative of the range by x, y and theta, shape (N, 3, P)."""
        return self.data[:, 1:4]

    @property
    def variance(self) -> Floats32:
        """Squared effective deviation s^2, shape (N, P), square metres."""
        return 2.0 * self.data[:, 4]


def beam_returns(
    env: Environment,
    scanner: RangeScanner,
    table: BeamTable,
    x: Floats,
    y: Floats,
    theta: float,
    data: Floats32,
) -> None:
    """Cast every beam of `scanner` at the poses (x, y, theta).

    Args:
        env: The environment.
        scanner: The scanner.
        table: Its beams, tabulated.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        theta: Heading of all poses, radians.
        data: Written, float32, shape (N, 5, B): see `Returns`.
    """
    panorama_returns(env, scanner, table, x, y, np.array([theta]), data[None])


def pose_returns(
    env: Environment,
    scanner: RangeScanner,
    table: BeamTable,
    x: Floats,
    y: Floats,
    theta: Floats,
    data: Floats32,
) -> None:
    """Cast every beam of `scanner` at poses (x, y, theta) that each have a heading of their own.

    Args:
        env: The environment.
        scanner: The scanner.
        table: Its beams, tabulated.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        theta: Headings, shape (N,), radians.
        data: Written, float32, shape (N, 5, P), padding and all: see `Returns`.

    Raises:
        InputError: the building and the scanner do not go together (`check_rays`).
    """
    rays = scanner.rays(env.space is not None)
    check_rays(env, rays.height, rays.elevation)
    which = np.arange(len(rays))[None]
    surfaces = env.surface_normals, env.surface_kind
    step = max(RAYS_AT_ONCE // len(rays), 1)
    for low in range(0, len(x), step):
        part = slice(low, low + step)
        hits = scan_rays(
            env, x[part], y[part], theta[part], rays.origin, rays.angle,
            scanner.max_range + BEYOND, height=rays.height, elevation=rays.elevation,
            incidence=rays.specular,
        )  # fmt: skip
        headings = np.ascontiguousarray(theta[part])
        _write(
            _pose_returns, hits, which, surfaces, scanner, rays, rays.angle, headings, table,
            data[None], low,
        )  # fmt: skip


def panorama_returns(
    env: Environment,
    scanner: RangeScanner,
    table: BeamTable,
    x: Floats,
    y: Floats,
    headings: Floats,
    data: Floats32,
    first: int = 0,
    added: AddedWalls | None = None,
) -> None:
    """Cast every beam of `scanner` at the poses (x, y) at each of the headings.

    All headings are windows of one panorama: a ray that several of them share is cast once, and
    rays from one point walk the building together.

    With u the direction of a ray, whose horizontal part turns with the robot, and n the normal of
    what it meets, a range changes with the pose by -n_x / (n . u) and -n_y / (n . u), and with the
    heading by -d (n_y u_x - n_x u_y) / (n . u), and by what the sensor itself moves.

    Args:
        env: The environment.
        scanner: The scanner.
        table: Its beams, tabulated.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        headings: Shape (H,), radians.
        data: Written, float32, shape (H, first + N, 5, P) or more, padding and all: see `Returns`.
        first: Row of the first pose.
        added: Walls that stand in the building besides its own.

    Raises:
        InputError: the building and the scanner do not go together (`check_rays`).
    """
    rays = scanner.rays(env.space is not None)
    # A copy can be written to: the kernel would be compiled anew for a stored map's coordinates.
    headings = np.array(headings)
    angle = headings[:, None] + rays.angle
    # In the frame of the robot at the first heading.
    turn = headings - headings[0]
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    ox, oy = rays.origin.T
    cast = np.stack([turn[:, None] + rays.angle, c * ox - s * oy, s * ox + c * oy], axis=-1)
    if env.space is not None:
        # Only in space are rays that differ only in height distinct.
        up = np.column_stack([rays.height, rays.elevation])
        cast = np.concatenate([cast, np.broadcast_to(up, (*turn.shape, *up.shape))], axis=-1)
    cast = cast.reshape(len(headings) * len(rays), -1)
    which = np.arange(len(cast)).reshape(angle.shape)
    if len(headings) > 1 or len(scanner.sensors) > 1:
        key = np.column_stack([cast[:, 0] % (2.0 * math.pi), cast[:, 1:]])
        _, first_same, same = np.unique(
            np.round(key / SAME_RAY), axis=0, return_index=True, return_inverse=True
        )
        cast, which = cast[first_same], same.reshape(angle.shape)
    step = max(RAYS_AT_ONCE // len(cast), 1)
    reach = scanner.max_range + BEYOND
    normals, kind = env.surface_normals, env.surface_kind
    check_rays(env, rays.height, rays.elevation)
    # A plan accepts only level rays.
    up = cast[:, 3:] if env.space is not None else np.zeros((len(cast), 2))
    if added is not None:
        first_added = len(normals)
        normals = np.concatenate([normals, added.normals[:, : normals.shape[1]]])
        kind = np.concatenate([kind, added.face_kind])
        placed = np.column_stack([cast[:, :3], up + np.array([env.floor, 0.0])])
    for low in range(0, len(x), step):
        part = slice(low, low + step)
        hits = scan_rays(
            env, x[part], y[part], np.full(len(x[part]), headings[0]), cast[:, 1:3], cast[:, 0],
            reach, height=up[:, 0], elevation=up[:, 1], incidence=rays.specular,
        )  # fmt: skip
        if added is not None:
            added.shorten(x[part], y[part], float(headings[0]), placed, reach, first_added, hits)
        _write(
            _beam_returns, hits, which, (normals, kind), scanner, rays, angle, headings, table,
            data, first + low,
        )  # fmt: skip


def _write(
    write_ranges: Callable[..., None],
    hits: tuple[Floats32, Ints32, Floats32],
    which: Ints,
    surfaces: tuple[Floats, Bytes],
    scanner: RangeScanner,
    rays: RayTable,
    angle: Floats,
    headings: Floats,
    table: BeamTable,
    data: Floats32,
    first: int,
) -> None:
    """Write what the beams return, from the hits of their rays.

    Args:
        write_ranges: Kernel that writes the ranges.
        hits: Distances, segments and angles of incidence, as `scan_rays` returns them.
        which: Ray of each heading and beam, shape (H, R).
        surfaces: Normals of all segments, and their kinds.
        scanner: The scanner.
        rays: Its rays.
        angle: Directions of the rays, radians, as `write_ranges` takes them.
        headings: As `write_ranges` takes them, radians.
        table: The scanner's beams, tabulated.
        data: Written, float32, shape (H, first + N, 5, P) or more: see `Returns`.
        first: Row of the first pose.
    """
    normals, kind = surfaces
    frontier = kind == FRONTIER
    # One table per sensor, not per beam, so that they stay in the first-level cache.
    _, by_sensor, sensor = np.unique(scanner.sensor_of_beam, return_index=True, return_inverse=True)
    count = len(hits[0])
    run_rows(
        write_ranges, count, *hits, which, normals, frontier, rays.origin, angle, rays.elevation,
        rays.edge, headings, rays.start, rays.max_incidence, table.nearest, table.limit, sensor,
        table.spread[by_sensor], table.bias[by_sensor], data, first, least=128,
    )  # fmt: skip
    if len(table.intensity):
        run_rows(
            intensity_returns, count, *hits, which, kind == REFLECTOR, frontier, rays.start,
            rays.max_incidence, table.intensity, table.surface, table.limit, first, table.beams,
            BLIND, data, least=128,
        )  # fmt: skip


@kernel
def _beam_returns(
    begin, end, distance, segment, incidence, which, normal, frontier, origin, angle, elevation,
    edge, headings, start, max_incidence, nearest, limit, sensor, spread, bias, data, first,
):  # fmt: skip
    cos_a, sin_a = np.cos(angle), np.sin(angle)
    flat, rise = np.cos(elevation), np.sin(elevation)
    # How the sensor itself moves when the robot turns.
    turn_x, turn_y = np.empty(angle.shape), np.empty(angle.shape)
    for h in range(headings.size):
        c, s = math.cos(headings[h]), math.sin(headings[h])
        for r in range(angle.shape[1]):
            turn_x[h, r] = -s * origin[r, 0] - c * origin[r, 1]
            turn_y[h, r] = c * origin[r, 0] - s * origin[r, 1]
    steps = float(spread.shape[1] - 1)
    per_metre = np.empty(nearest.size)
    for b in range(nearest.size):
        per_metre[b] = steps / limit[b]
    for p in range(begin, end):
        for h in range(headings.size):
            for b in range(nearest.size):
                best, d = -1, limit[b] + BEYOND
                blind = False
                for r in range(start[b], start[b + 1]):
                    w = which[h, r]
                    blind |= math.isnan(distance[p, w])
                    if distance[p, w] < d:
                        if incidence.size > 0 and incidence[p, w] > max_incidence[r]:
                            continue
                        d = distance[p, w]
                        best = r
                gx = gy = gt = 0.0
                if best >= 0:
                    k = segment[p, which[h, best]]
                    ux, uy = cos_a[h, best], sin_a[h, best]
                    inner = not edge[best]
                    nx, ny = echo_normal(inner, ux, uy, normal[k, 0], normal[k, 1])
                    facing = nx * ux + ny * uy
                    if rise[best] != 0.0:
                        # Of a level ray nothing may change, not even the sign of a zero.
                        ux, uy = ux * flat[best], uy * flat[best]
                        if inner:
                            nx, ny, facing = -ux, -uy, -1.0
                        else:
                            facing = nx * ux + ny * uy + normal[k, 2] * rise[best]
                    facing = math.copysign(max(abs(facing), GRAZING), facing)
                    per_facing = -1.0 / facing
                    gx, gy = nx * per_facing, ny * per_facing
                    swing = d * (ny * ux - nx * uy)
                    gt = (swing + nx * turn_x[h, best] + ny * turn_y[h, best]) * per_facing
                    blind |= frontier[k] and d < limit[b]
                if d < nearest[b]:
                    d = nearest[b]
                    gx = gy = gt = 0.0
                n, t = first + p, sensor[b]
                place = min(d * per_metre[b], steps)
                low = min(int(place), spread.shape[1] - 2)
                share = place - low
                # The scan is compared by what the sensor reads in the mean, not by the true range.
                step = bias[t, low + 1] - bias[t, low]
                stretch = 1.0 + step * per_metre[b] if d < limit[b] else 1.0
                half = spread[t, low] + (spread[t, low + 1] - spread[t, low]) * share
                data[h, n, 0, b] = d + bias[t, low] + step * share
                data[h, n, 1, b], data[h, n, 2, b] = gx * stretch, gy * stretch
                data[h, n, 3, b] = gt * stretch
                data[h, n, 4, b] = BLIND if blind else half
            for b in range(nearest.size, data.shape[3]):
                for row in range(4):
                    data[h, first + p, row, b] = 0.0
                data[h, first + p, 4, b] = 1.0


@kernel
def _pose_returns(
    begin, end, distance, segment, incidence, which, normal, frontier, origin, angle, elevation,
    edge, theta, start, max_incidence, nearest, limit, sensor, spread, bias, data, first,
):  # fmt: skip
    for p in range(begin, end):
        heading = theta[p : p + 1]
        _beam_returns(
            p, p + 1, distance, segment, incidence, which, normal, frontier, origin,
            heading.reshape(1, 1) + angle, elevation, edge, heading, start, max_incidence, nearest,
            limit, sensor, spread, bias, data, first,
        )  # fmt: skip


def blind_share(data: Floats32, begin: int, end: int, beams: int) -> Floats:
    """Return the share of the beams that end in unknown space.

    Args:
        data: What the beams return at H headings, shape (H, N, 5, P): see `Returns`.
        begin: First pose, a row of `data`.
        end: One past the last pose.
        beams: How many of the P columns are beams.

    Returns:
        float64, shape (end - begin, H).
    """
    share = np.empty((end - begin, len(data)))
    run_rows(_blind_share, len(share), data, begin, beams, share, least=512)
    return share


@kernel
def _blind_share(low, high, data, begin, beams, share):
    for i in range(low, high):
        for h in range(data.shape[0]):
            count = 0
            for b in range(beams):
                count += data[h, begin + i, 4, b] >= BLIND
            share[i, h] = count / beams
