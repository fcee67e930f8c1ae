"""Kernels that certify costs to go on a square grid: subsolutions of the eikonal equation.

Along a path in direction d a function V falls by -grad V . d per metre. Where that is at most the
cost per metre c_d for all d, V(start) - V(goal) is a lower bound of what any path costs. Here V is
quadratic in x and in y in each cell, given by 3 x 3 Bernstein coefficients ("vertices", of which
cells share those on their edges). So is -grad V . d, and c_d, which is bilinear, can be written so:
what holds for the nine coefficients of a cell holds in all of it (Farouki 2012, "The Bernstein
polynomial basis: a centennial retrospective", on degree elevation and the convex hull). A V that is
bilinear could not be as steep as a cost that changes along a cell. The gradients that a coefficient
allows form a convex set, given by its radius in some directions (one if it is a disc); between
these its chords are taken, which lie within.

V begins as an upwind solution found by fast marching (Sethian 1999, "Fast marching methods"), of
second order where all directions cost the same; its gradient is too steep where paths fan out or
meet. `relax` looks for the nearest function that is not: the primal-dual iteration of Chambolle and
Pock (2011, algorithm 2). What is left is taken out of the values themselves: wherever a coefficient
of the gradient is too steep, the range of values that it comes from is compressed by as much, for
all cells (`steepness`), which makes no other one steeper. So any V becomes a proof.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel
from ambinav_planners.search.labels import ROOM, drop_first, grown, push

# Costs bend sharply where the second difference is this share of a step.
SHARP = 0.25


@kernel
def upwind_costs(step, open_cells, seeds, most, order):
    """Compute upwind costs to the seeds, (R, C); inf where there are none up to `most`.

    Args:
        step: Cost from vertex to vertex, (R, C).
        open_cells: Cells that paths may meet, bool, ((R - 1) / 2, (C - 1) / 2).
        seeds: Flat indices of the vertices where the cost is 0.
        most: Largest cost looked at.
        order: Of the differences, 1 or 2.
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
            value = _upwind(a, b, cost, known, step, open_cells, order)
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
def _upwind(i, j, cost, known, step, open_cells, order):
    """Return the lowest of a vertex' upwind values over its four sides."""
    best, size = math.inf, step[i, j]
    for quadrant in range(4):
        right, up = quadrant & 1, quadrant >> 1
        row, column = (i - 1 + up) >> 1, (j - 1 + right) >> 1
        if not (0 <= row < open_cells.shape[0] and 0 <= column < open_cells.shape[1]):
            continue
        if not open_cells[row, column]:
            continue
        x, a, p = _behind(i, j, 0, 2 * right - 1, cost, known, order)
        y, b, q = _behind(i, j, 2 * up - 1, 0, cost, known, order)
        value = min(a + size / p, b + size / q)
        # The greater root of p^2 (v - a)^2 + q^2 (v - b)^2 = size^2.
        if x < math.inf and y < math.inf:
            p, q = p * p, q * q
            middle = (p * a + q * b) / (p + q)
            rest = (size * size - p * q * (a - b) ** 2 / (p + q)) / (p + q)
            if rest >= 0.0 and middle + math.sqrt(rest) >= max(x, y):
                value = middle + math.sqrt(rest)
        best = min(best, value)
    return best


@kernel
def _behind(i, j, down, along, cost, known, order):
    """Return a neighbour's cost, and a and p of the rise p (v - a) from it to a vertex' cost v.

    Of order 2 where that is asked for and the vertex beyond it is known too.
    """
    if not known[i + down, j + along]:
        return math.inf, math.inf, 1.0
    cost_there = cost[i + down, j + along]
    row, column = i + 2 * down, j + 2 * along
    if (
        order == 2
        and 0 <= row < cost.shape[0]
        and 0 <= column < cost.shape[1]
        and known[row, column]
    ):
        before = cost[row, column]
        if before <= cost_there:
            return cost_there, (4.0 * cost_there - before) / 3.0, 1.5
    return cost_there, cost_there, 1.0


