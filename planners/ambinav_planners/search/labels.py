"""Common parts of the label-setting searches: a heap in arrays, and the path found.

A label is one path to a node: what it has cost, a second amount that decides what is still
possible, and the label and motion that it came from. A search takes labels in the order of cost
plus cost to go, so the labels of one node come in the order of cost, and a label is worth going
on with exactly if its second amount is lower than that of all before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ambinav.runtime.array_types import Floats, Indices, Ints, Ints32
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav_planners.search.graph import MotionGraph

ROOM = 1024
"""Labels that there is room for at first."""


class Labels(NamedTuple):
    """The labels of a search, and the heap of open labels; their second amounts are separate.

    Attributes:
        at: int32: the node of each label.
        parent: int64: the label that it came from; -1 for the first one.
        motion: int64: the motion that it came by.
        spent: Its cost.
        keys: Keys of the heap, cost plus cost to go.
        items: int64: the labels in the heap.
    """

    at: Ints32
    parent: Ints
    motion: Ints
    spent: Floats
    keys: Floats
    items: Ints


@dataclass(frozen=True, eq=False)
class SearchPath:
    """A path through a graph of motions.

    Attributes:
        nodes: intp, shape (N,): the nodes from start to goal.
        motions: intp, shape (N - 1,): the motions between them.
        cost: Objective value of the path.
        labels: How many labels the search went on with.
    """

    nodes: Indices
    motions: Indices
    cost: float
    labels: int


def check_node(graph: MotionGraph, name: str, node: int) -> int:
    """Return the node, after checking that the graph has it.

    Raises:
        InputError: it has not.
    """
    count = len(graph.poses)
    if not 0 <= node < count:
        raise InputError(f"{name} is node {node}; give one of 0 to {count - 1}.")
    return int(node)


def path_back(graph: MotionGraph, start: int, motion: Ints, cost: float, labels: int) -> SearchPath:
    """Return the path whose motions are `motion`, from the goal back to the start."""
    motions = motion[::-1].astype(np.intp)
    nodes = np.concatenate([[start], graph.target[motions]]).astype(np.intp)
    return SearchPath(nodes, motions, cost, labels)


@kernel
def grown(array):
    """Return a copy with twice the length."""
    out = np.empty((2 * len(array), *array.shape[1:]), dtype=array.dtype)
    copy_into(out, array)
    return out


@kernel
def no_labels():
    """Allocate an empty set of labels."""
    room = ROOM
    return Labels(
        np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int64),
        np.empty(room, dtype=np.int64), np.empty(room), np.empty(room),
        np.empty(room, dtype=np.int64),
    )  # fmt: skip


@kernel
def more_room(labels):
    """Return the labels with twice the capacity."""
    return Labels(
        grown(labels.at), grown(labels.parent), grown(labels.motion), grown(labels.spent),
        grown(labels.keys), grown(labels.items),
    )  # fmt: skip


# Inlined by LLVM, which takes the counting of references to seven arrays out of each call.
@kernel(forceinline=True)
def add_label(labels, count, size, node, parent, motion, spent, key):
    """Add a label to `count` and to the heap of `size` open ones; there must be room for it."""
    labels.at[count], labels.parent[count], labels.motion[count] = node, parent, motion
    labels.spent[count] = spent
    push(labels.keys, labels.items, size, key, count)


@kernel
def push(keys, items, size, key, item):
    """Add an item to a heap of four children a node; the arrays must have room for it."""
    at = size
    while at > 0:
        above = (at - 1) >> 2
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item


@kernel
def drop_first(keys, items, size):
    """Remove the first item from a heap of `size` items."""
    last = size - 1
    key, item = keys[last], items[last]
    at = 0
    while True:
        child = 4 * at + 1
        if child >= last:
            break
        least = child
        for other in range(child + 1, min(child + 4, last)):
            if keys[other] < keys[least]:
                least = other
        if keys[least] >= key:
            break
        keys[at], items[at] = keys[least], items[least]
        at = least
    keys[at], items[at] = key, item


@kernel
def motions_back(label, parent, motion):
    """Return the motions from a label back to the first one."""
    count, at = 0, label
    while parent[at] >= 0:
        count, at = count + 1, parent[at]
    out = np.empty(count, dtype=np.int64)
    at = label
    for k in range(count):
        out[k] = motion[at]
        at = parent[at]
    return out


@kernel
def reversed_graph(first, target):
    """Return the graph by targets: first motion of each, and source and number of the motions."""
    nodes = first.size - 1
    begin = np.zeros(nodes + 1, dtype=np.int64)
    for e in range(target.size):
        begin[target[e] + 1] += 1
    for n in range(nodes):
        begin[n + 1] += begin[n]
    at = begin[:-1].copy()
    source = np.empty(target.size, dtype=np.int32)
    motion = np.empty(target.size, dtype=np.int64)
    for n in range(nodes):
        for e in range(first[n], first[n + 1]):
            k = at[target[e]]
            source[k], motion[k] = n, e
            at[target[e]] += 1
    return begin, source, motion
