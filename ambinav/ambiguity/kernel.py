"""The ambiguity kernel: every pose's scan against those of its neighbours.

How two scans are compared, `ambinav.ambiguity.pair` says; which poses are neighbours of one,
`ambinav.ambiguity.reach`.

`ambinav.ambiguity.reference` says the same in plain NumPy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.gaussian import FAST, U, aligned, gaussian, integral, nine_rows
from ambinav.ambiguity.pair import first_step, scan_known, second_step
from ambinav.ambiguity.reach import flood_arrays, link_planes, neighbours
from ambinav.ambiguity.refined import refined_step, write_offsets
from ambinav.ambiguity.returns import BeamTable
from ambinav.geometry.lattice import STEPS
from ambinav.kernels import kernel
from ambinav.lanes import LANES, load, narrow, store, transpose
from ambinav.threads import run_rows

# Python hears of an interruption after so many beam comparisons, a second or two.
INTERRUPT_EVERY = 400_000_000
# Poses are taken in square tiles of so many rows, and so many of them heading by heading: their
# neighbours' scans at one heading stay in the second cache.
TILE = 8
BLOCK = 64
# A pair of poses is refined from this part of the mean pair's share in the second moment on, and
# wholly from twice it: less, and what is refined moves no radius (docs/model.md).
REFINED = 0.3
# A neighbour is left out whose first step leaves more evidence than that of the pose's best one: by
# so many independent beams at their cap, and so much at least. The estimate is good to one or two.
DISMISSED_BEAMS = 6.5
DISMISSED = 18.0


@kernel
def around_arrays(count):
    """Arrays that `listed` writes, for at most so many neighbours."""
    return (
        np.empty(count + LANES, dtype=np.int64),
        np.empty(count + LANES),
        np.empty(count + LANES),
        np.empty(count + LANES),
    )


@kernel
def listed(row, column, index, first, marks, offsets, side, spacing, c0, around, out):
    """List the marked neighbours of a pose, and write the moments of the free neighbourhood.

    Args:
        row: Of the pose, like `column`.
        column: Of the pose.
        index: See `Lattice`.
        first: Running number of the first pose in the scans.
        marks: See `reach`, like the next two.
        offsets: Row and column steps, (K, 2).
        side: Of a square around them.
        spacing: Of the lattice, metres.
        c0: Variance of the offset in x and y, square metres.
        around: Written: rows of the scans, and x and y less those of the pose, metres, each of
            shape (K + LANES,); 1 for a neighbour and 0 for what follows the last.
        out: The last three of (7,) are written.

    Returns:
        How many neighbours there are.
    """
    near, x, y, filled = around
    k, count = side // 2, 0
    fxx, fxy, fyy = 0.0, 0.0, 0.0
    for o in range(offsets.shape[0]):
        if marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] == 2:
            near[count] = index[row + offsets[o, 0], column + offsets[o, 1]] - first
            dx, dy = offsets[o, 1] * spacing, offsets[o, 0] * spacing
            x[count], y[count], filled[count] = dx, dy, 1.0
            fxx += dx * dx
            fxy += dx * dy
            fyy += dy * dy
            count += 1
    for n in range(count, count + LANES):
        near[n], x[n], y[n], filled[n] = near[0], 0.0, 0.0, 0.0
    out[4], out[5], out[6] = fxx / count + c0, fxy / count, fyy / count + c0
    return count


@kernel
def batch_arrays(columns, count):
    """Arrays that `pose_sums` works in.

    Args:
        columns: Of the scans, padding included.
        count: Of neighbours, at most.

    Returns:
        What is known of the pose; weights of beams; sums of each pair, and the same turned; the
        moments; what the first step found of each pair; numbers of the pairs; what `compared`
        writes; the pairs to refine and their scans; where these are and their shares; Gaussians of
        offsets; and what `refined_step` works in.
    """
    return (
        aligned(4 * columns).reshape(4, columns),
        aligned(columns),
        # A last batch may not fill them: what is left there must be finite.
        aligned(LANES * LANES).reshape(LANES, 1, LANES),
        aligned(LANES * LANES).reshape(LANES, LANES),
        np.zeros((4, LANES)),
        aligned((count + LANES) * LANES).reshape(count + LANES, 1, LANES),
        np.arange(count + LANES),
        np.zeros((7, count + LANES)),
        np.zeros((2, count + LANES), dtype=np.int64),
        np.zeros((3, count + LANES)),
        aligned(9 * LANES).reshape(9, LANES),
        aligned(6 * columns).reshape(6, columns),
    )


@kernel(fastmath=FAST)
def pose_sums(
    p, around, count, data, limit, icap, use, evidence, tau, c0, c2, arrays, out,
):  # fmt: skip
    """Compare one pose with its neighbours; write what `neighbourhood_sums` says.

    Args:
        p: The pose, a row of `data`.
        around: See `listed`.
        count: How many neighbours.
        data: As for `first_step`, like the next three.
        limit: Maximum range.
        icap: Inverse cap.
        use: 1 for a beam.
        evidence: See `compare`, like the next three.
        tau: Beams per independent piece of evidence.
        c0: Variance of the offset in x and y.
        c2: Variance of the offset in theta.
        arrays: See `batch_arrays`.
        out: Written, the first four of (7,).
    """
    known, moments = arrays[0], arrays[4]
    scan_known(data, p, limit, icap, use, known)
    left = dismissed(p, around, count, data, limit, icap, use, tau, c0, c2, arrays)
    compared(p, around, left, data, limit, icap, use, evidence, tau, c0, c2, arrays)
    some = chosen(left, count, around, arrays)
    refine(p, some, data, limit, icap, use, evidence, tau, c0, c2, arrays)
    total, txx, txy, tyy = 0.0, 0.0, 0.0, 0.0
    for j in range(LANES):
        total += moments[0, j]
        txx += moments[1, j]
        txy += moments[2, j]
        tyy += moments[3, j]
    out[0] = total / count
    out[1], out[2], out[3] = txx / total, txy / total, tyy / total


@kernel(fastmath=FAST)
def dismissed(p, around, count, data, limit, icap, use, tau, c0, c2, arrays):
    """Take the first step with all neighbours, and leave out those that look nothing like the pose.

    Arguments as for `pose_sums`; `around` and what the first step found are written anew.

    Returns:
        How many neighbours remain.
    """
    near, x, y, filled = around
    known, firsts = arrays[0], arrays[5]
    half0, half2 = np.float32(0.5 * c0), np.float32(0.5 * c2)
    z = U(0)
    best = np.float32(np.inf)
    for n in range(z, U(count)):
        step = first_step(data, p, near[n], limit, icap, use, half0, half2, known)
        store(firsts, (n, z, z), step)
        best = min(best, firsts[n, 0, 9])
    flattest = np.float32(np.inf)
    for i in range(limit.size):
        if use[i] > 0:
            flattest = min(flattest, icap[i])
    most_left = best + np.float32(tau) * max(
        np.float32(DISMISSED), np.float32(DISMISSED_BEAMS) / flattest
    )
    left = 0
    for n in range(count):
        if firsts[n, 0, 9] <= most_left:
            store(firsts, (U(left), z, z), load(firsts, (U(n), z, z)))
            near[left], x[left], y[left] = near[n], x[n], y[n]
            left += 1
    for n in range(left, min(left + LANES, count)):
        filled[n] = 0.0
    return left


@kernel(fastmath=FAST)
def compared(p, around, count, data, limit, icap, use, evidence, tau, c0, c2, arrays):
    """Compare one pose with its neighbours by `second_step`.

    As `pair.compare`, a step of sixteen neighbours at a time: what comes after the sums over beams
    is then computed for all of them at once. Arguments as for `pose_sums`; written is of each pair
    I, the offset in x and y from the pose, its covariance (xx, xy, yy), and I times the sum of the
    second moments.
    """
    near, x, y, filled = around
    known, weights, found, sums, _, firsts, numbers, pairs, _, _, _, _ = arrays
    z = U(0)
    for low in range(z, U(count), U(LANES)):
        n = min(U(LANES), U(count) - low)
        transpose(firsts, numbers, low, z, z, sums, z, U(LANES))
        o0, o1, o2, _, _, _, _, _, _, _ = gaussian(nine_rows(sums), tau, c0, c2)
        store(sums, (U(0), z), narrow(o0))
        store(sums, (U(1), z), narrow(o1))
        store(sums, (U(2), z), narrow(o2))
        for j in range(n):
            step = second_step(
                data, p, near[low + j], limit, icap, use, evidence, sums[0, j], sums[1, j],
                sums[2, j], known, weights,
            )  # fmt: skip
            store(found, (j, z, z), step)
        transpose(found, numbers, z, z, z, sums, z, U(LANES))
        alike, o0, o1, _, xx, xy, yy, _ = integral(sums, tau, c0, c2)
        # Lanes without a neighbour count for nothing.
        alike *= load(filled, low)
        to_x, to_y = load(x, low) + o0, load(y, low) + o1
        store(pairs, (U(0), low), alike)
        store(pairs, (U(1), low), to_x)
        store(pairs, (U(2), low), to_y)
        store(pairs, (U(3), low), xx)
        store(pairs, (U(4), low), xy)
        store(pairs, (U(5), low), yy)
        store(pairs, (U(6), low), alike * (to_x * to_x + to_y * to_y + xx + yy))


@kernel(fastmath=FAST)
def chosen(left, count, around, arrays):
    """Choose the pairs that matter to the moments, and begin the moments with the others.

    Args:
        left: How many neighbours were compared.
        count: How many there are.
        around: See `listed`.
        arrays: See `batch_arrays`; written are the moments in the first lane, and of the chosen
            pairs the numbers, the scans, where they are, and with what share they are refined.

    Returns:
        How many are chosen.
    """
    near, x, y, _ = around
    moments, pairs, picked, places = arrays[4], arrays[7], arrays[8], arrays[9]
    total = 0.0
    for n in range(left):
        total += pairs[6, n]
    least_part = REFINED * total / count
    moments[:] = 0.0
    some = 0
    for n in range(left):
        share = min(max(pairs[6, n] / least_part - 1.0, 0.0), 1.0)
        if share > 0.0:
            picked[0, some], picked[1, some] = n, near[n]
            places[0, some], places[1, some], places[2, some] = x[n], y[n], share
            some += 1
        alike = pairs[0, n] * (1.0 - share)
        to_x, to_y = pairs[1, n], pairs[2, n]
        moments[0, 0] += alike
        moments[1, 0] += alike * (to_x * to_x + pairs[3, n])
        moments[2, 0] += alike * (to_x * to_y + pairs[4, n])
        moments[3, 0] += alike * (to_y * to_y + pairs[5, n])
    for n in range(some, some + LANES):
        picked[0, n], places[0, n], places[1, n], places[2, n] = 0, 0.0, 0.0, 0.0
    return some


@kernel(fastmath=FAST)
def refine(p, some, data, limit, icap, use, evidence, tau, c0, c2, arrays):
    """Add the chosen pairs to the moments, by `refined_step`; arguments as for `pose_sums`."""
    known, _, found, sums, moments, firsts, numbers, _, picked, places, offsets, work = arrays
    half0, half2, tau32 = np.float32(0.5 * c0), np.float32(0.5 * c2), np.float32(tau)
    z = U(0)
    for low in range(z, U(some), U(LANES)):
        n = min(U(LANES), U(some) - low)
        transpose(firsts, picked[0], low, z, z, sums, z, U(LANES))
        write_offsets(sums, tau, c0, c2, offsets)
        for j in range(n):
            step = refined_step(
                data, p, picked[1, low + j], limit, icap, use, evidence, half0, half2, tau32,
                known, offsets, j, work,
            )  # fmt: skip
            store(found, (j, z, z), step)
        transpose(found, numbers, z, z, z, sums, z, U(LANES))
        alike, o0, o1, _, xx, xy, yy, _ = integral(sums, tau, c0, c2)
        # Lanes without a pair count for nothing.
        alike *= load(places, (U(2), low))
        to_x, to_y = load(places, (U(0), low)) + o0, load(places, (U(1), low)) + o1
        add(moments, U(0), alike)
        add(moments, U(1), alike * (to_x * to_x + xx))
        add(moments, U(2), alike * (to_x * to_y + xy))
        add(moments, U(3), alike * (to_y * to_y + yy))


@kernel(fastmath=FAST, inline="always")
def add(moments, row, lanes_of):
    """Add lanes to a row of the moments."""
    store(moments, (row, U(0)), load(moments, (row, U(0))) + lanes_of)


@kernel
def _sums(
    low, high, poses, order, first, rows_columns, index, links, planes, steps, offsets, spacing,
    data, limit, icap, use, evidence, tau, c0, c2, sums,
):  # fmt: skip
    side = 2 * np.abs(offsets).max() + 1
    marks = np.empty((BLOCK, side * side), dtype=np.uint8)
    scratch = flood_arrays(offsets, side)
    around = around_arrays(offsets.shape[0])
    arrays = batch_arrays(limit.size, offsets.shape[0])
    for block in range(low, high, BLOCK):
        count = min(BLOCK, high - block)
        for h in range(data.shape[0]):
            for j in range(count):
                i = order[block + j]
                row, column = rows_columns[poses[i], 0], rows_columns[poses[i], 1]
                if h < links.shape[0]:
                    neighbours(
                        row, column, index, first, links[h], planes[h], offsets, side, steps,
                        marks[j], scratch,
                    )  # fmt: skip
                near = listed(
                    row, column, index, first, marks[j], offsets, side, spacing, c0, around,
                    sums[i, h],
                )  # fmt: skip
                pose_sums(
                    poses[i] - first, around, near, data[h], limit, icap, use, evidence,
                    tau, c0, c2, arrays, sums[i, h],
                )  # fmt: skip


def neighbourhood_sums(
    poses: NDArray[np.int64],
    first: int,
    rows_columns: NDArray[np.int32],
    index: NDArray[np.int32],
    links: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    spacing: float,
    data: NDArray[np.float32],
    beams: BeamTable,
    evidence: NDArray[np.float32] | None,
    tau: float,
    cell_variance: tuple[float, float],
) -> NDArray[np.float64]:
    """Ambiguity and second moments of M free poses of a lattice, at H headings.

    Args:
        poses: Running numbers of the poses to compute (see `Lattice.index`), shape (M,).
        first: Running number of the first pose in `data` and `links`, which hold the
            neighbours of all these poses too.
        rows_columns: See `Lattice`.
        index: See `Lattice`.
        links: See `Lattice`; from pose `first` on, shape (H, N), or (1, N) for all headings.
        offsets: Row and column steps of the disc, shape (K, 2).
        spacing: Of the lattice, metres.
        data: What the beams return at each heading, float32, shape (H, N, 5, P): see `Returns`.
        beams: Their limits and caps.
        evidence: Table of evidence, shape (P, Z), or None where all bins are fine.
        tau: Beams per independent piece of evidence.
        cell_variance: Variance of the offset within a cell in x and y (square metres), and in
            theta (square radians).

    Returns:
        float64, shape (M, H, 7): mean indistinguishability; second moments xx, xy, yy of
        the indistinguishable poses about the pose; the same of the free neighbourhood; square
        metres.
    """
    sums = np.empty((len(poses), len(data), 7))
    planes = link_planes(links, rows_columns, first, index.shape, offsets)
    # Tile by tile: what a pose is compared with is then still in the cache from the one before.
    rows, columns = rows_columns[poses].T
    order = np.lexsort((columns, rows, columns // TILE, rows // TILE))
    most = max(INTERRUPT_EVERY // (len(data) * len(offsets) * len(beams.limit)), 1)
    for low in range(0, len(poses), most):
        part = order[low : low + most]
        run_rows(
            _sums, len(part), poses, part, first, rows_columns, index, links, planes, STEPS,
            offsets, spacing, data, beams.limit, beams.inverse_cap, beams.use, evidence, tau,
            *cell_variance, sums, least=8,
        )  # fmt: skip
    return sums
