"""What a building's record means to the kernels: the arrays that their callees take."""

from __future__ import annotations

import numpy as np

from ambinav.kernels import kernel
from ambinav.localization.casting import CastTables
from ambinav.localization.information import TABLE, BeamNoise
from ambinav_envs.simulation.layout import GROUND
from ambinav_envs.simulation.pointers import array_at, fetch

# Rows beside a robot's own that the way ahead may lead through in the next step.
_BESIDE = 2


@kernel(forceinline=True)
def ground_of(where):
    """The `GROUND` around a robot."""
    return array_at(where.ground, (1,), GROUND)[0]


@kernel(forceinline=True)
def cast_tables_of(ground, eyes):
    """`CastTables` of a building and a scanner."""
    halves, edges, items = ground.half_edges, ground.edges, ground.items
    return CastTables(
        eyes.origin, eyes.first, eyes.cosine, eyes.sine, eyes.beam, eyes.limit, eyes.incidence,
        eyes.start, eyes.reach, eyes.plain, eyes.anchor, eyes.inner,
        array_at(ground.border_segment, (edges,), np.int32),
        array_at(ground.border, (edges, 4), np.float64),
        array_at(ground.normal, (edges, 3), np.float64),
        array_at(ground.twin, (halves,), np.int32),
        array_at(ground.node, (halves, 4), np.float64),
        array_at(ground.node, (halves, 8), np.int32),
        array_at(ground.corner, (halves, 2), np.float64),
        ground.grid_x, ground.grid_y, ground.cell, ground.rows, ground.columns,
        array_at(ground.grid_start, (ground.rows * ground.columns + 1,), np.int32),
        array_at(ground.item, (items,), np.int32),
        array_at(ground.triangle, (items, 6), np.float64),
    )  # fmt: skip


@kernel(forceinline=True)
def beam_noise_of(ground, eyes):
    """`BeamNoise` of a building and a scanner."""
    sensors = eyes.shift.shape[0]
    return BeamNoise(
        eyes.near, eyes.far,
        array_at(ground.bias, (sensors, TABLE), np.float64),
        array_at(ground.variance, (sensors, TABLE), np.float64),
        array_at(ground.frontier, (ground.edges,), np.bool_),
        eyes.sensor,
        # Whether bias and deviation are the same at any range.
        eyes.reading[:, 6],
    )  # fmt: skip


@kernel(forceinline=True)
def walls_of(ground):
    """The first two of `CollisionChecker.arrays`."""
    return (
        array_at(ground.table, (ground.numbers,), np.float64),
        array_at(ground.bound, (ground.bound_rows, ground.bound_columns), np.float32),
    )


@kernel(forceinline=True)
def level_of(ground):
    """The layer of the ambiguity map that rewards and windows show."""
    shape = (ground.map_rows, ground.map_columns, ground.level_headings)
    return array_at(ground.level, shape, np.float32)


@kernel(forceinline=True)
def fisher_of(ground):
    """The layer `fisher`."""
    shape = (ground.map_rows, ground.map_columns, ground.fisher_headings)
    return array_at(ground.fisher, shape, np.float32)


@kernel(forceinline=True)
def free_of(ground):
    """Which cells of the ambiguity map are free."""
    return array_at(ground.free, (ground.map_rows, ground.map_columns), np.bool_)


@kernel(forceinline=True)
def ways_of(where, ground):
    """What the ways to a robot's goal cost, and what links the cells that have them."""
    shape = (ground.field_rows, ground.field_columns)
    return (
        array_at(where.field, shape, np.float32),
        array_at(ground.links, shape, np.uint8),
    )


@kernel(forceinline=True)
def towards_of(where, ground):
    """Where the ways lead, see `follow`."""
    return array_at(where.towards, (ground.field_rows, ground.field_columns), np.int8)


@kernel(forceinline=True)
def expect_ways(x, y, where, ground):
    """Ask for what will be read about the ways from a place.

    Each of many robots has ways of its own, too much for the caches.
    """
    column = int((x - ground.field_x) * ground.field_inverse + 0.5)
    row = int((y - ground.field_y) * ground.field_inverse + 0.5)
    for k in range(-_BESIDE, _BESIDE + 1):
        cell = (row + k) * ground.field_columns + column
        fetch(where.towards + cell)
        if -1 <= k <= 1:
            fetch(where.field + 4 * cell)
