"""Search of a belief roadmap for a short path with a small covariance at the goal.

Prentice & Roy (2009, IJRR 28(11-12), section 5) look for the least trace at the goal, whatever the
length, and keep for every node the one covariance of the least trace that was found. Here the
length counts too, and the deviation is that in the weak direction: a path to a node is gone on with
unless a shorter one has left a deviation that is no larger. As theirs, that is a rule of thumb: one
with a larger deviation can be the better one to go on with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_nonnegative
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav_planners.belief.roadmap import BeliefRoadmap, turn_on_the_spot
from ambinav_planners.belief.transfer import carried, compose
from ambinav_planners.search.costs_to_go import cost_to_go
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
    reversed_graph,
)

# So many paths of the last few motions are looked at for the bound at the goal: a few milliseconds.
ENDINGS = 10_000
# And of no more motions than this: on a graph of few nodes there are never many paths.
LAST_MOTIONS = 20


class Terms(NamedTuple):
    """Weights of the objective, and the limits of the search; see `search_roadmap`.

    Attributes:
        weight: Metres of path that a metre less of deviation at the goal is worth.
        most: Largest deviation, metres.
        most_at_goal: Largest deviation at the goal, metres.
        margin: 1 + the tolerance.
    """

    weight: float
    most: float
    most_at_goal: float
    margin: float


@dataclass(frozen=True, eq=False)
class BeliefPath:
    """A path and the covariances along it.

    Attributes:
        path: The path; its cost is its length plus weight times the deviation at the goal, metres.
        covariances: At the nodes of the path, shape (N, 3, 3): x, y, theta, metres and radians.
    """

    path: SearchPath
    covariances: Floats


def search_roadmap(
    roadmap: BeliefRoadmap,
    start: int,
    goal: int,
    covariance: ArrayLike,
    *,
    weight: float = 50.0,
    max_std: float = math.inf,
    max_goal_std: float = math.inf,
    tolerance: float = 0.0,
) -> BeliefPath | None:
    """Find the path of least length + weight * deviation at the goal.

    The path may pass a node twice: going on to a place that tells more and coming back is worth it
    at a large weight.

    Args:
        roadmap: The motions and what they do to the covariance.
        start: A node.
        goal: A node.
        covariance: Covariance of the pose at the start, shape (3, 3), may be singular.
        weight: Metres of path that a metre less of deviation at the goal is worth.
        max_std: Largest deviation at any node of the path, metres.
        max_goal_std: Largest deviation at the goal, metres.
        tolerance: A longer path to a node is gone on with only if its variance is lower by more
            than this share. Above 0 the figures of the path are still its own, but a slightly
            better one, or one that keeps to `max_std` by less than that share, may be missed.

    Returns:
        The path, or None if there is none that keeps to the limits.

    Raises:
        InputError: bad weight, limit, tolerance, covariance or node.
    """
    weight, tolerance = as_nonnegative(weight, "weight"), as_nonnegative(tolerance, "tolerance")
    for name, value in (("max_std", max_std), ("max_goal_std", max_goal_std)):
        if not value > 0.0:
            raise InputError(f"{name} is {value}; give metres above 0, or inf.")
    first = checked_covariance(covariance)
    graph = roadmap.graph
    start, goal = check_node(graph, "start", start), check_node(graph, "goal", goal)
    ahead = cost_to_go(graph, graph.length, goal)
    if not math.isfinite(ahead[start]) or deviation(first) > max_std:
        return None
    blocks = roadmap.carry, roadmap.noise, roadmap.seen
    turned_round = reversed_graph(graph.first, graph.target)
    floor = weight * _least_ending(*turned_round, *blocks, start, goal)
    terms = Terms(float(weight), float(max_std), float(max_goal_std), 1.0 + tolerance)
    motions, cost, labels = _search(
        graph.arrays, roadmap.arrays, first, terms, ahead, floor, start, goal
    )
    if labels < 0:
        return None
    path = path_back(graph, start, motions, cost, labels)
    return BeliefPath(path, roadmap.along(path.motions, first))


def checked_covariance(covariance: ArrayLike) -> Floats:
    """Return the covariance as float64, shape (3, 3), after checks.

    Raises:
        InputError: it has another shape, is not symmetric, or is negative in some direction.
    """
    out = np.array(covariance, dtype=np.float64)
    if out.shape != (3, 3) or not np.isfinite(out).all():
        raise InputError("covariance is not 3 x 3 finite numbers; give x, y, theta.")
    size = float(np.abs(out).max())
    if not np.allclose(out, out.T, rtol=0.0, atol=1e-9 * size):
        raise InputError("covariance is not symmetric; give one of x, y, theta.")
    lowest = float(np.linalg.eigvalsh(out)[0])
    if lowest < -1e-9 * size:
        raise InputError(f"covariance has the eigenvalue {lowest:g}; none may be below 0.")
    return out


@kernel
def deviation(s):
    """Return a covariance's deviation of the position in the weak direction, metres."""
    trace = s[0, 0] + s[1, 1]
    trace = 0.5 * trace + math.hypot(0.5 * (s[0, 0] - s[1, 1]), s[0, 1])
    return math.sqrt(max(trace, 0.0))


