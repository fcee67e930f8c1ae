"""The path of least cost for a robot whose uncertainty grows by odometry and shrinks by scans.

Roy & Thrun (1999, "Coastal navigation with mobile robots", NIPS 12) add the uncertainty as one
more dimension of the state; Gonzalez & Stentz (2005, "Planning with uncertainty in position: an
optimal and efficient planner", IROS; 2007, "... using high-resolution maps", ICRA) keep the
standard deviation sigma of an isotropic position beside the cell, and need no grid over it: of
two paths to a place, one that costs more and leaves a larger sigma can be dropped. So does this,
after them.

What happens to sigma is our own model. A metre of travel adds q to its square, what the robot's
odometry adds in its worse direction from scan to scan (`OdometryNoise.growth`; turns on the spot
are not counted). Every scan_distance metres a scan adds the map's information in its weakest
direction, 1/sigma^2 grows by I. Spread evenly over the metres, the two make a Riccati equation for
p = sigma^2,

    dp/ds = q - b p^2,    q = growth(scan_distance),    b = I / scan_distance,

which for constant b has the solution

    p(s) = (p + r t) / (1 + p t / r),    r = sqrt(q / b),    t = tanh(sqrt(q b) s),

so it does not matter how finely a path is cut into motions. A route costs the integral of
1 + weight * sigma / reference over its length. A larger sigma at the start of a motion leaves a
larger one at its end and costs at least as much: that is why dropping labels loses nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ambinav.config import as_nonnegative, as_positive
from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.information_field import InformationField
from ambinav.geometry.motion.curves import pieces_of, pose_along
from ambinav.maps.lattice_values import value_at
from ambinav.runtime.array_types import Floats, Indices, Ints
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.search.costs_to_go import cost_to_go
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.labels import (
    ROOM,
    SearchPath,
    add_label,
    check_node,
    drop_first,
    grown,
    more_room,
    motions_back,
    no_labels,
    path_back,
)


class GrowthArrays(NamedTuple):
    """The arrays of a `Growth` for the kernels; see there."""

    first: Ints
    add: Floats
    shrink: Floats


class Terms(NamedTuple):
    """Weights of the objective, and the limits of the search.

    Attributes:
        price: Extra cost of a metre at a standard deviation of 1 m, 1/m.
        variance: At the start, m^2.
        most: Largest variance, m^2.
        most_at_goal: Largest variance at the goal, m^2.
        margin: 1 + the tolerance of `belief_search`.
    """

    price: float
    variance: float
    most: float
    most_at_goal: float
    margin: float


@dataclass(frozen=True, eq=False)
class Growth:
    """Effect of each motion of a graph on the variance, in pieces of constant information.

    Half a piece takes the variance p to (p + add) / (1 + p shrink).

    Attributes:
        first: int64, shape (E + 1,): the pieces of motion e are first[e]:first[e + 1], of equal
            length.
        add: float64, shape (P,), m^2.
        shrink: float64, shape (P,), 1/m^2.
    """

    first: Ints
    add: Floats
    shrink: Floats

    @classmethod
    def of(
        cls,
        graph: MotionGraph,
        information: InformationField,
        model: BeliefModel,
        odometry: OdometryNoise,
        step: float = 0.5,
    ) -> Growth:
        """Compute it with the information in the middle of pieces of at most `step` metres.

        Raises:
            InputError: the step is not above 0.
        """
        step = as_positive(step, "step", "metres")
        pieces = np.maximum(np.ceil(graph.length / step - 1e-9), 1.0).astype(np.int64)
        first = np.concatenate([[0], np.cumsum(pieces)])
        add, shrink = np.empty(first[-1]), np.empty(first[-1])
        growth = cls(first, add, shrink)
        run_rows(
            _grow, len(graph.poses), graph.steering.kind, graph.steering.kernel_radius,
            graph.poses, graph.arrays, information.weak, *information.lattice,
            odometry.growth(model.scan_distance), model.scan_distance, growth.arrays, least=16,
        )  # fmt: skip
        return growth

    @property
    def arrays(self) -> GrowthArrays:
        """The pieces for the kernels."""
        return GrowthArrays(self.first, self.add, self.shrink)

    @property
    def floor(self) -> float:
        """Variance below which no motion takes a larger one, m^2."""
        lowest = np.where(
            self.shrink > 0.0, self.add / np.where(self.shrink > 0.0, self.shrink, 1.0), math.inf
        )
        return math.sqrt(lowest.min(initial=math.inf))


@dataclass(frozen=True, eq=False)
class Belief:
    """A path and the standard deviation along it.

    Attributes:
        path: The path; its cost is the integral of 1 + weight * sigma / reference.
        std: Standard deviation at the nodes of the path, metres, shape (N,).
    """

    path: SearchPath
    std: Floats


def belief_search(
    graph: MotionGraph,
    growth: Growth,
    model: BeliefModel,
    start: int,
    goal: int,
    *,
    tolerance: float = 0.0,
) -> Belief | None:
    """Find the path of least cost over nodes and standard deviations.

    Args:
        graph: The motions.
        growth: Effect of the motions on the variance.
        model: Start, costs and limits.
        start: A node.
        goal: A node.
        tolerance: A dearer path to a node is gone on with only if its variance is lower by more
            than this share. With 0 the result is exactly the best there is. Above 0 the cost and
            deviation reported are still those of the path reported, but a better one, or one
            that keeps to a limit by less than that share, may be missed.

    Returns:
        The path, or None if no path keeps to the limits.

    Raises:
        InputError: a node that is not there, or a tolerance below 0.
    """
    tolerance = as_nonnegative(tolerance, "tolerance")
    start, goal = check_node(graph, "start", start), check_node(graph, "goal", goal)
    if model.std > model.max_std:
        return None
    price = model.weight / model.reference
    variance = model.std**2
    least = price * math.sqrt(min(variance, growth.floor))
    ahead = cost_to_go(graph, graph.length * (1.0 + least), goal)
    if not math.isfinite(ahead[start]):
        return None
    terms = Terms(
        float(price), float(variance), model.max_std**2, model.max_goal_std**2, 1.0 + tolerance
    )
    motions, cost, labels = _search(graph.arrays, growth.arrays, terms, ahead, start, goal)
    if labels < 0:
        return None
    path = path_back(graph, start, motions, cost, labels)
    return Belief(path, std_along(growth, path.motions, model.std))


def std_along(growth: Growth, motions: Indices, std: float) -> Floats:
    """Return the standard deviation at the nodes of a path, metres, shape (motions + 1,)."""
    out = np.empty(len(motions) + 1)
    _std_along(growth.arrays, motions, std, out)
    return out


@kernel
def _grow(
    begin, end, kind, radius, poses, graph, weak, left, low, inverse, q, scan_distance, growth
):  # fmt: skip
    first, target, length = graph
    piece, add, shrink = growth
    per_turn = weak.shape[2] / (2.0 * math.pi)
    for n in range(begin, end):
        for e in range(first[n], first[n + 1]):
            a, b = poses[n], poses[target[e]]
            pieces = pieces_of(kind, radius, a, b)
            count = piece[e + 1] - piece[e]
            half = 0.5 * length[e] / count
            for k in range(count):
                x, y, theta = pose_along(kind, pieces, length[e], a, b, (k + 0.5) / count)
                weak_rate = value_at(
                    (x - left) * inverse, (y - low) * inverse, theta * per_turn, weak
                )
                rate = weak_rate / scan_distance
                at = piece[e] + k
                if q == 0.0 or rate <= 0.0:
                    add[at], shrink[at] = q * half, max(rate, 0.0) * half
                else:
                    root = math.sqrt(q / rate)
                    turned = math.tanh(math.sqrt(q * rate) * half)
                    add[at], shrink[at] = root * turned, turned / root


@kernel
def _std_along(growth, motions, std, out):
    piece, add, shrink = growth
    p = std * std
    out[0] = std
    for k in range(motions.size):
        for j in range(piece[motions[k]], piece[motions[k] + 1]):
            for _ in range(2):
                p = (p + add[j]) / (1.0 + p * shrink[j])
        out[k + 1] = math.sqrt(p)


@kernel
def _search(graph, growth, terms, ahead, start, goal):
    """Return motions from goal to start, their cost, and the number of labels (-1: no path)."""
    first, target, length = graph
    piece, add, shrink = growth
    price, variance, most, most_at_goal, margin = terms
    nodes = first.size - 1
    least = np.full(nodes, math.inf)  # the lowest variance that a node was left with
    waiting_cost = np.full(nodes, math.inf)  # the cheapest label in the heap, and its variance
    waiting_var = np.full(nodes, math.inf)
    labels = no_labels()
    add_label(labels, 0, 0, start, -1, -1, 0.0, ahead[start])
    var = np.empty(ROOM)
    var[0] = variance
    count, size, taken = 1, 1, 0
    while size > 0:
        label = labels.items[0]
        drop_first(labels.keys, labels.items, size)
        size -= 1
        node, so_far, before = labels.at[label], labels.spent[label], var[label]
        if before * margin >= least[node]:
            continue
        least[node] = before
        taken += 1
        if node == goal and before <= most_at_goal:
            return motions_back(label, labels.parent, labels.motion), so_far, taken
        sigma = math.sqrt(before)
        for e in range(first[node], first[node + 1]):
            to = target[e]
            bound = least[to]
            if ahead[to] == math.inf:
                continue
            p, before_std, unsure = before, sigma, 0.0
            allowed = True
            for j in range(piece[e], piece[e + 1]):
                middle = (p + add[j]) / (1.0 + p * shrink[j])
                p = (middle + add[j]) / (1.0 + middle * shrink[j])
                allowed = allowed and p <= most
                after_std = math.sqrt(p)
                unsure += before_std + 4.0 * math.sqrt(middle) + after_std
                before_std = after_std
            # Simpson's rule over each piece.
            mean = unsure / (6.0 * (piece[e + 1] - piece[e]))
            total = so_far + length[e] * (1.0 + price * mean)
            if not allowed or p * margin >= bound:
                continue
            if total >= waiting_cost[to] and p * margin >= waiting_var[to]:
                continue
            if total <= waiting_cost[to]:
                waiting_cost[to], waiting_var[to] = total, p
            if count == labels.at.size:
                labels, var = more_room(labels), grown(var)
            add_label(labels, count, size, to, label, e, total, total + ahead[to])
            var[count] = p
            count, size = count + 1, size + 1
    return np.empty(0, dtype=np.int64), math.inf, -1
