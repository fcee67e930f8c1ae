"""Kernels that certify costs to go on a square grid: subsolutions of the eikonal equation.

Along a path in direction d a function V falls by -grad V . d per metre. Where that is at most the
cost per metre c_d for all d, V(start) - V(goal) is a lower bound of what any path costs. Here V is
bilinear in each cell, so -grad V . d is the bilinear interpolation of its values at the corners;
c_d is bilinear too: what holds at the four corners of a cell holds in all of it. The gradients
that a corner allows form a convex set, given by its radius in some directions (one if it is a
disc); between these its chords are taken, which lie within.

V begins as the upwind solution of Rouy and Tourin (1992), found by Sethian's fast marching (1996),
whose gradient is too steep where paths fan out. `relax` looks for the nearest function that is
not: the primal-dual iteration of Chambolle and Pock (2011, algorithm 2). What is left is taken out
of the values themselves (`flattened`): wherever a corner is too steep, the range of values at that
corner is compressed by as much, for all cells, which makes no other corner steeper. So any V
becomes a proof.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel
from ambinav_planners.search.labels import ROOM, drop_first, grown, push


@kernel
def upwind_costs(step, open_cells, seeds, most):
    """Compute upwind costs to the seeds, (R, C); inf where there are none up to `most`.

    Args:
        step: Cost from vertex to vertex, (R, C).
        open_cells: Cells that paths may meet, bool, (R - 1, C - 1).
        seeds: Flat indices of the vertices where the cost is 0.
        most: Largest cost looked at.
    """
    rows, columns = step.shape
    cost = np.full(step.shape, math.inf)
    known = np.zeros(step.shape, dtype=np.bool_)
    keys, items = np.empty(ROOM), np.empty(ROOM, dtype=np.int64)
    size = 0
    for seed in seeds:
        cost[seed // columns, seed % columns] = 0.0
        push(keys, items, size, 0.0, seed)
        size += 1
    while size > 0:
        key, vertex = keys[0], items[0]
        drop_first(keys, items, size)
        size -= 1
        i, j = vertex // columns, vertex % columns
        if known[i, j]:
            continue
        if key > most:
            break
        known[i, j] = True
        for side in range(4):
            a, b = i + (side == 0) - (side == 1), j + (side == 2) - (side == 3)
            if a < 0 or b < 0 or a >= rows or b >= columns or known[a, b]:
                continue
            value = _upwind(a, b, cost, known, step[a, b], open_cells)
            if value < cost[a, b]:
                cost[a, b] = value
                if size == keys.size:
                    keys, items = grown(keys), grown(items)
                push(keys, items, size, value, a * columns + b)
                size += 1
    for i in range(rows):
        for j in range(columns):
            if not known[i, j]:
                cost[i, j] = math.inf
    return cost


@kernel
def _upwind(i, j, cost, known, step, open_cells):
    """Return the lowest of a vertex' upwind values over its four cells."""
    best = math.inf
    for quadrant in range(4):
        right, up = quadrant & 1, quadrant >> 1
        row, column = i - 1 + up, j - 1 + right
        if not (0 <= row < open_cells.shape[0] and 0 <= column < open_cells.shape[1]):
            continue
        if not open_cells[row, column]:
            continue
        beside, above = column + right, row + up
        x = cost[i, beside] if known[i, beside] else math.inf
        y = cost[above, j] if known[above, j] else math.inf
        low, apart = min(x, y), abs(x - y)
        if apart < step:
            low += 0.5 * (apart + math.sqrt(2.0 * step * step - apart * apart))
        else:  # also where one or both are not known
            low += step
        best = min(best, low)
    return best


