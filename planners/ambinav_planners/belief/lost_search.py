"""The shortest path on which at most a given share of robots gets lost, over place and belief.

A label is a path to a node of the map's lattice with what the filter of a forecast knows there
(`ambinav.forecasting.filter_kernel`): two Gaussians and the share lost so far, which never falls.
Paths that have lost more than allowed are given up. Labels are taken in the order of length plus
length to go (A*), so one that comes later to a node is longer; it is dropped if an earlier
one has lost no more, and its variances of position and heading are no larger. Values count as equal
that differ by less than a third; so do lost shares below a twentieth of what is allowed, and
deviations below 5 cm and 2 degrees.

It is the resource-constrained shortest path of Desrochers & Soumis (1988, "A generalized permanent
labelling algorithm for the shortest path problem with time windows", INFOR 26(3)) with the filter
as resource. Where the deviations of two labels are in different directions the comparison is a rule
of thumb, and turns between motions of the lattice, which the finished route need not take, add
nothing here: what comes out is a candidate, to be forecast itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.forecasting.filter_kernel import axes, between, filter_room, filter_step
from ambinav.forecasting.forecast import Forecaster
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel
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

TOLERANCE = 4.0 / 3.0
"""Shares and variances that differ by less than this factor are the same."""
NEGLIGIBLE_SHARE = 0.05
"""Lost shares below this part of the allowed one are the same."""
NEGLIGIBLE_STD = (0.05, math.radians(2.0))
"""Deviations below these, metres and radians, are the same."""
MOST_LABELS = 200_000
"""Paths to nodes that the search keeps at most; then it gives up, after some seconds."""


class Terms(NamedTuple):
    """Limits of the search.

    Attributes:
        most: Largest lost share, before calibration.
        longest: Length that a path must be below, metres.
        labels: Number of labels at which it gives up.
    """

    most: float
    longest: float
    labels: int


class _Beliefs(NamedTuple):
    """State of the filter of each label (`filter_step`), and the label of its node before it."""

    cov: Floats
    whole: Floats
    outside: Floats
    tracked: Floats
    size: Floats
    before: Ints


def search_within(
    graph: MotionGraph,
    forecaster: Forecaster,
    start: int,
    goal: int,
    max_lost: float,
    *,
    longest: float = math.inf,
    most_labels: int = MOST_LABELS,
) -> SearchPath | None:
    """Find a short path on which at most a share of the robots is forecast to get lost.

    Args:
        graph: Straight motions, the robot facing along them. Their length is `fixed`, with the
            metres that the cost adds.
        forecaster: Forecaster of the graph's map.
        start: A node.
        goal: A node.
        max_lost: Largest share.
        longest: Longer paths are of no use, metres.
        most_labels: How many paths to nodes may be kept.

    Returns:
        The path, with its length as cost; None if none was found.

    Raises:
        InputError: there is no such node.
    """
    start, goal = check_node(graph, "start", start), check_node(graph, "goal", goal)
    ahead = cost_to_go(graph, graph.fixed, goal)
    if not ahead[start] < longest:
        return None
    terms = Terms(forecaster.localizer.raw(max_lost), float(longest), int(most_labels))
    field = forecaster.field
    arrays = graph.arrays._replace(length=graph.fixed)
    motions, length, labels = _search(
        arrays, graph.poses, forecaster.start, field.fields, field.lattice,
        forecaster.odometry.packed, forecaster.settings, terms, ahead, start, goal,
    )  # fmt: skip
    return path_back(graph, start, motions, length, labels) if labels >= 0 else None


@kernel
def _no_beliefs():
    return _Beliefs(
        np.empty((ROOM, 3, 3)), np.empty((ROOM, 3, 3)), np.empty(ROOM), np.empty(ROOM),
        np.empty((ROOM, 3)), np.empty(ROOM, dtype=np.int64),
    )  # fmt: skip


@kernel
def _more_beliefs(b):
    return _Beliefs(
        grown(b.cov), grown(b.whole), grown(b.outside), grown(b.tracked), grown(b.size),
        grown(b.before),
    )  # fmt: skip


@kernel
def _measure(cov, lost, most, out):
    """Write the measures of a label: lost share, variance along the weak axis, of the heading."""
    out[0] = max(lost, NEGLIGIBLE_SHARE * most)
    out[1] = max(axes(cov)[0], NEGLIGIBLE_STD[0] * NEGLIGIBLE_STD[0])
    out[2] = max(cov[2, 2], NEGLIGIBLE_STD[1] * NEGLIGIBLE_STD[1])


@kernel
def _covered(last, before, sizes, size):
    """Return whether a label of a node, from `last` back, is no worse than what has this size."""
    label = last
    while label >= 0:
        known = sizes[label]
        if (
            known[0] <= TOLERANCE * size[0]
            and known[1] <= TOLERANCE * size[1]
            and known[2] <= TOLERANCE * size[2]
        ):
            return True
        label = before[label]
    return False


@kernel
def _search(graph, poses, covariance, fields, lattice, noise, settings, terms, ahead, start, goal):
    """Return motions from goal to start, their length, and the number of labels (-1: no path)."""
    first, target, length = graph
    newest = np.full(first.size - 1, -1, dtype=np.int64)  # the last label that went on from a node
    labels, beliefs = no_labels(), _no_beliefs()
    add_label(labels, 0, 0, start, -1, -1, 0.0, ahead[start])
    copy_into(beliefs.cov[0], covariance)
    copy_into(beliefs.whole[0], covariance)
    beliefs.outside[0], beliefs.tracked[0] = 0.0, 1.0
    _measure(covariance, 0.0, terms.most, beliefs.size[0])
    room = filter_room()
    cov, whole, predicted = covariance.copy(), covariance.copy(), covariance.copy()
    here, there, size = poses[0].copy(), poses[0].copy(), np.empty(3)
    count, waiting, taken = 1, 1, 0
    while waiting > 0:
        label = labels.items[0]
        drop_first(labels.keys, labels.items, waiting)
        waiting -= 1
        node, gone = labels.at[label], labels.spent[label]
        if _covered(newest[node], beliefs.before, beliefs.size, beliefs.size[label]):
            continue
        beliefs.before[label], newest[node] = newest[node], label
        taken += 1
        if node == goal:
            return motions_back(label, labels.parent, labels.motion), gone, taken
        for e in range(first[node], first[node + 1]):
            to = target[e]
            total = gone + length[e]
            if not total + ahead[to] < terms.longest:
                continue
            here[:2], there[:2] = poses[node, :2], poses[to, :2]
            here[2] = there[2] = math.atan2(there[1] - here[1], there[0] - here[0])
            copy_into(cov, beliefs.cov[label])
            copy_into(whole, beliefs.whole[label])
            outside, tracked = filter_step(
                here, there, cov, whole, beliefs.outside[label], beliefs.tracked[label], fields,
                lattice, noise, settings, predicted, room,
            )  # fmt: skip
            lost = between(outside, 1.0 - tracked)
            _measure(whole, lost, terms.most, size)
            if lost > terms.most or _covered(newest[to], beliefs.before, beliefs.size, size):
                continue
            if count >= terms.labels:
                return np.empty(0, dtype=np.int64), math.inf, -1
            if count == labels.at.size:
                labels, beliefs = more_room(labels), _more_beliefs(beliefs)
            add_label(labels, count, waiting, to, label, e, total, total + ahead[to])
            copy_into(beliefs.cov[count], cov)
            copy_into(beliefs.whole[count], whole)
            copy_into(beliefs.size[count], size)
            beliefs.outside[count], beliefs.tracked[count] = outside, tracked
            count, waiting = count + 1, waiting + 1
    return np.empty(0, dtype=np.int64), math.inf, -1
