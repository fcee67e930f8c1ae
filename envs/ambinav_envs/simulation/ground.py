"""What a building's record means to the kernels: the arrays that their callees take."""

from __future__ import annotations

import numpy as np
from numba import njit

from ambinav.localization.casting import CastTables
from ambinav.localization.information import TABLE, BeamNoise
from ambinav_envs.simulation.pointers import array_at


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def cast_tables_of(ground, eyes):
    """`CastTables` of a building and a scanner."""
    halves, edges, items = ground.half_edges, ground.edges, ground.items
    return CastTables(
        eyes.origin, eyes.first, eyes.cosine, eyes.sine, eyes.beam, eyes.limit, eyes.incidence,
        eyes.start, eyes.reach, eyes.plain, eyes.anchor,
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def walls_of(ground):
    """The first two of `CollisionChecker.arrays`."""
    return (
        array_at(ground.table, (ground.numbers,), np.float64),
        array_at(ground.bound, (ground.bound_rows, ground.bound_columns), np.float32),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def level_of(ground):
    """The layer of the ambiguity map that rewards and windows show."""
    shape = (ground.map_rows, ground.map_columns, ground.level_headings)
    return array_at(ground.level, shape, np.float32)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def fisher_of(ground):
    """The layer `fisher`."""
    shape = (ground.map_rows, ground.map_columns, ground.fisher_headings)
    return array_at(ground.fisher, shape, np.float32)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def free_of(ground):
    """Which cells of the ambiguity map are free."""
    return array_at(ground.free, (ground.map_rows, ground.map_columns), np.bool_)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def ways_of(ground):
    """What the ways to the goal cost, and what links the cells that have them."""
    shape = (ground.field_rows, ground.field_columns)
    return (
        array_at(ground.field, shape, np.float32),
        array_at(ground.links, shape, np.uint8),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def towards_of(ground):
    """Where the ways lead, see `follow`."""
    return array_at(ground.towards, (ground.field_rows, ground.field_columns), np.int8)
