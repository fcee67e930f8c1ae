"""Likelihood of a beam's end point, tabulated: what an ensemble's particle filters look up.

`likelihood_field.field_factors` looks up how near a wall an end point is, and turns that into a
likelihood (a logarithm, where beams are multiplied) once per beam and particle, which is most of
what a filter costs. Here the likelihood itself is on the lattice. Weights are those of
`field_factors` up to single precision: not bit for bit, so drives keep to that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.localization.filter_state import FIELD_PRODUCT, FIELD_SUM, FilterModel
from ambinav.localization.likelihood_field import apply_factors
from ambinav.runtime.array_types import Floats32
from ambinav.runtime.kernels import kernel

_ZERO, _HALF_CELL = np.float32(0.0), 1.5


class LikelihoodTable(NamedTuple):
    """Likelihoods over the lattice of a likelihood field, with a ring of zeros around it.

    Attributes:
        values: float32, shape (rows * columns,): of p = z_hit hit + z_rand / max_range its
            logarithm, or its cube, less that far from all walls (`base`).
        rows: Of the lattice with its ring.
        columns: Likewise.
        base: See `values`.
    """

    values: Floats32
    rows: int
    columns: int
    base: float


def likelihood_table(model: FilterModel) -> LikelihoodTable | None:
    """Tabulate a filter's likelihoods; None where it does not look at the nearest lattice point.

    That is, with a ray model, bilinear interpolation, `trust`, or beams of different ranges.
    """
    if model.kind not in (FIELD_SUM, FIELD_PRODUCT) or model.smooth or model.trust > 0.0:
        return None
    if np.ptp(model.far) > 0.0:
        return None
    floor = model.z_rand / float(model.far[0])
    rows, columns = model.hits.shape[0] + 2, model.hits.shape[1] + 2
    values = np.zeros((rows, columns), dtype=np.float32)
    inner = values[1:-1, 1:-1]
    if model.kind == FIELD_PRODUCT:
        inner[:] = np.log1p(model.hits * np.float32(model.z_hit / floor))
        return LikelihoodTable(values.ravel(), rows, columns, math.log(floor))
    inner[:] = (model.hits * np.float32(model.z_hit) + np.float32(floor)) ** 3
    inner -= np.float32(floor**3)
    return LikelihoodTable(values.ravel(), rows, columns, floor**3)


@kernel(_nrt=False)
def table_factors(particles, count, readings, model, table, end, cell, scratch):
    """Multiply weights by a scan's likelihood, as `mcl_update.weigh`; return the factors' base.

    Args:
        particles: x, y, theta and weight, shape (M, ...); the weights are written.
        count: How many of them there are.
        readings: Of all beams of the scanner, shape (B,), metres.
        model: See `FilterModel`.
        table: See `LikelihoodTable`.
        end: Work space, float32, shape (2, U).
        cell: Work space, int32, shape (U,).
        scratch: Work space, shape (M,).
    """
    used = 0
    for b in range(model.beam.size):
        z = readings[model.beam[b]]
        if z > model.near[b] and z < model.far[b]:
            end[0, used] = (model.mount[b, 0] + z * model.mount[b, 2]) * model.inverse
            end[1, used] = (model.mount[b, 1] + z * model.mount[b, 3]) * model.inverse
            used += 1
    if used == 0:
        return math.nan
    log = model.kind == FIELD_PRODUCT
    for i in range(count):
        # The ring, and half a cell: what is cut off is then the nearest point.
        x = np.float32((particles[i, 0] - model.field_x) * model.inverse + _HALF_CELL)
        y = np.float32((particles[i, 1] - model.field_y) * model.inverse + _HALF_CELL)
        c, s = np.float32(math.cos(particles[i, 2])), np.float32(math.sin(particles[i, 2]))
        total = used * table.base + float(_looked_up(x, y, c, s, end, used, table, cell))
        scratch[i] = model.power * total if log else 1.0 + total
    return apply_factors(particles, count, scratch, log)


@kernel(_nrt=False, fastmath={"contract"})
def _looked_up(x, y, c, s, end, used, table, cell):
    """Sum the table over the end points seen from one pose, in cells."""
    right, top = np.float32(table.columns - 1), np.float32(table.rows - 1)
    columns = np.int32(table.columns)
    # A loop of its own, of which the compiler takes several beams at a time.
    for b in range(used):
        u = x + c * end[0, b] - s * end[1, b]
        v = y + s * end[0, b] + c * end[1, b]
        column = np.int32(min(max(u, _ZERO), right))
        cell[b] = np.int32(min(max(v, _ZERO), top)) * columns + column
    # Four sums, which do not wait for each other.
    first, second, third, fourth = _ZERO, _ZERO, _ZERO, _ZERO
    b = 0
    while b + 4 <= used:
        first += table.values[np.uint32(cell[b])]
        second += table.values[np.uint32(cell[b + 1])]
        third += table.values[np.uint32(cell[b + 2])]
        fourth += table.values[np.uint32(cell[b + 3])]
        b += 4
    while b < used:
        first += table.values[np.uint32(cell[b])]
        b += 1
    return (first + second) + (third + fourth)
