"""A Kalman filter on the ranges themselves: what a drive knows of its pose, and what it will know.

For other kernels: `odometry.spread_motion` and `apply_motion`, then `update_pose`, are one step of
the filter.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.geometry.triangulation import PARALLEL
from ambinav.localization.casting import (
    CastTables,
    cast_tables,
    expected_ranges,
    work_space,
)
from ambinav.localization.information import (
    BeamNoise,
    as_map_std,
    as_poses,
    beam_noise,
    informations,
    linear_reading,
)
from ambinav.localization.odometry import (
    OdometryModel,
    apply_motion,
    motion_between,
    spread_motion,
    wrapped,
)
from ambinav.sensing.fields import as_count, as_number
from ambinav.sensing.scanner import RangeScanner

Floats = NDArray[np.float64]

# Steps of the iterated update.
ROUNDS = 4


class ExtendedKalmanFilter:
    """Pose tracking by an extended Kalman filter on the ranges, for any number of runs at once.

    It needs to know about where it starts, and holds one place for true: a reference for what a
    localizer can know, and a prediction of it, rather than a localizer for lost robots.

    Args:
        environment: The map that the robot has.
        scanner: Its scanner.
        odometry: How odometry errs; None: AMCL's defaults.
        runs: How many robots are localized side by side.
        map_std: As in `information.scan_information`.
        gate: Beams that are off by more than so many standard deviations of what is expected
            (pose uncertainty included) are left out: people, open doors.

    Raises:
        InputError: an argument cannot be used.
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        odometry: OdometryModel | None = None,
        *,
        runs: int = 1,
        map_std: float | None = None,
        gate: float = 3.0,
    ) -> None:
        self.scanner = scanner
        self.odometry = OdometryModel() if odometry is None else odometry
        self.runs = as_count(runs, "runs")
        self.gate = as_number(gate, "gate")
        if self.gate <= 0.0:
            raise InputError(f"gate is {gate}; give standard deviations above 0.")
        self.cast: CastTables = cast_tables(environment, scanner, np.arange(scanner.beams))
        self.noise: BeamNoise = beam_noise(environment, scanner, as_map_std(environment, map_std))
        self._mean = np.full((self.runs, 3), np.nan)
        self._covariance = np.full((self.runs, 3, 3), np.nan)
        self._odometry: Floats | None = None

    def start(self, poses: ArrayLike, covariance: ArrayLike) -> None:
        """Begin at poses (R, 3) or (3,), known up to a covariance (3, 3) or (R, 3, 3)."""
        mean, cov = np.asarray(poses, dtype=float), np.asarray(covariance, dtype=float)
        for values, name, shape in ((mean, "poses", (3,)), (cov, "covariance", (3, 3))):
            if values.shape not in (shape, (self.runs, *shape)) or not np.isfinite(values).all():
                raise InputError(
                    f"{name}: the shape is {values.shape}; give finite numbers of shape "
                    f"{(self.runs, *shape)} for {self.runs} runs."
                )
        self._mean[:] = mean
        self._covariance[:] = cov
        self._odometry = None

    def update(self, odometry: ArrayLike, ranges: ArrayLike) -> NDArray[np.int64]:
        """Move on to an odometry pose and take in the scan made there.

        Args:
            odometry: Poses in the odometry frame, shape (R, 3), or (3,) for one run.
            ranges: Readings, shape (R, B), or (B,) for one run: inf no echo, -inf too near, nan
                no reading.

        Returns:
            How many beams each run has used, shape (R,).

        Raises:
            InputError: a shape does not fit, a pose is not finite, or the filter is not started.
        """
        if np.isnan(self._mean).any():
            raise InputError("the filter has no pose; call start first.")
        now = as_poses(odometry, "odometry")
        readings = np.atleast_2d(np.asarray(ranges, dtype=np.float64))
        if now.shape != (self.runs, 3) or readings.shape != (self.runs, self.scanner.beams):
            raise InputError(
                f"odometry and ranges have the shapes {now.shape} and {readings.shape}; give "
                f"{(self.runs, 3)} and {(self.runs, self.scanner.beams)}."
            )
        before = now if self._odometry is None else self._odometry
        used = np.empty(self.runs, dtype=np.int64)
        _steps(
            self._mean, self._covariance, before, now, np.ascontiguousarray(readings),
            self.odometry.array, self.gate, self.cast, self.noise, used,
        )  # fmt: skip
        self._odometry = now.copy()
        return used

    @property
    def mean(self) -> Floats:
        """Estimated pose of each run, shape (R, 3), metres and radians, map frame."""
        return self._mean.copy()

    @property
    def covariance(self) -> Floats:
        """Its covariance, shape (R, 3, 3)."""
        return self._covariance.copy()

    def predicted_covariances(
        self, poses: ArrayLike, covariance: ArrayLike, seen: ArrayLike | None = None
    ) -> Floats:
        """Covariances along a route, before it is driven.

        Args:
            poses: Along the route, shape (N, 3), as far apart as the scans.
            covariance: At the first of them, before its scan, shape (3, 3).
            seen: At which poses a scan is made, bool, shape (N,); None: at all.

        Returns:
            Shape (N, 3, 3), after the scan of each pose; the runs play no part in it.

        Raises:
            InputError: a shape does not fit, or a pose is not finite.
        """
        rows = as_poses(poses, "poses")
        first = np.asarray(covariance, dtype=np.float64)
        looks = np.ones(len(rows), dtype=np.bool_) if seen is None else np.asarray(seen, dtype=bool)
        if first.shape != (3, 3) or looks.shape != (len(rows),):
            raise InputError(
                f"covariance and seen have the shapes {first.shape} and {looks.shape}; give (3, 3) "
                f"and ({len(rows)},)."
            )
        told = np.empty((len(rows), 3, 3))
        informations(rows, self.cast, self.noise, told)
        told[~looks] = 0.0
        out = np.empty_like(told)
        _foretell(rows, first, told, self.odometry.array, out)
        return out