@kernel(inline="always")
def gauge(x, y, i, j, radii, circle):
    """Return by what a gradient must be divided to lie on the border of those allowed.

    Args:
        x: By how much the costs rise from vertex to vertex.
        y: The same along y.
        i: Row of the vertex.
        j: Its column.
        radii: Radii of what is allowed, in the directions of `circle`, (R, C, M).
        circle: Unit vectors, (M, 2), M a multiple of 4, at which y / (|x| + |y|) grows evenly: so
            the two beside a gradient are found without a trigonometric function.
    """
    if radii.shape[2] == 1:
        return math.sqrt(x * x + y * y) / radii[i, j, 0]
    return _gauge_by_direction(x, y, i, j, radii, circle)


@kernel(_nrt=False)
def _gauge_by_direction(x, y, i, j, radii, circle):
    count = radii.shape[2]
    sector = _sector(x, y, count)
    after = sector + 1 if sector + 1 < count else 0
    ax, ay, bx, by = circle[sector, 0], circle[sector, 1], circle[after, 0], circle[after, 1]
    a, b = max(x * by - y * bx, 0.0), max(ax * y - ay * x, 0.0)
    return (a / radii[i, j, sector] + b / radii[i, j, after]) / (ax * by - ay * bx)


@kernel(inline="always")
def _sector(x, y, count):
    """Return between which of `count` directions, this and the next, a gradient lies."""
    size = abs(x) + abs(y)
    if size == 0.0:
        return 0
    place = y / size if x >= 0.0 else 2.0 - y / size
    # Rounding may put a direction into the sector beside it, or beyond the last one.
    return min(int((place + 4.0 if place < 0.0 else place) * (0.25 * count)), count - 1)


@kernel(_nrt=False)
def _beyond(x, y, size, i, j, radii, circle):
    """Return how far a gradient lies from the nearest allowed one, those taken `size` as large."""
    count = radii.shape[2]
    sector = _sector(x, y, count)
    turn, share, px, py, qx, qy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(count):
        after = sector + 1 if sector + 1 < count else 0
        near, far = size * radii[i, j, sector], size * radii[i, j, after]
        px, py = near * circle[sector, 0], near * circle[sector, 1]
        qx, qy = far * circle[after, 0] - px, far * circle[after, 1] - py
        share = ((x - px) * qx + (y - py) * qy) / (qx * qx + qy * qy)
        # The nearest point may be in another sector, that way round.
        step = -1 if share < 0.0 else 1 if share > 1.0 else 0
        if step == 0 or step == -turn:
            break
        turn = step
        sector = (sector + step) % count
    share = min(max(share, 0.0), 1.0)
    return x - px - share * qx, y - py - share * qy


@kernel
def allowed_radii(low, high, cost, weights, out):
    """Compute what gradients the costs per metre allow, for rows low to high - 1 of the lattice.

    Args:
        low: First row.
        high: Row after the last one.
        cost: Cost per metre by heading, (R, C, H), linear between headings.
        weights: By what a cost at each of K headings bounds the gradients in M directions, (M, K),
            K a multiple of H.
        out: Radii in the M directions, (R, C, M), filled.
    """
    columns, headings = cost.shape[1:]
    directions, fine = weights.shape
    parts = fine // headings
    limit = np.empty(fine)
    for i in range(low, high):
        for j in range(columns):
            for k in range(headings):
                here, after = cost[i, j, k], cost[i, j, (k + 1) % headings]
                for part in range(parts):
                    limit[k * parts + part] = here + (after - here) * part / parts
            for m in range(directions):
                least = math.inf
                for k in range(fine):
                    least = min(least, limit[k] * weights[m, k])
                out[i, j, m] = least


@kernel
def steps_along(cost, radii, circle, out):
    """Compute the upwind steps for the directions in which costs rise: the allowed radii, (R, C).

    Where that direction is not known, it is the largest of all radii.
    """
    rows, columns = cost.shape
    for i in range(rows):
        for j in range(columns):
            x = _rise(cost[i, max(j - 1, 0)], cost[i, j], cost[i, min(j + 1, columns - 1)])
            y = _rise(cost[max(i - 1, 0), j], cost[i, j], cost[min(i + 1, rows - 1), j])
            if x == 0.0 and y == 0.0:
                out[i, j] = radii[i, j].max()
            else:
                out[i, j] = math.hypot(x, y) / gauge(x, y, i, j, radii, circle)


