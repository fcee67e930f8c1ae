"""The cheapest cycle through all nodes of a small complete graph (asymmetric travelling salesman).

Each node has one arc in and one out, which leaves cycles that are too short. For each such cycle of
a solution a constraint is added, that its nodes have fewer arcs among them, until none is left
(Dantzig, Fulkerson & Johnson 1954, "Solution of a large-scale traveling-salesman problem",
J. Oper. Res. Soc. Am. 2(4)). The mixed-integer programs are HiGHS's.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array, vstack

from ambinav.runtime.array_types import Floats, Indices

INFEASIBLE = 2
"""Status of a program without a solution (`scipy.optimize.milp`)."""


class Cycle(NamedTuple):
    """A cycle through all nodes.

    Attributes:
        order: Nodes, beginning with 0.
        cost: Its cost.
        bound: No cycle costs less; `cost` if it is the cheapest.
    """

    order: tuple[int, ...]
    cost: float
    bound: float


def cheapest_cycle(cost: Floats, seconds: float = 10.0) -> Cycle | None:
    """Find the cheapest cycle through all nodes.

    Args:
        cost: Of the arc from i to j, shape (n, n); inf where there is none. The diagonal is not
            looked at.
        seconds: Time after which the best cycle so far is put together from parts.

    Returns:
        The cycle; None where there is none.
    """
    count, until = len(cost), time.monotonic() + seconds
    if count == 1:
        return Cycle((0,), 0.0, 0.0)
    source, target = np.nonzero(np.isfinite(cost) & ~np.eye(count, dtype=np.bool_))
    if not len(source):
        return None
    arcs = np.arange(len(source))
    ones = np.ones(len(source))
    shape = count, len(source)
    degrees = vstack([coo_array((ones, (end, arcs)), shape) for end in (source, target)])
    rows: list[csr_array] = [
        _among((i, j), source, target) for i in range(count) for j in range(i) if count > 2
    ]
    upper = [1.0] * len(rows)
    bound = 0.0
    while True:
        constraints = [LinearConstraint(degrees, 1.0, 1.0)]
        if rows:
            constraints.append(LinearConstraint(vstack(rows), -math.inf, np.array(upper)))
        solution = milp(
            cost[source, target], integrality=ones, bounds=Bounds(0.0, 1.0),
            constraints=constraints,
            options={"time_limit": max(until - time.monotonic(), 0.1), "mip_rel_gap": 0.0},
        )  # fmt: skip
        if solution.status == INFEASIBLE:
            return None
        cycles: list[tuple[int, ...]] = [(node,) for node in range(count)]
        if solution.x is not None:
            after = np.empty(count, dtype=np.intp)
            chosen = solution.x > 0.5
            after[source[chosen]] = target[chosen]
            cycles = _cycles(after)
            bound = max(bound, float(solution.mip_dual_bound))
        if len(cycles) == 1 or solution.x is None or time.monotonic() >= until:
            order = cycles[0] if len(cycles) == 1 else _put_together(cycles, cost)
            total = _cost_of(order, cost)
            if not math.isfinite(total):
                return None
            exact = len(cycles) == 1 and solution.status == 0
            return Cycle(order, total, total if exact else min(bound, total))
        rows += [_among(cycle, source, target) for cycle in cycles]
        upper += [len(cycle) - 1.0 for cycle in cycles]


def _among(nodes: tuple[int, ...], source: Indices, target: Indices) -> csr_array:
    """Return the row that counts the arcs among some nodes."""
    row = (np.isin(source, nodes) & np.isin(target, nodes)).astype(np.float64)
    return csr_array(row[np.newaxis])


def _cycles(after: Indices) -> list[tuple[int, ...]]:
    """Return the cycles of a permutation, that of node 0 first."""
    seen, cycles = np.zeros(len(after), dtype=np.bool_), []
    for first in range(len(after)):
        cycle, node = [], first
        while not seen[node]:
            seen[node] = True
            cycle.append(node)
            node = int(after[node])
        if cycle:
            cycles.append(tuple(cycle))
    return cycles


def _put_together(cycles: list[tuple[int, ...]], cost: Floats) -> tuple[int, ...]:
    """Insert cycles into the first, each where that costs least."""
    order = cycles[0]
    for cycle in cycles[1:]:
        candidates = [
            (*order[:k], *cycle[j:], *cycle[:j], *order[k:])
            for k in range(1, len(order) + 1)
            for j in range(len(cycle))
        ]
        order = min(candidates, key=lambda candidate: _cost_of(candidate, cost))
    return order


def _cost_of(order: tuple[int, ...], cost: Floats) -> float:
    return float(cost[list(order), [*order[1:], order[0]]].sum())
