"""Kernels of the Kalman filter: update of an estimate and its covariance by a scan."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ambinav.casting.plane.triangulation import PARALLEL
from ambinav.localization.casting import (
    cast_observed,
    echo_normal,
    nearest_echoes,
    spread_observed,
    vertical_part,
    work_space,
)
from ambinav.localization.information import gradient, sensor_line
from ambinav.localization.odometry import wrapped
from ambinav.runtime.array_types import Floats, Ints32
from ambinav.runtime.kernels import kernel

# Rows of `Scratch.beam`: what is read, what is expected, its derivatives by x, y and theta, its
# variance and one over that; normal of the wall, and where that is along it; direction and place
# of the ray in the robot's frame, its range, and how the sensor's bias grows with that; see
# `casting.vertical_part`.
(
    _READ, _LINE, _BY_X, _BY_Y, _BY_T, _VARIANCE, _WEIGHT, _NORMAL_X, _NORMAL_Y, _WALL,
    _COSINE, _SINE, _START_X, _START_Y, _RANGE, _RISE, _VERTICAL,
) = range(17)  # fmt: skip
_ROWS = 17


class Scratch(NamedTuple):
    """Work arrays of `update_pose`.

    Attributes:
        ranges: Expected ranges, shape (B,).
        ray: Which ray each of them is of, int32, shape (B,).
        edge: Which border edge it meets, int32, shape (B,).
        picked: Which rays were cast, int32, shape (R,).
        beam: Values of the beams that tell something, one after the other; rows as above, shape
            (rows, B).
        noise: For who simulates the readings, shape (B,).
        information: Information of a scan, shape (3, 3).
        about: Pose about which ranges are linear, shape (3,).
        spread: Covariance after it, shape (3, 3).
        cast: See `casting.work_space`.
    """

    ranges: Floats
    ray: Ints32
    edge: Ints32
    picked: Ints32
    beam: Floats
    noise: Floats
    information: Floats
    about: Floats
    spread: Floats
    cast: tuple[Any, ...]


@kernel
def scratch_for(beams, rays):
    """Return `Scratch` for scans with given numbers of beams and rays."""
    return Scratch(
        np.empty(beams), np.empty(beams, dtype=np.int32), np.empty(beams, dtype=np.int32),
        np.empty(rays, dtype=np.int32),
        np.zeros((_ROWS, beams)), np.empty(beams), np.empty((3, 3)), np.empty(3),
        np.empty((3, 3)), work_space(rays),
    )  # fmt: skip


@kernel(inline="always")
def _over(value, pivot):
    """Divide, with 0 where the pivot is 0: a covariance may know something exactly."""
    return value / pivot if pivot > 0.0 else 0.0


@kernel
def posterior(cov, information):
    """Replace a covariance P by (P^-1 + F)^-1 with a scan's information F; P may be singular.

    With P = L L^T and R R^T = I + L^T F L it is G G^T, G = L R^-T: symmetric, without negative
    variances, and as exact as P and F are. (30 times as fast as numpy.linalg.inv.)
    """
    if information[0, 0] == 0.0 and information[1, 1] == 0.0 and information[2, 2] == 0.0:
        # Without information nothing is changed: not by rounding either.
        return
    # L, a lower triangle.
    a = math.sqrt(max(cov[0, 0], 0.0))
    b, d = _over(cov[1, 0], a), _over(cov[2, 0], a)
    c = math.sqrt(max(cov[1, 1] - b * b, 0.0))
    e = _over(cov[2, 1] - d * b, c)
    f = math.sqrt(max(cov[2, 2] - d * d - e * e, 0.0))
    # F L, then the lower triangle of I + L^T F L.
    p0 = information[0, 0] * a + information[0, 1] * b + information[0, 2] * d
    p1 = information[1, 0] * a + information[1, 1] * b + information[1, 2] * d
    p2 = information[2, 0] * a + information[2, 1] * b + information[2, 2] * d
    q1 = information[1, 1] * c + information[1, 2] * e
    q2 = information[2, 1] * c + information[2, 2] * e
    s22 = information[2, 2] * f
    # R, a lower triangle; the matrix is at least I.
    ra = math.sqrt(1.0 + a * p0 + b * p1 + d * p2)
    rb, rd = (c * p1 + e * p2) / ra, f * p2 / ra
    rc = math.sqrt(max(1.0 + c * q1 + e * q2 - rb * rb, 1.0))
    re = (f * q2 - rd * rb) / rc
    rf = math.sqrt(max(1.0 + f * s22 - rd * rd - re * re, 1.0))
    # The rows of G.
    x0 = a / ra
    x1 = -x0 * rb / rc
    x2 = -(x0 * rd + x1 * re) / rf
    y0 = b / ra
    y1 = (c - y0 * rb) / rc
    y2 = -(y0 * rd + y1 * re) / rf
    z0 = d / ra
    z1 = (e - z0 * rb) / rc
    z2 = (f - z0 * rd - z1 * re) / rf
    cov[0, 0] = x0 * x0 + x1 * x1 + x2 * x2
    cov[1, 1] = y0 * y0 + y1 * y1 + y2 * y2
    cov[2, 2] = z0 * z0 + z1 * z1 + z2 * z2
    cov[0, 1] = cov[1, 0] = x0 * y0 + x1 * y1 + x2 * y2
    cov[0, 2] = cov[2, 0] = x0 * z0 + x1 * z1 + x2 * z2
    cov[1, 2] = cov[2, 1] = y0 * z0 + y1 * z1 + y2 * z2


@kernel(forceinline=True)
def update_pose(mean, cov, reading, gate, rounds, recast, cast, noise, scratch):
    """Update an estimate (3,) and its covariance (3, 3) with one scan, in place.

    The update is iterated (Bell & Cathey 1993, "The iterated Kalman filter update as a
    Gauss-Newton method"): ranges to slanted walls and past corners are not linear over a few
    centimetres, and one step would be surer of itself than it may be.

    Args:
        mean: x, y, theta, written.
        cov: Written.
        reading: Reading of each beam, shape (B,), metres; inf no echo, -inf too near, nan none.
        gate: Standard deviations of the residual beyond which a beam is left out.
        rounds: Steps of the iteration, at least 1.
        recast: Whether each step casts the beams anew; if not, they stay on the lines of the
            walls that they met at the prior, with the gradients that they had there: a tenth of
            the cost, and in drives through drawn buildings errors and NEES are the same.
        cast: See `casting.CastTables`.
        noise: See `BeamNoise`.
        scratch: See `Scratch`.

    Returns:
        How many beams were used.
    """
    spread, about = scratch.spread, scratch.about
    about[0], about[1], about[2] = mean[0], mean[1], mean[2]
    for i in range(3):
        for j in range(3):
            spread[i, j] = cov[i, j]
    count = used = 0
    for step in range(rounds):
        fresh = step == 0 or recast
        if fresh:
            rays = cast_observed(
                about[0], about[1], about[2], reading, cast, scratch.cast, scratch.picked
            )
            count = tabulate(about, rays, reading, cast, noise, scratch)
        used = refine(mean, cov, about, spread, gate, fresh, count, scratch)
    mean[0], mean[1], mean[2] = about[0], about[1], about[2]
    for i in range(3):
        for j in range(3):
            cov[i, j] = spread[i, j]
    return used


@kernel(forceinline=True)
def refine(mean, cov, about, spread, gate, met, count, scratch):
    """Make one step of the iterated update.

    Args:
        mean: The prior pose.
        cov: Its covariance.
        about: Pose about which the ranges are linear; written: the better one.
        spread: Its covariance; written likewise.
        gate: As `update_pose`.
        met: As `_sums`.
        count: What `tabulate` returned.
        scratch: See `Scratch`.

    Returns:
        How many beams were used.
    """
    information = scratch.information
    used, txx, tyy, ttt, txy, txt, tyt, px, py, pt = _sums(
        about[0], about[1], about[2], about[0] - mean[0], about[1] - mean[1],
        wrapped(about[2] - mean[2]), spread[0, 0], spread[1, 1], spread[2, 2],
        2.0 * spread[0, 1], 2.0 * spread[0, 2], 2.0 * spread[1, 2], gate, met, scratch.beam, count,
    )  # fmt: skip
    information[0, 0], information[1, 1], information[2, 2] = txx, tyy, ttt
    information[0, 1], information[0, 2], information[1, 2] = txy, txt, tyt
    information[1, 0], information[2, 0], information[2, 1] = txy, txt, tyt
    for i in range(3):
        for j in range(3):
            spread[i, j] = cov[i, j]
    posterior(spread, information)
    about[0] = mean[0] + spread[0, 0] * px + spread[0, 1] * py + spread[0, 2] * pt
    about[1] = mean[1] + spread[1, 0] * px + spread[1, 1] * py + spread[1, 2] * pt
    about[2] = wrapped(mean[2] + spread[2, 0] * px + spread[2, 1] * py + spread[2, 2] * pt)
    return used


@kernel(forceinline=True)
def tabulate(pose, rays, reading, cast, noise, scratch):
    """Write the beams that read something and met something; return how many there are.

    A beam without a reading tells nothing, and with few exceptions is not cast.

    Args:
        pose: Where they were cast.
        rays: How many rays `scratch.cast` holds, see `casting.cast_observed`.
        reading: As `update_pose`, as all that follows.
        cast: See there.
        noise: See there.
        scratch: See there.
    """
    x, y, theta = pose[0], pose[1], pose[2]
    ranges, ray, edge, picked, beam = (
        scratch.ranges, scratch.ray, scratch.edge, scratch.picked, scratch.beam,
    )  # fmt: skip
    _, _, distance, hit, _ = scratch.cast
    co, si = math.cos(theta), math.sin(theta)
    count = 0
    # What is looked up first, then what is worked out: of a loop without tables the compiler takes
    # several beams at a time. A beam that tells nothing is written over by the next one: without a
    # branch, which the processor would guess wrong every other time.
    if cast.plain[0]:
        for m in range(rays):
            # Without a sign, numba need not ask at each access whether an index counts from the
            # end.
            b, k = np.uint64(picked[m]), np.uint64(max(hit[m], 0))
            d = distance[m]
            met = (d <= cast.limit[b]) & (d > noise.near[b]) & math.isfinite(reading[b])
            _look_up(count, b, b, k, d if met else 0.0, reading, cast, noise, beam)
            count += met & (not noise.frontier[k])
    else:
        in_space = cast.tilt.size > 0
        spread_observed(rays, scratch.cast, picked)
        nearest_echoes(cast, scratch.cast, ranges, ray, edge)
        for n in range(ranges.size):
            b, j, k = np.uint64(n), np.uint64(max(ray[n], 0)), np.uint64(max(edge[n], 0))
            met = (ray[n] >= 0) & (ranges[n] > noise.near[n]) & math.isfinite(reading[n])
            _look_up(count, b, j, k, ranges[n] if met else 0.0, reading, cast, noise, beam)
            if in_space:
                ux = co * cast.cosine[j] - si * cast.sine[j]
                uy = si * cast.cosine[j] + co * cast.sine[j]
                beam[_VERTICAL, count] = vertical_part(
                    cast.inner[j], ux, uy, cast.up[j], cast.tilt[k]
                )
            if cast.inner[j]:
                _across(count, x, y, co, si, beam)
            count += met & (not noise.frontier[k])
    for m in range(count):
        beam[_LINE, m] += beam[_RANGE, m]
        beam[_BY_X, m], beam[_BY_Y, m], beam[_BY_T, m] = gradient(
            beam[_RANGE, m], beam[_RISE, m], co, si, beam[_COSINE, m], beam[_SINE, m],
            beam[_START_X, m], beam[_START_Y, m], beam[_NORMAL_X, m], beam[_NORMAL_Y, m],
            beam[_VERTICAL, m],
        )  # fmt: skip
        beam[_WEIGHT, m] = 1.0 / beam[_VARIANCE, m]
    return count


@kernel(inline="always")
def _look_up(m, b, j, k, d, reading, cast, noise, beam):
    """Write the table values of beam b, whose ray j meets edge k, to column m of `Scratch.beam`."""
    beam[_READ, m], beam[_RANGE, m] = reading[b], d
    beam[_COSINE, m], beam[_SINE, m] = cast.cosine[j], cast.sine[j]
    beam[_START_X, m], beam[_START_Y, m] = cast.start[j, 0], cast.start[j, 1]
    beam[_NORMAL_X, m], beam[_NORMAL_Y, m] = cast.normal[k, 0], cast.normal[k, 1]
    beam[_WALL, m] = cast.normal[k, 2]
    beam[_LINE, m], beam[_RISE, m], beam[_VARIANCE, m] = sensor_line(d, b, noise)


@kernel(inline="always")
def _across(m, x, y, co, si, beam):
    """Treat the echo of column m as from a surface across its ray: see `casting.echo_normal`."""
    ux = co * beam[_COSINE, m] - si * beam[_SINE, m]
    uy = si * beam[_COSINE, m] + co * beam[_SINE, m]
    sx = x + co * beam[_START_X, m] - si * beam[_START_Y, m]
    sy = y + si * beam[_START_X, m] + co * beam[_START_Y, m]
    nx, ny = echo_normal(True, ux, uy, beam[_NORMAL_X, m], beam[_NORMAL_Y, m])
    beam[_NORMAL_X, m], beam[_NORMAL_Y, m] = nx, ny
    beam[_WALL, m] = nx * sx + ny * sy - beam[_RANGE, m]


@kernel(forceinline=True, fastmath={"reassoc"})
def _sums(x, y, theta, bx, by, bt, xx, yy, tt, xy, xt, yt, gate, met, beam, count):
    """Sum over the beams at a pose: the number used, their information and their residuals.

    The sums may be made in any order, so the compiler takes several beams at a time.

    Args:
        x: The pose about which the ranges are linear, map frame.
        y: The same.
        theta: The same.
        bx: How far that is from the prior, as by and bt.
        by: See there.
        bt: See there.
        xx: Its covariance, as yy and tt.
        yy: See there.
        tt: See there.
        xy: Twice its covariance, as xt and yt.
        xt: See there.
        yt: See there.
        gate: As `update_pose`.
        met: Whether that is the pose at which the beams were met. If not, each ray is moved along
            to where it meets the line of the same wall.
        beam: As `Scratch`.
        count: How many of them tell something.

    Returns:
        How many are used; information xx, yy, tt, xy, xt, yt; weighted residuals x, y, theta.
    """
    co, si = math.cos(theta), math.sin(theta)
    used = 0
    # Sums in variables of their own stay in registers, those in arrays do not.
    txx = tyy = ttt = txy = txt = tyt = px = py = pt = 0.0
    for m in range(count):
        off = beam[_READ, m] - beam[_LINE, m]
        if not met:
            sx = x + co * beam[_START_X, m] - si * beam[_START_Y, m]
            sy = y + si * beam[_START_X, m] + co * beam[_START_Y, m]
            ux = co * beam[_COSINE, m] - si * beam[_SINE, m]
            uy = si * beam[_COSINE, m] + co * beam[_SINE, m]
            nx, ny = beam[_NORMAL_X, m], beam[_NORMAL_Y, m]
            facing = nx * ux + ny * uy + beam[_VERTICAL, m]
            further = (beam[_WALL, m] - nx * sx - ny * sy) / facing - beam[_RANGE, m]
            # A ray along the wall stays as it was.
            off -= further if abs(facing) > PARALLEL else 0.0
        gx, gy, gt = beam[_BY_X, m], beam[_BY_Y, m], beam[_BY_T, m]
        expected = gx * (gx * xx + gy * xy + gt * xt) + gy * (gy * yy + gt * yt)
        expected += beam[_VARIANCE, m] + gt * gt * tt
        # A beam that is left out has weight 0: a branch would prevent vectorization.
        within = off * off <= gate * gate * expected
        used += within
        # The residual that the prior would have were the range linear from here on.
        off += gx * bx + gy * by + gt * bt
        weight = beam[_WEIGHT, m] if within else 0.0
        wx, wy, wt = gx * weight, gy * weight, gt * weight
        px, py, pt = px + wx * off, py + wy * off, pt + wt * off
        txx, txy, txt = txx + wx * gx, txy + wx * gy, txt + wx * gt
        tyy, tyt, ttt = tyy + wy * gy, tyt + wy * gt, ttt + wt * gt
    return used, txx, tyy, ttt, txy, txt, tyt, px, py, pt
