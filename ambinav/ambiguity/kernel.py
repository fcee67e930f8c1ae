"""Ambiguity kernel: comparison of every pose's scan with those of its neighbours.

How two scans are compared, `ambinav.ambiguity.pair` says; which poses are neighbours of one,
`ambinav.ambiguity.reach`.

`ambinav.ambiguity.reference` says the same in plain NumPy.
"""

from __future__ import annotations

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.gaussian import F0, FAST, U, aligned, gaussian, integral, nine_rows
from ambinav.ambiguity.pair import first_step, scan_known, second_step
from ambinav.ambiguity.reach import flood_arrays, link_planes, neighbours
from ambinav.geometry.lattice import STEPS
from ambinav.runtime.array_types import Bytes, Floats, Floats32, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import LANES, lanes, load, narrow, store, transpose, wide
from ambinav.runtime.threads import run_rows

# Python hears of an interruption after so many beam comparisons, a second or two.
INTERRUPT_EVERY = 400_000_000
# Poses are taken in square tiles of so many rows, and so many of them heading by heading: their
# neighbours' scans at one heading stay in the second cache.
TILE = 8
BLOCK = 64


@kernel
def around_arrays(count):
    """Return arrays for `listed`, for at most `count` neighbours."""
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
        row: Row of the pose, like `column`.
        column: Column of the pose.
        index: See `Lattice`.
        first: Running number of the first pose in the scans.
        marks: See `reach`, like the next two.
        offsets: Row and column steps, (K, 2).
        side: Side of a square around them.
        spacing: Spacing of the lattice, metres.
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
def batch_arrays(columns):
    """Return work arrays of `pose_sums`, for scans of `columns` columns, padding included.

    Returns:
        What is known of the pose; weights of beams; sums of each pair, and the same turned; numbers
        of the pairs; and the moments.
    """
    return (
        aligned(4 * columns).reshape(4, columns),
        aligned(columns),
        # A last batch may not fill them: what is left there must be finite.
        aligned(LANES * LANES).reshape(LANES, 1, LANES),
        aligned(LANES * LANES).reshape(LANES, LANES),
        np.arange(LANES),
        np.zeros((4, LANES)),
    )


@kernel(fastmath=FAST)
def pose_sums(
    p, around, count, data, limit, icap, use, evidence, tau, c0, c2, arrays, out,
):  # fmt: skip
    """Compare one pose with its neighbours; write the sums of `neighbourhood_sums`.

    As `compare`, a step of sixteen neighbours at a time: what comes after the sums over beams is
    then computed for all of them at once.

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
    near, x, y, filled = around
    known, weights, steps, sums, numbers, moments = arrays
    half0, half2 = np.float32(0.5 * c0), np.float32(0.5 * c2)
    z = U(0)
    scan_known(data, p, limit, icap, use, known)
    weight = mxx = mxy = myy = wide(lanes(F0))
    for low in range(z, U(count), U(LANES)):
        n = min(U(LANES), U(count) - low)
        for j in range(n):
            step = first_step(data, p, near[low + j], limit, icap, use, half0, half2, known)
            store(steps, (j, z, z), step)
        transpose(steps, numbers, z, z, z, sums, z, U(LANES))
        o0, o1, o2, _, _, _, _, _, _, _ = gaussian(nine_rows(sums), tau, c0, c2)
        store(sums, (U(0), z), narrow(o0))
        store(sums, (U(1), z), narrow(o1))
        store(sums, (U(2), z), narrow(o2))
        for j in range(n):
            step = second_step(
                data, p, near[low + j], limit, icap, use, evidence, sums[0, j], sums[1, j],
                sums[2, j], known, weights,
            )  # fmt: skip
            store(steps, (j, z, z), step)
        transpose(steps, numbers, z, z, z, sums, z, U(LANES))
        alike, o0, o1, _, xx, xy, yy, _ = integral(sums, tau, c0, c2)
        # Lanes without a neighbour count for nothing.
        alike *= load(filled, low)
        to_x, to_y = load(x, low) + o0, load(y, low) + o1
        weight += alike
        mxx += alike * (to_x * to_x + xx)
        mxy += alike * (to_x * to_y + xy)
        myy += alike * (to_y * to_y + yy)
    store(moments, (U(0), z), weight)
    store(moments, (U(1), z), mxx)
    store(moments, (U(2), z), mxy)
    store(moments, (U(3), z), myy)
    total, txx, txy, tyy = 0.0, 0.0, 0.0, 0.0
    for j in range(LANES):
        total += moments[0, j]
        txx += moments[1, j]
        txy += moments[2, j]
        tyy += moments[3, j]
    out[0] = total / count
    out[1], out[2], out[3] = txx / total, txy / total, tyy / total


@kernel
def _sums(
    low, high, poses, order, first, rows_columns, index, links, planes, steps, offsets, spacing,
    data, limit, icap, use, evidence, tau, c0, c2, sums,
):  # fmt: skip
    side = 2 * np.abs(offsets).max() + 1
    marks = np.empty((BLOCK, side * side), dtype=np.uint8)
    scratch = flood_arrays(offsets, side)
    around = around_arrays(offsets.shape[0])
    arrays = batch_arrays(limit.size)
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
    poses: Ints,
    first: int,
    rows_columns: Ints32,
    index: Ints32,
    links: Bytes,
    offsets: Ints,
    spacing: float,
    data: Floats32,
    beams: BeamTable,
    evidence: Floats32 | None,
    tau: float,
    cell_variance: tuple[float, float],
) -> Floats:
    """Compute ambiguity and second moments of M free poses of a lattice, at H headings.

    Args:
        poses: Running numbers of the poses to compute (see `Lattice.index`), shape (M,).
        first: Running number of the first pose in `data` and `links`, which hold the
            neighbours of all these poses too.
        rows_columns: See `Lattice`.
        index: See `Lattice`.
        links: See `Lattice`; from pose `first` on, shape (H, N), or (1, N) for all headings.
        offsets: Row and column steps of the disc, shape (K, 2).
        spacing: Spacing of the lattice, metres.
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
    step = max(INTERRUPT_EVERY // (len(data) * len(offsets) * len(beams.limit)), 1)
    for low in range(0, len(poses), step):
        part = order[low : low + step]
        run_rows(
            _sums, len(part), poses, part, first, rows_columns, index, links, planes, STEPS,
            offsets, spacing, data, beams.limit, beams.inverse_cap, beams.use, evidence, tau,
            *cell_variance, sums, least=8,
        )  # fmt: skip
    return sums