# Rows of `Scratch.beam`: what is read, what is expected, its derivatives by x, y and theta, its
# variance and one over that; normal of the wall, and where that is along it; direction and place
# of the ray in the robot's frame, and its range.
(
    _READ, _LINE, _BY_X, _BY_Y, _BY_T, _VARIANCE, _WEIGHT, _NORMAL_X, _NORMAL_Y, _WALL,
    _COSINE, _SINE, _START_X, _START_Y, _RANGE,
) = range(15)  # fmt: skip
_ROWS = 15


class Scratch(NamedTuple):
    """Arrays that `update_pose` works in.

    Attributes:
        ranges: Expected ranges, shape (B,).
        ray: Which ray each of them is of, int32, shape (B,).
        edge: Which border edge it meets, int32, shape (B,).
        chosen: Numbers of the beams that tell something, int32, shape (B,).
        beam: Of the beams that tell something, one after the other; rows as above, shape
            (rows, B).
        noise: For who simulates the readings, shape (B,).
        told: Information of a scan, shape (3, 3).
        spread: Covariance after it, shape (3, 3).
        cast: See `casting.work_space`.
    """

    ranges: Floats
    ray: NDArray[np.int32]
    edge: NDArray[np.int32]
    chosen: NDArray[np.int32]
    beam: Floats
    noise: Floats
    told: Floats
    spread: Floats
    cast: tuple[Any, ...]


