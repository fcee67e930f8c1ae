"""Kernels that certify costs to go in space: those of `subsolution`, on boxes with 27 vertices.

A metre costs the same in all directions, so what a coefficient of the gradient may be is a ball.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.geometry.collision.sphere import sphere_free
from ambinav.runtime.kernels import kernel
from ambinav_planners.search.labels import ROOM, drop_first, grown, push
from ambinav_planners.search.subsolution import SHARP


@kernel
def upwind_costs_in_space(price, step, open_cells, seeds, most):
    """Compute upwind costs to the seeds, (R, C, L); inf where there are none up to `most`.

    Args:
        price: Cost per metre at the vertices, (R, C, L).
        step: Metres from vertex to vertex along each axis, (3,).
        open_cells: Cells that paths may meet, bool, half as many along each axis.
        seeds: Flat indices of the vertices where the cost is 0.
        most: Largest cost looked at.
    """
    rows, columns, levels = price.shape
    cost = np.full(price.shape, math.inf)
    known = np.zeros(price.shape, dtype=np.bool_)
    keys, items = np.empty(ROOM), np.empty(ROOM, dtype=np.int64)
    size = 0
    for seed in seeds:
        cost[seed // (columns * levels), seed // levels % columns, seed % levels] = 0.0
        push(keys, items, size, 0.0, seed)
        size += 1
    while size > 0:
        key, vertex = keys[0], items[0]
        drop_first(keys, items, size)
        size -= 1
        i, j, k = vertex // (columns * levels), vertex // levels % columns, vertex % levels
        if known[i, j, k]:
            continue
        if key > most:
            break
        known[i, j, k] = True
        for side in range(6):
            a = i + (side == 0) - (side == 1)
            b = j + (side == 2) - (side == 3)
            c = k + (side == 4) - (side == 5)
            if a < 0 or b < 0 or c < 0 or a >= rows or b >= columns or c >= levels:
                continue
            if known[a, b, c]:
                continue
            value = _upwind(a, b, c, side, cost, known, price[a, b, c], step, open_cells)
            if value < cost[a, b, c]:
                cost[a, b, c] = value
                if size == keys.size:
                    keys, items = grown(keys), grown(items)
                push(keys, items, size, value, (a * columns + b) * levels + c)
                size += 1
    for i in range(rows):
        for j in range(columns):
            for k in range(levels):
                if not known[i, j, k]:
                    cost[i, j, k] = math.inf
    return cost


@kernel
def _upwind(i, j, k, side, cost, known, price, step, open_cells):
    """Return the lowest of a vertex' upwind values over the four cells between it and a side."""
    best = math.inf
    for quadrant in range(4):
        first, second = quadrant & 1, quadrant >> 1
        back = side & 1  # of a neighbour behind it along the axis, the vertex is ahead
        if side < 2:
            up, right, over = back, first, second
        elif side < 4:
            up, right, over = first, back, second
        else:
            up, right, over = first, second, back
        row, column, level = (i - 1 + up) >> 1, (j - 1 + right) >> 1, (k - 1 + over) >> 1
        if row < 0 or column < 0 or level < 0:
            continue
        if row >= open_cells.shape[0] or column >= open_cells.shape[1]:
            continue
        if level >= open_cells.shape[2] or not open_cells[row, column, level]:
            continue
        y = _behind(i, j, k, 2 * up - 1, 0, 0, cost, known)
        x = _behind(i, j, k, 0, 2 * right - 1, 0, cost, known)
        z = _behind(i, j, k, 0, 0, 2 * over - 1, cost, known)
        best = min(best, _root((y, x, z), step, price))
    return best


@kernel
def _behind(i, j, k, up, along, over, cost, known):
    """Return a neighbour's cost, and a and p of the rise p (v - a) from it to a vertex' cost v.

    Of order 2 where the vertex beyond it is known too.
    """
    if not known[i + up, j + along, k + over]:
        return math.inf, math.inf, 1.0
    near = cost[i + up, j + along, k + over]
    row, column, level = i + 2 * up, j + 2 * along, k + 2 * over
    if (
        0 <= row < cost.shape[0]
        and 0 <= column < cost.shape[1]
        and 0 <= level < cost.shape[2]
        and known[row, column, level]
        and cost[row, column, level] <= near
    ):
        return near, (4.0 * near - cost[row, column, level]) / 3.0, 1.5
    return near, near, 1.0