@kernel
def _least_ending(first, source, motion, carry, noise, seen, start, goal):
    """Return a lower bound of the deviation at the goal over all paths.

    Of what went before the last few motions, even perfect knowledge ends with their noise.
    """
    nodes = np.full(1, goal, dtype=np.int64)
    f, n, o = np.zeros((1, 3, 3)), np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    f[0] = np.eye(3)
    least, shorter = 0.0, math.inf
    if start == goal:
        return least
    for _ in range(LAST_MOTIONS):
        count = 0
        for node in nodes:
            count += first[node + 1] - first[node]
        if count > ENDINGS or count == 0:
            return least
        before = np.empty(count, dtype=np.int64)
        fs, ns, os = np.empty((count, 3, 3)), np.empty((count, 3, 3)), np.empty((count, 3, 3))
        at, lowest = 0, math.inf
        for i in range(nodes.size):
            for k in range(first[nodes[i]], first[nodes[i] + 1]):
                e = motion[k]
                fs[at], ns[at], os[at] = compose(carry[e], noise[e], seen[e], f[i], n[i], o[i])
                before[at] = source[k]
                ending = deviation(ns[at])
                lowest = min(lowest, ending)
                if source[k] == start:  # nothing went before
                    shorter = min(shorter, ending)
                at += 1
        least = min(lowest, shorter)
        nodes, f, n, o = before, fs, ns, os
    return least


@kernel
def _turned(covariance, last, to, heading, odometry):
    """Return a covariance after the turn from motion `last` (-1: none) to motion `to`."""
    out = covariance.copy()
    if last >= 0:
        turn_on_the_spot(out, heading[last], heading[to], odometry)
    return out


@kernel
def _covered(last, covariance, candidate, margin):
    """Return whether the last label of the node (-1: none), its lowest, covers a covariance."""
    return last >= 0 and deviation(covariance[last]) <= math.sqrt(margin) * deviation(candidate)


@kernel
def _search(graph, roadmap, covariance, terms, ahead, floor, start, goal):
    """Return motions from goal to start, their cost, and the number of labels (-1: no path)."""
    first, target, length = graph
    carry, noise, seen, heading, odometry = roadmap
    weight, most, most_at_goal, margin = terms
    nodes = first.size - 1
    newest = np.full(nodes, -1, dtype=np.int64)  # last expanded label of each node
    labels = no_labels()
    add_label(labels, 0, 0, start, -1, -1, 0.0, ahead[start])
    covariances = np.empty((ROOM, 3, 3))
    covariances[0] = covariance
    count, size, taken = 1, 1, 0
    best, best_label = math.inf, -1
    while size > 0 and labels.keys[0] + floor < best:
        label = labels.items[0]
        drop_first(labels.keys, labels.items, size)
        size -= 1
        node, last, gone = labels.at[label], labels.motion[label], labels.spent[label]
        if _covered(newest[node], covariances, covariances[label], margin):
            continue
        newest[node] = label
        taken += 1
        if node == goal:
            left = deviation(covariances[label])
            total = gone + weight * left
            if total < best and left <= most_at_goal:
                best, best_label = total, label
        for e in range(first[node], first[node + 1]):
            to = target[e]
            total = gone + length[e]
            if total + ahead[to] + floor >= best:
                continue
            ready = _turned(covariances[label], last, e, heading, odometry)
            ending = carried(carry[e], noise[e], seen[e], ready)
            if deviation(ending) > most:
                continue
            if _covered(newest[to], covariances, ending, margin):
                continue
            if count == labels.at.size:
                labels, covariances = more_room(labels), grown(covariances)
            add_label(labels, count, size, to, label, e, total, total + ahead[to])
            covariances[count] = ending
            count, size = count + 1, size + 1
    if best_label < 0:
        return np.empty(0, dtype=np.int64), math.inf, -1
    return motions_back(best_label, labels.parent, labels.motion), best, taken
