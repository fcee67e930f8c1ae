"""How badly a small known displacement is recovered from the scan.

Source: K. Chai, L. Xu, Q. Wang, C. Xu, P. Yin and F. Gao, "LF-3PM: a LiDAR-based framework for
perception-aware planning with perturbation-induced metric", IROS 2024 (arXiv 2408.01649). Only the
abstract was at hand: an observation is judged by what a perturbation of the pose does to it, cell
by cell, before anything is planned. All that follows is our own reading.

The robot stands at p and believes to be at p + delta. Its scan is matched against the building by
Gauss-Newton steps for x, y and the heading: each step stands at the cell nearest to the estimate,
takes the exact ranges d and their derivatives J there, and solves

    (J^T W J / tau + P^-1) step = J^T W (d(p) - d) / tau + P^-1 (p + delta - estimate),

P what was known beforehand: |delta| in x and y, sigma_theta in the heading. W is 1 / variance of
sensor, bin and map, with beams that do not fit (another surface than at p) weighted down as in
the kernel's first step. A beam without an echo at p has no point to match. What is left of delta
is the error. With the errors e1, e2 of two displacements at right angles, averaged over both signs
of each, E = e1 e1^T + e2 e2^T does not depend on how the two are turned as long as the matching is
linear; the roots of its eigenvalues are the layer, the error of the worst displacement, and
`perturbation_minor`, that of the best, metres; the axis of the first is `perturbation_direction`.
There is no noise in the scan: it only decides how much the scan is worth against P. With nothing
in range both are |delta|; by default that is R / 2, the deviation of a place anywhere within the
map's radius R, so that layers in metres agree where a scan tells nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.kernel import F0, F1, FAST, QUARTER, D, S, T, U, X, Y, invert
from ambinav.ambiguity.layers.bands import bands
from ambinav.ambiguity.layers.ground import Ground
from ambinav.ambiguity.layers.registry import Layer
from ambinav.ambiguity.tensor import principal_axes
from ambinav.errors import InputError
from ambinav.kernels import kernel
from ambinav.sensing.fields import as_count, as_number
from ambinav.threads import run_rows

ITERATIONS = 6
# The match is looked for within so many displacements of where the robot believes to be.
WINDOW = 2.0
# Column and row of the displacements, and the bit of `Lattice.links` that leads each way.
WAYS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
LINK = np.array([0, 2, 4, 6])


def perturbation(
    ground: Ground,
    *,
    displacement: float | None = None,
    iterations: int = ITERATIONS,
    tau: float = 1.0,
) -> dict[str, NDArray[np.float32]]:
    """Error that is left of a known displacement when the scan has been matched to the building.

    Args:
        ground: What the map was made of.
        displacement: How far off the robot believes to be, metres; None: half the radius of the
            map's neighbourhood.
        iterations: Gauss-Newton steps, at least 1.
        tau: How many beams carry one independent piece of evidence, at least 1.

    Returns:
        perturbation and perturbation_minor (metres) and perturbation_direction (radians).

    Raises:
        InputError: a number is out of its range.
    """
    size = ground.radius / 2 if displacement is None else as_number(displacement, "displacement")
    if not size > 0.0:
        raise InputError(f"displacement is {size}; give a positive number of metres.")
    iterations = as_count(iterations, "iterations")
    tau = as_number(tau, "tau")
    if tau < 1.0:
        raise InputError(f"tau is {tau}; give at least 1.")
    lattice, table, spacing = ground.lattice, ground.table, ground.spacing
    steps = round(size / spacing)
    # As many rows as the ambiguity itself needs: the casts are then shared with layers that do.
    reach = max(steps + 1, math.floor(ground.radius / spacing + 1e-9))
    found = np.empty((3, len(ground.points[0]), len(ground.headings)))
    for h in range(len(ground.headings)):
        links = ground.links(h)
        possible = np.ascontiguousarray(ground.possible[:, h])
        for band in bands(ground, reach):
            run_rows(
                _errors, band.end - band.begin, band.begin, band.first, band.last,
                lattice.rows_columns, lattice.index, links[band.first : band.last],
                possible[band.first : band.last], WAYS, LINK, steps, spacing,
                ground.returns(h, band.part).data, table.limit, table.inverse_cap, table.use, size,
                ground.model.sigma_theta, tau, iterations,
                found[:, band.begin : band.end, h], least=16,
            )  # fmt: skip
    major, minor, direction = (ground.spread(values) for values in principal_axes(*found))
    return {
        "perturbation": major,
        "perturbation_minor": minor,
        "perturbation_direction": direction,
    }


@kernel(fastmath=FAST)
def recover(data, p, m, limit, icap, use, off, prior, guess, room, tau):
    """One step: the estimate that fits the scan at p best, linearised at m.

    Args:
        data: See `Returns`, float32, (N, 5, P).
        p: The row of the true pose.
        m: The row of the pose to linearise at.
        limit: Maximum range of each beam, metres, (P,).
        icap: Inverse cap of each beam, (P,).
        use: 1 for a beam, 0 for padding, (P,).
        off: The last estimate less m: x, y (metres) and theta (radians).
        prior: Inverse variances in x and y, and in theta.
        guess: The believed pose less m: x and y.
        room: Variances of the last estimate in x and y, and in theta: a beam that disagrees no
            more than these can make it is not weighted down.
        tau: Beams per independent piece of evidence.

    Returns:
        The estimate less m: x, y, theta.
    """
    size, p, m = U(limit.size), U(p), U(m)
    g0, g1, g2 = F0, F0, F0
    a, b, c, d, e, f = F0, F0, F0, F0, F0, F0
    o0, o1, o2 = np.float32(off[0]), np.float32(off[1]), np.float32(off[2])
    r0, r2 = np.float32(0.5 * room[0]), np.float32(0.5 * room[1])
    for i in range(size):
        gx, gy, gt = data[m, X, i], data[m, Y, i], data[m, T, i]
        echo = data[p, D, i] < limit[i]
        inverse = use[i] / (data[p, S, i] + data[m, S, i]) if echo else F0
        r = data[p, D, i] - data[m, D, i]
        z = r - gx * o0 - gy * o1 - gt * o2
        wide = (gx * gx + gy * gy) * r0 + gt * gt * r2
        u = z * z * inverse * QUARTER / (F1 + wide * inverse)
        t = F1 / (F1 + u * icap[i])
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
    h0, h1, h2 = g0 * s + prior[0] * guess[0], g1 * s + prior[0] * guess[1], g2 * s
    return (
        i00 * h0 + i01 * h1 + i02 * h2,
        i01 * h0 + i11 * h1 + i12 * h2,
        i02 * h0 + i12 * h1 + i22 * h2,
    )


@kernel
def cell_at(row, column, index, first, last, possible):
    """Row in the data of the possible cell at this place of the lattice, -1 if there is none."""
    if row < 0 or column < 0 or row >= index.shape[0] or column >= index.shape[1]:
        return -1
    q = index[row, column]
    return q - first if first <= q < last and possible[q - first] else -1


@kernel
def error_left(
    row, column, way, link, steps, index, first, last, links, possible, spacing, data, limit, icap,
    use, size, sigma, tau, iterations,
):  # fmt: skip
    """What is left of the displacement `size` along `way`, x and y, metres."""
    p = index[row, column] - first
    m, mx, my = p, 0, 0
    # As far as possible cells lead, for a robot cannot be expected behind a wall.
    for _ in range(steps):
        if not links[m] & (1 << link):
            break
        mx, my = mx + way[0], my + way[1]
        m = index[row + my, column + mx] - first
    prior = (1.0 / (size * size), 1.0 / (sigma * sigma))
    believed_x, believed_y = size * way[0], size * way[1]
    x, y, theta = believed_x, believed_y, 0.0
    room = (size * size, sigma * sigma)
    for _ in range(iterations):
        cx, cy = mx * spacing, my * spacing
        x, y, theta = recover(
            data, p, m, limit, icap, use, (x - cx, y - cy, theta), prior,
            (believed_x - cx, believed_y - cy), room, tau,
        )  # fmt: skip
        x, y = x + cx, y + cy
        strayed = math.hypot(x - believed_x, y - believed_y) / (WINDOW * size)
        if strayed > 1.0:
            x = believed_x + (x - believed_x) / strayed
            y = believed_y + (y - believed_y) / strayed
        room = (spacing * spacing / 4.0, sigma * sigma)
        nx, ny = round(x / spacing), round(y / spacing)
        q = cell_at(row + ny, column + nx, index, first, last, possible)
        if q >= 0:
            m, mx, my = q, nx, ny
    return x, y


@kernel
def _errors(
    low, high, begin, first, last, rows_columns, index, links, possible, ways, link, steps, spacing,
    data, limit, icap, use, size, sigma, tau, iterations, out,
):  # fmt: skip
    for i in range(low, high):
        row, column = rows_columns[begin + i, 0], rows_columns[begin + i, 1]
        xx, xy, yy = 0.0, 0.0, 0.0
        for k in range(4):
            x, y = error_left(
                row, column, ways[k], link[k], steps, index, first, last, links, possible, spacing,
                data, limit, icap, use, size, sigma, tau, iterations,
            )  # fmt: skip
            xx, xy, yy = xx + 0.5 * x * x, xy + 0.5 * x * y, yy + 0.5 * y * y
        out[0, i], out[1, i], out[2, i] = xx, xy, yy


LAYER = Layer(
    name="perturbation",
    title="error left of a small displacement, worst direction",
    unit="m",
    source="Chai et al. 2024, LF-3PM (IROS): perturbation-induced metric",
    worse="high",
    compute=perturbation,
    companions={
        "perturbation_minor": ("error left of a small displacement, best direction", "m"),
        "perturbation_direction": ("axis of the worst error left of a small displacement", "rad"),
    },
)