@kernel
def _root(behind, step, price):
    """Return the least v with sum (p (v - a) / step)^2 = price^2 over axes that it is above of."""
    used = (False, False, False)
    value = math.inf
    for _ in range(3):
        # The nearest of the axes that are left.
        low, axis = math.inf, -1
        for n in range(3):
            if not used[n] and behind[n][0] < low:
                low, axis = behind[n][0], n
        if axis < 0 or value <= low:
            break
        used = (used[0] or axis == 0, used[1] or axis == 1, used[2] or axis == 2)
        square, linear, rest = 0.0, 0.0, -price * price
        for n in range(3):
            if used[n]:
                rate = (behind[n][2] / step[n]) ** 2
                square += rate
                linear += rate * behind[n][1]
                rest += rate * behind[n][1] ** 2
        root = linear * linear - square * rest
        if root < 0.0 or (linear + math.sqrt(root)) / square < low:
            break
        value = (linear + math.sqrt(root)) / square
    return value


@kernel
def to_coefficients_in_space(cost, price, step):
    """Turn the values of smooth costs at the vertices into Bernstein coefficients.

    Where costs bend sharply, at edges and where two fronts meet, the values are kept.
    """
    rows, columns, levels = cost.shape
    for axis in range(3):
        up, along, over = int(axis == 0), int(axis == 1), int(axis == 2)
        for i in range(up, rows, 1 + up):
            for j in range(along, columns, 1 + along):
                for k in range(over, levels, 1 + over):
                    before = cost[i - up, j - along, k - over]
                    bend = before - 2.0 * cost[i, j, k] + cost[i + up, j + along, k + over]
                    if abs(bend) < SHARP * step[axis] * price[i, j, k]:
                        cost[i, j, k] -= 0.5 * bend


@kernel(inline="always")
def _ends(cell, place):
    """Return a vertex, and from and to which its gradient leads along one axis.

    The gradient is that of the quadratic's coefficients, raised to degree two: at the ends of a
    line the step there, in its middle the mean of both.
    """
    first = 2 * cell
    return first + place, first + (place == 2), first + 1 + (place > 0)


