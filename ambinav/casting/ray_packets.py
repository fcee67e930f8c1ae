"""Packets of a scanner's rays, which walk through a building of prisms together."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.casting.space import SpaceRays
from ambinav.runtime.array_types import Bools, Floats, Ints

# Cosine of the elevation from which on a ray counts as upright: it then stays above one point.
UPRIGHT = 1e-9
# A packet of several azimuths spans less than this, radians, and has as many rays at the most: flat
# between 8 and 16 degrees and from 48 rays on (benchmarks/bench_prisms.py).
WIDEST = math.radians(12.0)
MOST = 64


class Packets(NamedTuple):
    """R rays in the robot's frame, in C packets: rays of one origin and nearly one azimuth.

    Attributes:
        origin: float64, shape (C, 3), metres.
        start: int64, shape (C + 1,): packet c holds the entries start[c] to start[c + 1] - 1.
        column: bool, shape (C,): whether all rays of a packet have exactly one azimuth; seen from
            above they are one ray.
        ray: int64, shape (R,): which ray each entry is.
        cosine: Cosine of each entry's azimuth, shape (R,).
        sine: Sine of its azimuth, shape (R,).
        flat: Cosine of its elevation, shape (R,); below `UPRIGHT` alone in its packet.
        rise: Sine of its elevation, shape (R,).
        slope: Rise over flat, shape (R,), ascending within a packet.
        per_slope: One over it; inf for 0.
    """

    origin: Floats
    start: Ints
    column: Bools
    ray: Ints
    cosine: Floats
    sine: Floats
    flat: Floats
    rise: Floats
    slope: Floats
    per_slope: Floats


def packets_of(rays: SpaceRays) -> Packets:
    """Sort rays into packets: one origin and azimuth is a column; others join their neighbours."""
    flat, rise = np.cos(rays.elevation), np.sin(rays.elevation)
    upright = flat < UPRIGHT
    origin = _numbered(*rays.origin.T)
    which = _numbered(origin, rays.azimuth, np.where(upright, np.arange(len(flat)) + 1, 0))
    alone = (np.bincount(which)[which] == 1) & ~upright
    which[alone] = len(which) + _shares(origin[alone], rays.azimuth[alone])
    which = _numbered(which)
    size = np.bincount(which)
    start = np.concatenate([[0], np.cumsum(size)])
    order = np.lexsort((rays.elevation, which))
    azimuth = rays.azimuth[order]
    slope = (rise / np.where(upright, 1.0, flat))[order]
    return Packets(
        np.ascontiguousarray(rays.origin[order[start[:-1]]]),
        start,
        np.logical_and.reduceat(azimuth == np.repeat(azimuth[start[:-1]], size), start[:-1]),
        order,
        np.cos(azimuth),
        np.sin(azimuth),
        np.where(upright, 0.0, flat)[order],
        rise[order],
        slope,
        np.divide(1.0, slope, out=np.full(len(slope), np.inf), where=slope != 0.0),
    )


def _numbered(*keys: NDArray[Any]) -> Ints:
    """Number rows, shape (N,), by their keys: equal keys, equal numbers, in ascending order."""
    order = np.lexsort(keys[::-1])
    fresh = np.zeros(len(order), dtype=np.bool_)
    for key in keys:
        fresh[1:] |= key[order][1:] != key[order][:-1]
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(fresh)
    return number


def _shares(origin: Ints, azimuth: Floats) -> Ints:
    """Number rays, shape (N,): up to `MOST` rays of one origin within `WIDEST` share a number."""
    around = np.mod(azimuth, 2.0 * math.pi)
    sector = _numbered(origin, np.floor(around / WIDEST))
    order = np.lexsort((around, sector))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - np.searchsorted(sector[order], sector[order])
    return _numbered(sector, rank // MOST)