@njit(cache=True, nogil=True, error_model="numpy")
def scratch_for(beams, rays):
    """`Scratch` for scans of so many beams and rays."""
    return Scratch(
        np.empty(beams), np.empty(beams, dtype=np.int32), np.empty(beams, dtype=np.int32),
        np.empty(beams, dtype=np.int32),
        np.empty((_ROWS, beams)), np.empty(beams), np.empty((3, 3)), np.empty((3, 3)),
        work_space(rays),
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _over(value, pivot):
    """A quotient, 0 where the pivot is: a covariance may know something exactly."""
    return value / pivot if pivot > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def posterior(cov, told):
    """Replace a covariance P by (P^-1 + told)^-1; P may be singular.

    With P = L L^T and R R^T = I + L^T told L it is G G^T, G = L R^-T: symmetric, without negative
    variances, and as exact as P and told are. (30 times as fast as numpy.linalg.inv.)
    """
    if told[0, 0] == 0.0 and told[1, 1] == 0.0 and told[2, 2] == 0.0:
        # Nothing is told, and nothing is changed: not by rounding either.
        return
    # L, a lower triangle.
    a = math.sqrt(max(cov[0, 0], 0.0))
    b, d = _over(cov[1, 0], a), _over(cov[2, 0], a)
    c = math.sqrt(max(cov[1, 1] - b * b, 0.0))
    e = _over(cov[2, 1] - d * b, c)
    f = math.sqrt(max(cov[2, 2] - d * d - e * e, 0.0))
    # told L, then the lower triangle of I + L^T told L.
    p0 = told[0, 0] * a + told[0, 1] * b + told[0, 2] * d
    p1 = told[1, 0] * a + told[1, 1] * b + told[1, 2] * d
    p2 = told[2, 0] * a + told[2, 1] * b + told[2, 2] * d
    q1 = told[1, 1] * c + told[1, 2] * e
    q2 = told[2, 1] * c + told[2, 2] * e
    s22 = told[2, 2] * f
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def update_pose(mean, cov, reading, gate, rounds, recast, cast, noise, scratch):
    """Take one scan into an estimate (3,) and its covariance (3, 3), in place.

    The update is iterated (Bell & Cathey 1993, "The iterated Kalman filter update as a
    Gauss-Newton method"): ranges to slanted walls and past corners are not linear over a few
    centimetres, and one step would be surer of itself than it may be.

    Args:
        mean: x, y, theta, written.
        cov: Written.
        reading: Of each beam, shape (B,), metres; inf no echo, -inf too near, nan none.
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
    ranges, ray, edge, chosen, beam, _, told, spread, work = scratch
    x, y, t = mean[0], mean[1], mean[2]
    ax, ay, at = x, y, t
    # Of the pose about which the ranges are linear.
    xx, yy, tt = cov[0, 0], cov[1, 1], cov[2, 2]
    xy, xt, yt = 2.0 * cov[0, 1], 2.0 * cov[0, 2], 2.0 * cov[1, 2]
    count = used = 0
    for step in range(rounds):
        if step == 0 or recast:
            expected_ranges(ax, ay, at, cast, work, ranges, ray, edge)
            count = _take_in(at, reading, cast, noise, ranges, ray, edge, chosen, beam)
        used, txx, tyy, ttt, txy, txt, tyt, px, py, pt = _sums(
            ax, ay, at, ax - x, ay - y, wrapped(at - t), xx, yy, tt, xy, xt, yt, gate,
            step == 0 or recast, beam, count,
        )  # fmt: skip
        told[0, 0], told[1, 1], told[2, 2] = txx, tyy, ttt
        told[0, 1], told[0, 2], told[1, 2] = txy, txt, tyt
        told[1, 0], told[2, 0], told[2, 1] = txy, txt, tyt
        for i in range(3):
            for j in range(3):
                spread[i, j] = cov[i, j]
        posterior(spread, told)
        ax = x + spread[0, 0] * px + spread[0, 1] * py + spread[0, 2] * pt
        ay = y + spread[1, 0] * px + spread[1, 1] * py + spread[1, 2] * pt
        at = wrapped(t + spread[2, 0] * px + spread[2, 1] * py + spread[2, 2] * pt)
        xx, yy, tt = spread[0, 0], spread[1, 1], spread[2, 2]
        xy, xt, yt = 2.0 * spread[0, 1], 2.0 * spread[0, 2], 2.0 * spread[1, 2]
    mean[0], mean[1], mean[2] = ax, ay, at
    for i in range(3):
        for j in range(3):
            cov[i, j] = spread[i, j]
    return used


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _take_in(theta, reading, cast, noise, ranges, ray, edge, chosen, beam):
    """Write the beams that tell something, as they were met, to `beam`; how many."""
    co, si = math.cos(theta), math.sin(theta)
    count = 0
    for b in range(ranges.size):
        # Chosen without a branch, which the processor would guess wrong every other time.
        told = (ray[b] >= 0) & (ranges[b] > noise.near[b]) & math.isfinite(reading[b])
        chosen[count] = b
        count += told & (not noise.frontier[edge[b]])
    for m in range(count):
        # Without a sign, numba need not ask at each access whether an index counts from the end.
        b = np.uint64(chosen[m])
        j, k, d = np.uint64(ray[b]), np.uint64(edge[b]), ranges[b]
        line, gx, gy, gt, variance = linear_reading(d, b, j, k, co, si, cast, noise)
        beam[_READ, m], beam[_LINE, m], beam[_RANGE, m] = reading[b], line, d
        beam[_BY_X, m], beam[_BY_Y, m], beam[_BY_T, m] = gx, gy, gt
        beam[_VARIANCE, m], beam[_WEIGHT, m] = variance, 1.0 / variance
        nx, ny = cast.normal[k, 0], cast.normal[k, 1]
        beam[_NORMAL_X, m], beam[_NORMAL_Y, m] = nx, ny
        beam[_WALL, m] = nx * cast.border[k, 0] + ny * cast.border[k, 1]
        beam[_COSINE, m], beam[_SINE, m] = cast.cosine[j], cast.sine[j]
        beam[_START_X, m], beam[_START_Y, m] = cast.start[j, 0], cast.start[j, 1]
    return count


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True, fastmath={"reassoc"})
def _sums(x, y, theta, bx, by, bt, xx, yy, tt, xy, xt, yt, gate, met, beam, count):
    """What the beams tell at a pose: how many are used, their information, and what they are off.

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
            facing = nx * ux + ny * uy
            further = (beam[_WALL, m] - nx * sx - ny * sy) / facing - beam[_RANGE, m]
            # A ray along the wall stays as it was.
            off -= further if abs(facing) > PARALLEL else 0.0
        gx, gy, gt = beam[_BY_X, m], beam[_BY_Y, m], beam[_BY_T, m]
        expected = gx * (gx * xx + gy * xy + gt * xt) + gy * (gy * yy + gt * yt)
        expected += beam[_VARIANCE, m] + gt * gt * tt
        # A beam that is left out weighs nothing: a branch would make it one beam at a time.
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


@njit(cache=True, nogil=True, error_model="numpy")
def _steps(mean, cov, before, now, readings, alpha, gate, cast, noise, used):
    scratch = scratch_for(noise.far.size, cast.cosine.size)
    for r in range(mean.shape[0]):
        rot1, trans, rot2 = motion_between(
            before[r, 0], before[r, 1], before[r, 2], now[r, 0], now[r, 1], now[r, 2]
        )
        spread_motion(cov[r], mean[r, 2], rot1, trans, rot2, alpha)
        mean[r, 0], mean[r, 1], mean[r, 2] = apply_motion(
            mean[r, 0], mean[r, 1], mean[r, 2], rot1, trans, rot2
        )
        used[r] = update_pose(
            mean[r], cov[r], readings[r], gate, ROUNDS, True, cast, noise, scratch
        )


@njit(cache=True, nogil=True, error_model="numpy")
def _foretell(poses, first, told, alpha, out):
    cov = first.copy()
    for k in range(poses.shape[0]):
        if k > 0:
            rot1, trans, rot2 = motion_between(
                poses[k - 1, 0], poses[k - 1, 1], poses[k - 1, 2],
                poses[k, 0], poses[k, 1], poses[k, 2],
            )  # fmt: skip
            spread_motion(cov, poses[k - 1, 2], rot1, trans, rot2, alpha)
        posterior(cov, told[k])
        out[k] = cov
