"""Error that remains when a scan is used to recover a small known displacement.

Our own, after an idea of K. Chai, L. Xu, Q. Wang, C. Xu, P. Yin and F. Gao, "LF-3PM: a LiDAR-based
framework for perception-aware planning with perturbation-induced metric", IROS 2024 (arXiv
2408.01649), of which only the abstract was at hand: an observation is judged by what a perturbation
of the pose does to it, before anything is planned. Metric and matcher are not theirs.

The robot stands at p, its estimated pose is p + delta. Its scan is matched against the building by
Gauss-Newton steps for x, y and the heading. Each is linearised at the estimate itself: the ranges
d and their derivatives J are cast there, and the step solves

    (J^T W J / tau + P^-1) step = J^T W (d(p) - d) / tau + P^-1 (p + delta - estimate),

P what was known beforehand: |delta| in x and y, sigma_theta in the heading. W is 1 / variance of
sensor, bin and map; beams that disagree by more than their noise and the last step explain (they
meet another surface than at p) are weighted down as in the kernel. A beam without an echo at p has
no point to match, nor has one that ends in unknown space at either pose; at the estimate a beam is
followed beyond the sensor's maximum range, for the wall is on the map. What a cone's echo tells is
as everywhere (`casting.echo_normal`). Nothing here depends on the
map's lattice but which poses have a value.

What is left of delta is the error. With the errors e1, e2 of two displacements at right angles,
averaged over both signs of each, E = e1 e1^T + e2 e2^T does not depend on how the two are turned as
long as the matching is linear; the roots of its eigenvalues are the layer, the error of the worst
displacement, and `perturbation_minor`, that of the best, metres; the axis of the first is
`perturbation_direction`. There is no noise in the scan: it only decides how much the scan is worth
against P. With nothing in range both are |delta|; by default that is R / 2, the deviation of a
place anywhere within the map's radius R, so that layers in metres agree where a scan tells nothing.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.ambiguity.gaussian import invert
from ambinav.ambiguity.returns import BEYOND
from ambinav.casting.plane.fan import scan_plan
from ambinav.config import as_count, as_number, as_positive
from ambinav.geometry.principal_axes import principal_axes
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.localization.casting import (
    CastTables,
    cast_tables,
    echo_normal,
    expected_ranges,
    vertical_part,
    work_space,
)
from ambinav.localization.information import beam_noise, gradient, sensor_line
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

ITERATIONS = 6
# The match is looked for within so many displacements of the estimated pose.
WINDOW = 2.0
# A step shorter than this share of what was known beforehand ends the match.
CONVERGED = 1e-3
# A step into a wall is halved so often before the match ends where it stands.
HALVINGS = 6
# Where the displacements lead, and the angles of rays in these directions.
AXES: Floats = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
ANGLES: Floats = np.arange(4, dtype=np.float64) * (math.pi / 2)
# Poses are rounded to so many decimals of a metre: lattices of several spacings give the same pose
# with other last bits, and a beam that runs along a wall or into a corner would tell them apart.
DECIMALS = 9
# Rays cast between two looks at the keyboard, a second or two.
RAYS_AT_ONCE = 20_000_000


def perturbation(
    context: LayerContext,
    *,
    displacement: float | None = None,
    iterations: int = ITERATIONS,
    tau: float = 1.0,
) -> dict[str, Floats32]:
    """Compute the error of a known displacement that remains after scan matching.

    Args:
        context: What the map was made of.
        displacement: How far off the estimated pose is, metres; None: half the radius of the
            map's neighbourhood.
        iterations: Gauss-Newton steps at most, at least 1.
        tau: How many beams carry one independent piece of evidence, at least 1.

    Returns:
        perturbation and perturbation_minor (metres) and perturbation_direction (radians).

    Raises:
        InputError: a number is out of its range; or the building is a mesh (`cast_tables`).
    """
    size = context.radius / 2 if displacement is None else displacement
    size = as_positive(size, "displacement", "metres")
    iterations = as_count(iterations, "iterations")
    tau = as_number(tau, "tau")
    if tau < 1.0:
        raise InputError(f"tau is {tau}; give at least 1.")
    beams = context.scanner.beams
    cast = cast_tables(context.environment, context.scanner, np.arange(beams))
    farther = _farther(cast)
    noise = beam_noise(context.environment, context.scanner, context.map_std)
    inverse_cap = context.table.inverse_cap[:beams].astype(np.float64)
    free = free_lengths(context, size)
    tensor = np.zeros((len(context.headings), 3, len(context.points[0])))
    rows_at_once = max(RAYS_AT_ONCE // (4 * ITERATIONS * len(cast.cosine)), 1)
    for h in range(len(context.headings)):
        rows = np.flatnonzero(context.possible[:, h])
        poses = context.poses(h).round(DECIMALS)
        for low in range(0, len(rows), rows_at_once):
            part = rows[low : low + rows_at_once]
            run_rows(
                _errors, len(part), part, poses, free, cast, farther, noise, inverse_cap, size,
                context.model.sigma_theta, tau, iterations, tensor[h], least=16,
            )  # fmt: skip
    major, minor, direction = map(
        context.spread, principal_axes(*np.ascontiguousarray(tensor.transpose(1, 2, 0)))
    )
    return {"perturbation": major, "perturbation_minor": minor, "perturbation_direction": direction}


def free_lengths(context: LayerContext, size: float) -> Floats32:
    """Return the distance to a segment along each of `AXES`, (P, 4), metres; inf beyond `size`."""
    x, y, _ = context.poses().round(DECIMALS).T
    distance, _, _ = scan_plan(
        context.environment, x, y, np.zeros_like(x), np.zeros((4, 2)), ANGLES, size, incidence=False
    )
    return distance


def _farther(cast: CastTables) -> CastTables:
    """Return the same beams, followed `BEYOND` their maximum range."""
    space = cast.space
    if space is not None:
        space = space._replace(reach=space.reach + BEYOND)
    return cast._replace(limit=cast.limit + BEYOND, reach=cast.reach + BEYOND, space=space)


@kernel
def lines_at(x, y, theta, cast, frontier, work, ranges, ray, edge, line):
    """Cast the beams at a pose.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        theta: Radians.
        cast: See `casting.CastTables`; all beams.
        frontier: Which border edges are the frontier to unknown space, (K,).
        work: See `casting.work_space`.
        ranges: Written, (B,), metres; see `casting.expected_ranges`.
        ray: Work space, int32, (B,).
        edge: Work space, int32, (B,).
        line: Written, (B, 4): range (metres; inf where the beam meets no wall), and its
            derivatives by x, y (1) and theta (metres per radian).

    Returns:
        Whether all sensors are in the free space; if not, `line` means nothing.
    """
    expected_ranges(x, y, theta, cast, work, ranges, ray, edge)
    co, si = math.cos(theta), math.sin(theta)
    in_space = cast.tilt.size > 0
    for b in range(ranges.size):
        if math.isnan(ranges[b]):
            return False
        j, k = ray[b], edge[b]
        line[b, 0] = math.inf
        if j < 0 or frontier[k]:
            continue
        line[b, 0] = ranges[b]
        bx, by = cast.cosine[j], cast.sine[j]
        ux, uy = co * bx - si * by, si * bx + co * by
        nx, ny = echo_normal(cast.inner[j], ux, uy, cast.normal[k, 0], cast.normal[k, 1])
        vertical = 0.0
        if in_space:
            vertical = vertical_part(cast.inner[j], ux, uy, cast.up[j], cast.tilt[k])
        line[b, 1], line[b, 2], line[b, 3] = gradient(
            ranges[b], 0.0, co, si, bx, by, cast.start[j, 0], cast.start[j, 1], nx, ny,
            vertical,
        )  # fmt: skip
    return True


@kernel
def gauss_newton(scan, line, inverse_cap, off_x, off_y, off_theta, prior, room, tau):
    """Compute one step from the estimate that `line` was cast at.

    Args:
        scan: Range (metres) and inverse variance (0: no point to match) at the true pose, (B, 2).
        line: See `lines_at`.
        inverse_cap: Inverse of the most evidence that each beam can give, (B,).
        off_x: The believed pose less the estimate, metres.
        off_y: Likewise.
        off_theta: Likewise, radians.
        prior: Inverse variances in x and y, and in theta.
        room: Variances of the estimate in x and y, and in theta: a beam that disagrees no more
            than these can make it is not weighted down.
        tau: Beams per independent piece of evidence.

    Returns:
        x, y (metres) and theta (radians).
    """
    g0 = g1 = g2 = a = b = c = d = e = f = 0.0
    for i in range(scan.shape[0]):
        if not (scan[i, 1] > 0.0 and line[i, 0] < math.inf):
            continue
        gx, gy, gt, inverse = line[i, 1], line[i, 2], line[i, 3], scan[i, 1]
        r = scan[i, 0] - line[i, 0]
        wide = (gx * gx + gy * gy) * room[0] + gt * gt * room[1]
        u = 0.5 * r * r * inverse / (1.0 + wide * inverse)
        t = 1.0 / (1.0 + u * inverse_cap[i])
        w = inverse * t * t
        g0 += w * r * gx
        g1 += w * r * gy
        g2 += w * r * gt
        a += w * gx * gx
        b += w * gx * gy
        c += w * gx * gt
        d += w * gy * gy
        e += w * gy * gt
        f += w * gt * gt
    s = 1.0 / tau
    i00, i01, i02, i11, i12, i22, _ = invert(
        a * s + prior[0], b * s, c * s, d * s + prior[0], e * s, f * s + prior[1]
    )
    h0, h1 = g0 * s + prior[0] * off_x, g1 * s + prior[0] * off_y
    h2 = g2 * s + prior[1] * off_theta
    return (
        i00 * h0 + i01 * h1 + i02 * h2,
        i01 * h0 + i11 * h1 + i12 * h2,
        i02 * h0 + i12 * h1 + i22 * h2,
    )


@kernel
def error_left(
    px, py, ptheta, axis, free, scan, farther, frontier, inverse_cap, size, sigma, tau, iterations,
    work, ranges, ray, edge, line,
):  # fmt: skip
    """Return what a match leaves of the displacement `size` along `axis`, x and y, metres."""
    believed_x, believed_y = px + size * axis[0], py + size * axis[1]
    # The estimate cannot lie behind a wall: then halve the displacement until it is free.
    share = 1.0
    for _ in range(HALVINGS):
        x, y, theta = px + share * size * axis[0], py + share * size * axis[1], ptheta
        if share * size < free and lines_at(
            x, y, theta, farther, frontier, work, ranges, ray, edge, line
        ):
            break
        share /= 2.0
    else:
        x, y = px, py
        lines_at(x, y, theta, farther, frontier, work, ranges, ray, edge, line)
    prior = (1.0 / (size * size), 1.0 / (sigma * sigma))
    room = (size * size, sigma * sigma)
    for _ in range(iterations):
        dx, dy, dtheta = gauss_newton(
            scan, line, inverse_cap, believed_x - x, believed_y - y, ptheta - theta, prior, room,
            tau,
        )  # fmt: skip
        strayed = math.hypot(x + dx - believed_x, y + dy - believed_y) / (WINDOW * size)
        if strayed > 1.0:
            dx = believed_x + (x + dx - believed_x) / strayed - x
            dy = believed_y + (y + dy - believed_y) / strayed - y
        if math.hypot(dx, dy) / size + abs(dtheta) / sigma < CONVERGED:
            return x + dx - px, y + dy - py
        share = 1.0
        for _ in range(HALVINGS):
            if lines_at(
                x + share * dx, y + share * dy, theta + share * dtheta, farther, frontier, work,
                ranges, ray, edge, line,
            ):  # fmt: skip
                break
            share /= 2.0
        else:
            break
        dx, dy, dtheta = share * dx, share * dy, share * dtheta
        x, y, theta = x + dx, y + dy, theta + dtheta
        room = (dx * dx + dy * dy, dtheta * dtheta)
    return x - px, y - py


@kernel
def _errors(
    low, high, rows, poses, free, cast, farther, noise, inverse_cap, size, sigma, tau, iterations,
    out,
):  # fmt: skip
    beams = noise.far.size
    work = work_space(cast.cosine.size)
    ranges, line, scan = np.empty(beams), np.empty((beams, 4)), np.empty((beams, 2))
    ray, edge = np.empty(beams, dtype=np.int32), np.empty(beams, dtype=np.int32)
    for i in range(low, high):
        p = rows[i]
        px, py, ptheta = poses[p, 0], poses[p, 1], poses[p, 2]
        expected_ranges(px, py, ptheta, cast, work, ranges, ray, edge)
        for b in range(beams):
            scan[b, 0], scan[b, 1] = ranges[b], 0.0
            if ray[b] >= 0 and ranges[b] > noise.near[b] and not noise.frontier[edge[b]]:
                _, _, variance = sensor_line(ranges[b], b, noise)
                scan[b, 1] = 1.0 / variance
        xx, xy, yy = 0.0, 0.0, 0.0
        for k in range(4):
            x, y = error_left(
                px, py, ptheta, AXES[k], free[p, k], scan, farther, noise.frontier, inverse_cap,
                size, sigma, tau, iterations, work, ranges, ray, edge, line,
            )  # fmt: skip
            xx, xy, yy = xx + 0.5 * x * x, xy + 0.5 * x * y, yy + 0.5 * y * y
        out[0, p], out[1, p], out[2, p] = xx, xy, yy


LAYER = Layer(
    name="perturbation",
    title="error left of a small displacement, worst direction",
    unit="m",
    source="own, after the idea of Chai et al. 2024, LF-3PM (IROS): docs/layers.md",
    worse="high",
    compute=perturbation,
    in_space=True,
    prisms_alone=True,
    companions={
        "perturbation_minor": ("error left of a small displacement, best direction", "m"),
        "perturbation_direction": ("axis of the worst error left of a small displacement", "rad"),
    },
)
