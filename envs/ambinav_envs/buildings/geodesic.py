"""Costs to go over a lattice: the cost of the cheapest path from every cell to one point.

The cells of a lattice are joined in 16 directions, so a path is at most 2.8 % longer than the
straight one. Every step costs at least the length of a cell, so with buckets of that width what
stands in the first bucket is final (Dinitz 1978; Denardo & Fox 1979, "Shortest-route methods: 1.
reaching, pruning, and buckets", Operations Research 27(1)): Dijkstra's algorithm without a heap.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.geometry import lattice
from ambinav.runtime.kernels import kernel

STEPS = np.vstack(
    [lattice.STEPS, [[2, 1], [1, 2], [-1, 2], [-2, 1], [-2, -1], [-1, -2], [1, -2], [2, -1]]]
).astype(np.int64)
"""Column and row steps to 16 neighbours; the first eight are those of `lattice.STEPS`."""
LENGTHS = np.hypot(STEPS[:, 0], STEPS[:, 1])
SIDES = 8
"""Number of the steps that lead to a neighbouring cell."""
# Width of a bucket, in cells: a little less than a step, for rounding.
_WIDTH = 0.999
REACH = 2.5
"""Cells: no step is longer, and no seed farther from the goal."""
_FAR = np.float32(np.inf)
# Bits of `lattice.STEPS` towards a column step and a row step of -1 or 1, at [row > 0, column > 0].
_SIDEWAYS = np.array([4, 0])
_UPWARDS = np.array([6, 2])
_SLANTING = np.array([[5, 7], [3, 1]])


@kernel
def geodesic(seeds, first, moves, links, prices, spacing, field):
    """Write the cost of the cheapest path from each cell to the seeds, metres times their prices.

    Cells that no path leads to, but that no wall parts from one that a path leads to, get the
    length of a path that may be too narrow: a robot that stands there is nearer to some cell of
    the lattice than the lattice knows.

    Args:
        seeds: Running numbers (row * columns + column) of the cells next to the goal, int64, (K,).
        first: What the straight line from each to the goal costs, at the price of its own cell,
            metres, float64, (K,); it is at most `REACH` cells long.
        moves: Bit k of a cell: the robot gets to it from its neighbour at STEPS[k]; uint16, shape
            (rows, columns). No step may leave the lattice.
        links: Bit k of a cell: no wall parts it from its neighbour at STEPS[k], k < SIDES; uint8,
            shape (rows, columns).
        prices: What a metre costs at a cell where the robot drives in one of H headings, at least
            1; float32, shape (rows, columns, H). A step costs the mean of its ends' prices. Ones
            for the shortest path.
        spacing: Distance between cells, metres.
        field: Costs, float32, shape (rows, columns); inf where nothing leads to.
    """
    columns = moves.shape[1]
    flat, open_moves, price = field.ravel(), moves.ravel(), prices.reshape(-1, prices.shape[2])
    flat[:] = _FAR
    offsets = STEPS[:, 1] * columns + STEPS[:, 0]
    lengths = (LENGTHS * spacing).astype(np.float32)
    headings = _step_headings(prices.shape[2])
    per_metre = np.float32(1.0 / (_WIDTH * spacing))
    # A cell stands at most once in a bucket; where it has moved to a nearer one, it is left
    # behind and passed over.
    buckets = int(REACH * prices.max() / _WIDTH) + 2
    stack = np.empty((buckets, flat.size), dtype=np.int32)
    height = np.zeros(buckets, dtype=np.int64)
    waiting, now = seeds.size, 0
    for s in range(seeds.size):
        flat[seeds[s]] = first[s]
        bucket = int(flat[seeds[s]] * per_metre)
        now = bucket if s == 0 else min(now, bucket)
        stack[bucket % buckets, height[bucket % buckets]] = seeds[s]
        height[bucket % buckets] += 1
    while waiting > 0:
        top = now % buckets
        if height[top] == 0:
            now += 1
            continue
        height[top] -= 1
        waiting -= 1
        cell = np.int64(stack[top, height[top]])
        here = flat[cell]
        if int(here * per_metre) != now:
            continue
        bits = np.int64(open_moves[cell])
        for k in range(offsets.size):
            if bits & (1 << k):
                other = cell + offsets[k]
                distance = here + _cost(price, cell, other, headings[k], lengths[k])
                before = flat[other]
                if distance < before:
                    flat[other] = distance
                    bucket = int(distance * per_metre)
                    if before == _FAR or int(before * per_metre) != bucket:
                        bucket %= buckets
                        stack[bucket, height[bucket]] = other
                        height[bucket] += 1
                        waiting += 1
    _fill(flat, links.ravel(), price, offsets, lengths, headings)


@kernel
def follow(moves, prices, spacing, field, towards):
    """Write the direction of the cheapest path from each cell of a field by `geodesic`.

    A step is the better the more it brings for its cost less its length: of steps along the
    cheapest path the longest, and one that is longer still may cost a little more. So paths lead
    round corners in wide turns, and cost up to a tenth more than the least.

    Args:
        moves: See `geodesic`, as prices, spacing and field.
        prices: See there.
        spacing: See there.
        field: See there.
        towards: The path leads to the neighbour at -STEPS[towards]; int8, shape (rows, columns),
            negative where no step leads nearer to the goal.
    """
    rows, columns = field.shape
    headings = _step_headings(prices.shape[2])
    towards[:] = -1
    for row in range(rows):
        for column in range(columns):
            least = field[row, column]
            for k in range(len(STEPS)):
                # Bit k of a cell: the robot gets to it from its neighbour at STEPS[k].
                c, r = column - STEPS[k, 0], row - STEPS[k, 1]
                inside = 0 <= c < columns and 0 <= r < rows
                if inside and moves[r, c] & (1 << k) and field[r, c] < least:
                    mean = 0.5 * (prices[row, column, headings[k]] + prices[r, c, headings[k]])
                    left = field[r, c] + (mean - 1.0) * LENGTHS[k] * spacing
                    if left < least:
                        least, towards[row, column] = left, k


@kernel
def _step_headings(count):
    """Return the heading index of a robot that enters a cell from each neighbour at `STEPS`."""
    turns = np.empty(len(STEPS), dtype=np.int64)
    for k in range(len(STEPS)):
        turns[k] = heading_of(-STEPS[k, 0], -STEPS[k, 1], count)
    return turns


@kernel
def heading_of(dx, dy, count):
    """Return the index of the heading that is nearest to a direction."""
    if count == 1:
        return 0
    return int(math.floor(math.atan2(dy, dx) * count / (2.0 * math.pi) + 0.5)) % count


@kernel(inline="always")
def _cost(price, cell, other, heading, length):
    """Return the cost of a step of a given length, metres."""
    return length * (np.float32(0.5) * (price[cell, heading] + price[other, heading]))


@kernel
def _fill(flat, links, price, offsets, lengths, headings):
    """Extend distances from known cells into neighbours that no wall separates from them.

    These are few if any, so this is short rather than quick: a cell may be taken more than once.
    """
    known = flat != _FAR
    waits = np.zeros(flat.size, dtype=np.bool_)
    queue = np.empty(flat.size, dtype=np.int32)
    head, count = 0, 0
    for cell in range(flat.size):
        if known[cell]:
            for k in range(SIDES):
                if links[cell] & (1 << k) and not known[cell + offsets[k]]:
                    queue[count] = cell
                    count += 1
                    break
    while count > 0:
        cell = np.int64(queue[head])
        head = (head + 1) % flat.size
        count -= 1
        waits[cell] = False
        for k in range(SIDES):
            if links[cell] & (1 << k):
                other = cell + offsets[k]
                distance = flat[cell] + _cost(price, cell, other, headings[k], lengths[k])
                if distance < flat[other] and not known[other]:
                    flat[other] = distance
                    if not waits[other]:
                        waits[other] = True
                        queue[(head + count) % flat.size] = other
                        count += 1


@kernel(forceinline=True)
def distance_at(x, y, field, links, low_x, low_y, inverse):
    """Return the cost to go from a point of the field; inf without a path to the goal.

    Linear between the cells around the point, as far as no wall parts them from the nearest one.
    That one is on the point's side of any wall if a robot of at least 0.71 cells of radius fits
    at the point.

    Args:
        x: Metres, map frame.
        y: The same.
        field: Output of `geodesic`.
        links: The same that it took.
        low_x: x of the centre of cell (0, 0), metres.
        low_y: y of it.
        inverse: Cells per metre.
    """
    u, v = (x - low_x) * inverse, (y - low_y) * inverse
    if not (u > -0.5 and v > -0.5 and u < field.shape[1] - 0.5 and v < field.shape[0] - 0.5):
        return math.inf
    column, row = int(u + 0.5), int(v + 0.5)
    if field[row, column] == _FAR:
        return math.inf
    a, b = u - column, v - row
    right, up = int(a > 0.0), int(b > 0.0)
    over, above = column + 2 * right - 1, row + 2 * up - 1
    a, b = abs(a), abs(b)
    bits = links[row, column]
    weight = (1.0 - a) * (1.0 - b)
    total = weight * field[row, column]
    if bits & (1 << _SIDEWAYS[right]):
        weight += a * (1.0 - b)
        total += a * (1.0 - b) * field[row, over]
    if bits & (1 << _UPWARDS[up]):
        weight += (1.0 - a) * b
        total += (1.0 - a) * b * field[above, column]
    if bits & (1 << _SLANTING[up, right]):
        weight += a * b
        total += a * b * field[above, over]
    return total / weight