@kernel
def _rise(before, here, after):
    """Return by how much costs rise along an axis, from the lower neighbour; 0 if not known."""
    if here == math.inf or (before >= here and after >= here):
        return 0.0
    return here - before if before <= after else after - here


@kernel
def relax(cost, radii, circle, cells, iterations):
    """Make costs less steep where their gradient is not allowed, and change them little.

    Args:
        cost: Costs, (R, C), finite at the corners of all cells; changed.
        radii: See `gauge`, times the edge of a cell, (R, C, M).
        circle: See `gauge`.
        cells: Rows and columns of the cells that paths may meet, (2, N).
        iterations: How many.
    """
    rows, columns = cost.shape
    count = cells.shape[1]
    ahead, pull = cost.copy(), np.zeros(cost.shape)
    flow = np.zeros((count, 4, 2))
    # A difference counts in four corners, and the norm of the Laplacian of a grid is at most 8:
    # both steps are 1 / sqrt(32) at most.
    size = 1.0 / math.sqrt(32.0)
    for _ in range(iterations):
        for k in range(count):
            i, j = cells[0, k], cells[1, k]
            for corner in range(4):
                right, up = corner & 1, corner >> 1
                row, column, above, beside = i + up, j + right, i + 1 - up, j + 1 - right
                sx, sy = 1.0 - 2.0 * right, 1.0 - 2.0 * up
                x = flow[k, corner, 0] + size * sx * (ahead[row, beside] - ahead[row, column])
                y = flow[k, corner, 1] + size * sy * (ahead[above, column] - ahead[row, column])
                rate = gauge(x, y, row, column, radii, circle)
                if rate <= size:
                    flow[k, corner, 0] = flow[k, corner, 1] = 0.0
                    continue
                if radii.shape[2] == 1:
                    x, y = x * (1.0 - size / rate), y * (1.0 - size / rate)
                else:
                    x, y = _beyond(x, y, size, row, column, radii, circle)
                flow[k, corner, 0], flow[k, corner, 1] = x, y
                pull[row, beside] += sx * x
                pull[above, column] += sy * y
                pull[row, column] -= sx * x + sy * y
        for i in range(rows):
            for j in range(columns):
                change = size * pull[i, j]
                cost[i, j] -= change
                ahead[i, j] = cost[i, j] - change
                pull[i, j] = 0.0


@kernel
def steepness(cost, radii, circle, cells, top, bins):
    """Return the largest gauge at the corners that share a value, by value, (B,), at least 1.

    Args:
        cost: Costs, (R, C), at the corners of all cells from 0 to `top`.
        radii: See `relax`.
        circle: See `gauge`.
        cells: See `relax`.
        top: The end of the last bin.
        bins: B, evenly from 0 on.
    """
    worst = np.ones(bins)
    for k in range(cells.shape[1]):
        i, j = cells[0, k], cells[1, k]
        for corner in range(4):
            right, up = corner & 1, corner >> 1
            row, column = i + up, j + right
            here, beside, above = (
                cost[row, column], cost[row, j + 1 - right], cost[i + 1 - up, column]
            )  # fmt: skip
            x, y = (1.0 - 2.0 * right) * (beside - here), (1.0 - 2.0 * up) * (above - here)
            rate = gauge(x, y, row, column, radii, circle)
            if rate > 1.0:
                low, high = min(here, beside, above), max(here, beside, above)
                first, last = int(low / top * bins), int(high / top * bins)
                for b in range(max(first, 0), min(last, bins - 1) + 1):
                    worst[b] = max(worst[b], rate)
    return worst