@kernel
def relax_in_space(cost, price, step, cells, iterations):
    """Make costs less steep where their gradient is not allowed, and change them little.

    As `relax`, with steps of each vertex' own (Pock and Chambolle 2011, "Diagonal preconditioning
    for first order primal-dual algorithms", lemma 2).

    Args:
        cost: Costs, (R, C, L), finite at the vertices of all cells; changed.
        price: Cost per metre at the vertices, (R, C, L).
        step: Metres from vertex to vertex along each axis, (3,).
        cells: Indices of the cells that paths may meet, (3, N).
        iterations: How many.
    """
    count = cells.shape[1]
    weight = _weights(cost.shape, step, cells)
    ahead, pull = cost.copy(), np.zeros(cost.shape)
    flow = np.zeros((count, 27, 3))
    unit = min(step[0], step[1], step[2])
    wy, wx, wz = unit / step[0], unit / step[1], unit / step[2]
    for _ in range(iterations):
        for n in range(count):
            for vertex in range(27):
                i, low, high = _ends(cells[0, n], vertex // 9)
                j, left, right = _ends(cells[1, n], vertex // 3 % 3)
                k, under, over = _ends(cells[2, n], vertex % 3)
                sy, sx, sz = wy / (high - low), wx / (right - left), wz / (over - under)
                size = 0.5 / max(sy, sx, sz)
                y = flow[n, vertex, 0] + size * sy * (ahead[high, j, k] - ahead[low, j, k])
                x = flow[n, vertex, 1] + size * sx * (ahead[i, right, k] - ahead[i, left, k])
                z = flow[n, vertex, 2] + size * sz * (ahead[i, j, over] - ahead[i, j, under])
                rate = math.sqrt(x * x + y * y + z * z) / (unit * price[i, j, k])
                if rate <= size:
                    flow[n, vertex, 0] = flow[n, vertex, 1] = flow[n, vertex, 2] = 0.0
                    continue
                keep = 1.0 - size / rate
                y, x, z = y * keep, x * keep, z * keep
                flow[n, vertex, 0], flow[n, vertex, 1], flow[n, vertex, 2] = y, x, z
                pull[high, j, k] += sy * y
                pull[low, j, k] -= sy * y
                pull[i, right, k] += sx * x
                pull[i, left, k] -= sx * x
                pull[i, j, over] += sz * z
                pull[i, j, under] -= sz * z
        for i in range(cost.shape[0]):
            for j in range(cost.shape[1]):
                for k in range(cost.shape[2]):
                    if weight[i, j, k] > 0.0:
                        change = pull[i, j, k] / weight[i, j, k]
                        cost[i, j, k] -= change
                        ahead[i, j, k] = cost[i, j, k] - change
                        pull[i, j, k] = 0.0


@kernel
def _weights(shape, step, cells):
    """Return the sum of the coefficients with which a vertex stands in gradients, (R, C, L)."""
    weight = np.zeros(shape)
    unit = min(step[0], step[1], step[2])
    for n in range(cells.shape[1]):
        for vertex in range(27):
            i, low, high = _ends(cells[0, n], vertex // 9)
            j, left, right = _ends(cells[1, n], vertex // 3 % 3)
            k, under, over = _ends(cells[2, n], vertex % 3)
            for end in (low, high):
                weight[end, j, k] += unit / step[0] / (high - low)
            for end in (left, right):
                weight[i, end, k] += unit / step[1] / (right - left)
            for end in (under, over):
                weight[i, j, end] += unit / step[2] / (over - under)
    return weight


@kernel
def steepness_in_space(cost, price, step, cells, top, bins):
    """Return the largest rate of gradients that share a value, by value, (B,), at least 1.

    Args:
        cost: Costs, (R, C, L), at the vertices of all cells from 0 to `top`.
        price: See `relax_in_space`.
        step: See `relax_in_space`.
        cells: See `relax_in_space`.
        top: The end of the last bin.
        bins: B, evenly from 0 on.
    """
    worst = np.ones(bins)
    for n in range(cells.shape[1]):
        for vertex in range(27):
            i, low, high = _ends(cells[0, n], vertex // 9)
            j, left, right = _ends(cells[1, n], vertex // 3 % 3)
            k, under, over = _ends(cells[2, n], vertex % 3)
            a, b = cost[low, j, k], cost[high, j, k]
            c, d = cost[i, left, k], cost[i, right, k]
            e, f = cost[i, j, under], cost[i, j, over]
            y = (b - a) / ((high - low) * step[0])
            x = (d - c) / ((right - left) * step[1])
            z = (f - e) / ((over - under) * step[2])
            rate = math.sqrt(x * x + y * y + z * z) / price[i, j, k]
            if rate > 1.0:
                least = min(a, b, c, d, e, f)
                most = max(a, b, c, d, e, f)
                for m in range(
                    max(int(least / top * bins), 0), min(int(most / top * bins), bins - 1) + 1
                ):
                    worst[m] = max(worst[m], rate)
    return worst


@kernel
def boxes_met(low, high, cells, shape, origin, edges, parts, body, met):
    """Find which boxes of a grid hold, or may hold, the centre of a body.

    Args:
        low: First of the boxes that are looked at.
        high: That after the last one.
        cells: Flat indices of boxes, (N,).
        shape: Boxes along y, x and z, (3,).
        origin: Corner of the first box, (3,), metres.
        edges: Edges of a box, (3,), metres.
        parts: Into how many parts each is divided, (3,).
        body: What `sphere_free` takes behind the ends, of a body that is free in the middle of a
            part if the robot's is free anywhere in it.
        met: Filled where a box is looked at, bool, flat.
    """
    for n in range(low, high):
        cell = cells[n]
        i, j, k = cell // (shape[1] * shape[2]), cell // shape[2] % shape[1], cell % shape[2]
        met[cell] = False
        for part in range(parts[0] * parts[1] * parts[2]):
            a, b, c = part % parts[0], part // parts[0] % parts[1], part // (parts[0] * parts[1])
            y = origin[0] + (i + (a + 0.5) / parts[0]) * edges[0]
            x = origin[1] + (j + (b + 0.5) / parts[1]) * edges[1]
            z = origin[2] + (k + (c + 0.5) / parts[2]) * edges[2]
            if sphere_free(x, y, z, x, y, z, *body):
                met[cell] = True
                break
