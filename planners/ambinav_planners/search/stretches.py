"""Stretches of a graph's motions where the robot is badly localized."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.geometry.motion.curves import pieces_of, pose_along
from ambinav.maps.lattice_values import value_at
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.service.field import Field
from ambinav_planners.search.graph import MotionGraph

# Between points so many to a cell the layer is taken as linear.
POINTS_PER_CELL = 4.0


@dataclass(frozen=True, eq=False)
class Stretches:
    """Stretches of bad floor along each motion of a graph, shape (E,) each, metres.

    Attributes:
        head: Bad metres from the start of the motion on.
        tail: Bad metres up to its end.
        longest: The longest bad stretch.
        all_bad: bool: all of the motion is bad; head, tail and longest are then its length.
    """

    head: Floats
    tail: Floats
    longest: Floats
    all_bad: Bools


def bad_stretches(graph: MotionGraph, field: Field, level: float) -> Stretches:
    """Find the stretches of a graph's motions where a layer is above a level.

    The layer is read four times a cell and taken as linear in between.

    Args:
        graph: The motions.
        field: The layer, such as `service.ambiguity`.
        level: In the layer's unit.

    Raises:
        InputError: the level is not a number.
    """
    if math.isnan(level):
        raise InputError("level is nan; give the value above which the floor counts as bad.")
    count = len(graph.target)
    head, tail, longest = np.empty(count), np.empty(count), np.empty(count)
    all_bad = np.empty(count, dtype=np.bool_)
    values, _, left, low, inverse = field.arrays
    run_rows(
        _bad_stretches, len(graph.poses), graph.steering.kind, graph.steering.kernel_radius,
        graph.poses, graph.arrays, (values, left, low, inverse), level, head, tail, longest,
        all_bad, least=8,
    )  # fmt: skip
    return Stretches(head, tail, longest, all_bad)


@kernel
def _bad_stretches(
    begin, end, kind, radius, poses, graph, field, level, head, tail, longest, all_bad
):  # fmt: skip
    first, target, length = graph
    for n in range(begin, end):
        for e in range(first[n], first[n + 1]):
            head[e], tail[e], longest[e], all_bad[e] = _bad_stretch(
                kind, radius, poses[n], poses[target[e]], length[e], *field, level
            )


@kernel
def _bad_stretch(kind, radius, a, b, length, values, left, low, inverse, level):
    """Return head, tail and longest bad stretch of one motion, and whether all of it is bad."""
    per_turn = values.shape[2] / (2.0 * math.pi)
    pieces = pieces_of(kind, radius, a, b)
    count = max(int(math.ceil(length * inverse * POINTS_PER_CELL - 1e-9)), 1)
    step = length / count
    x, y, theta = pose_along(kind, pieces, length, a, b, 0.0)
    before = value_at((x - left) * inverse, (y - low) * inverse, theta * per_turn, values) - level
    run, most, front, seen_good = 0.0, 0.0, 0.0, before <= 0.0
    for k in range(1, count + 1):
        x, y, theta = pose_along(kind, pieces, length, a, b, k / count)
        after = (
            value_at((x - left) * inverse, (y - low) * inverse, theta * per_turn, values) - level
        )
        if before > 0.0 and after > 0.0:
            run += step
        elif before > 0.0:  # good from where the line between the two values meets the level
            run += step * before / (before - after)
        most = max(most, run)
        if after <= 0.0:
            if not seen_good:
                front, seen_good = run, True
            run = 0.0
        elif before <= 0.0:
            run = step * after / (after - before)
            most = max(most, run)
        before = after
    if not seen_good:
        return length, length, length, True
    return front, run, most, False