@kernel
def to_coefficients(cost, step):
    """Turn the values of smooth costs at the vertices, (R, C), into Bernstein coefficients.

    Where costs bend sharply, at corners and where two fronts meet, the values are kept.
    """
    rows, columns = cost.shape
    for i in range(rows):
        for j in range(1, columns, 2):
            bend = cost[i, j - 1] - 2.0 * cost[i, j] + cost[i, j + 1]
            if abs(bend) < SHARP * step[i, j]:
                cost[i, j] -= 0.5 * bend
    for i in range(1, rows, 2):
        for j in range(columns):
            bend = cost[i - 1, j] - 2.0 * cost[i, j] + cost[i + 1, j]
            if abs(bend) < SHARP * step[i, j]:
                cost[i, j] -= 0.5 * bend


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

    With steps of each vertex' own (Pock and Chambolle 2011, "Diagonal preconditioning for first
    order primal-dual algorithms", lemma 2).

    Args:
        cost: Costs, (R, C), finite at the vertices of all cells; changed.
        radii: See `gauge`, times the step from vertex to vertex, (R, C, M).
        circle: See `gauge`.
        cells: Rows and columns of the cells that paths may meet, (2, N).
        iterations: How many.
    """
    rows, columns = cost.shape
    count = cells.shape[1]
    weight = _weights(cost.shape, cells)
    ahead, pull = cost.copy(), np.zeros(cost.shape)
    flow = np.zeros((count, 9, 2))
    for _ in range(iterations):
        for k in range(count):
            for vertex in range(9):
                row, column, left, right, low, high = ends_of(cells[0, k], cells[1, k], vertex)
                sx, sy = 1.0 / (right - left), 1.0 / (high - low)
                size = 0.5 / max(sx, sy)
                x = flow[k, vertex, 0] + size * sx * (ahead[row, right] - ahead[row, left])
                y = flow[k, vertex, 1] + size * sy * (ahead[high, column] - ahead[low, column])
                rate = gauge(x, y, row, column, radii, circle)
                if rate <= size:
                    flow[k, vertex, 0] = flow[k, vertex, 1] = 0.0
                    continue
                if radii.shape[2] == 1:
                    x, y = x * (1.0 - size / rate), y * (1.0 - size / rate)
                else:
                    x, y = _beyond(x, y, size, row, column, radii, circle)
                flow[k, vertex, 0], flow[k, vertex, 1] = x, y
                pull[row, right] += sx * x
                pull[row, left] -= sx * x
                pull[high, column] += sy * y
                pull[low, column] -= sy * y
        for i in range(rows):
            for j in range(columns):
                if weight[i, j] > 0.0:
                    change = pull[i, j] / weight[i, j]
                    cost[i, j] -= change
                    ahead[i, j] = cost[i, j] - change
                    pull[i, j] = 0.0


@kernel
def _weights(shape, cells):
    """Return the sum of the coefficients with which a vertex stands in gradients, (R, C)."""
    weight = np.zeros(shape)
    for k in range(cells.shape[1]):
        for vertex in range(9):
            row, column, left, right, low, high = ends_of(cells[0, k], cells[1, k], vertex)
            for end in (left, right):
                weight[row, end] += 1.0 / (right - left)
            for end in (low, high):
                weight[end, column] += 1.0 / (high - low)
    return weight


@kernel(inline="always")
def ends_of(i, j, vertex):
    """Return row and column of a vertex of a cell, and which others its gradient comes from.

    The gradient is that of the quadratic's coefficients, raised to degree two in both directions:
    at the ends of a line the step there, in its middle the mean of both.

    Returns:
        Row, column; the columns from and to which it rises along its row; the rows likewise.
    """
    b, a = vertex // 3, vertex % 3
    i, j = 2 * i, 2 * j
    return i + b, j + a, j + (a == 2), j + 1 + (a > 0), i + (b == 2), i + 1 + (b > 0)


@kernel
def steepness(cost, radii, circle, cells, top, bins):
    """Return the largest gauge of gradients that share a value, by value, (B,), at least 1.

    Args:
        cost: Costs, (R, C), at the vertices of all cells from 0 to `top`.
        radii: See `relax`.
        circle: See `gauge`.
        cells: See `relax`.
        top: The end of the last bin.
        bins: B, evenly from 0 on.
    """
    worst = np.ones(bins)
    for k in range(cells.shape[1]):
        for vertex in range(9):
            row, column, left, right, low, high = ends_of(cells[0, k], cells[1, k], vertex)
            a, b, c, d = cost[row, left], cost[row, right], cost[low, column], cost[high, column]
            x, y = (b - a) / (right - left), (d - c) / (high - low)
            rate = gauge(x, y, row, column, radii, circle)
            if rate > 1.0:
                least, most = min(a, b, c, d), max(a, b, c, d)
                first, last = int(least / top * bins), int(most / top * bins)
                for n in range(max(first, 0), min(last, bins - 1) + 1):
                    worst[n] = max(worst[n], rate)
    return worst
