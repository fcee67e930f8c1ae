"""Selection of beams: greedy, even, random, and the best of all subsets."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ambinav.ambiguity.tensor import relative_radii
from ambinav.runtime.array_types import Floats, Indices, Ints
from ambinav.sensing.mounting import TURN
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.beams.sample import MapSample, packed

CANDIDATES = 72
"""Beams that are tried at each step, drawn anew where there are more left (Mirzasoleiman et al.
2015, "Lazier than lazy greedy"): of a 360-beam laser a fifth of the time."""

Kept = tuple[int, ...]


def objective(samples: Sequence[MapSample], beams: Sequence[int]) -> float:
    """Compute the quantity to minimize: `Loss.level`, averaged over the maps, points."""
    return float(np.mean([sample.level_loss(sample.measure(beams)[0]) for sample in samples]))


def grow(
    samples: Sequence[MapSample], rng: np.random.Generator, candidates: int = CANDIDATES
) -> Iterator[Kept]:
    """Add beams greedily: each step adds the beam that leaves the smallest `objective`.

    Yields:
        Subsets of 1, 2, ... beams in the order in which they were added, until all are.
    """
    chosen: list[int] = []
    scanner = samples[0].scanner
    while len(chosen) < scanner.beams:
        unused = np.setdiff1d(np.arange(scanner.beams), chosen)
        if len(unused) > candidates:
            unused = np.sort(rng.choice(unused, candidates, replace=False))
        losses = np.mean([_with_each(sample, chosen, unused) for sample in samples], axis=0)
        chosen.append(int(unused[np.argmin(losses)]))
        yield tuple(chosen)


def _with_each(sample: MapSample, chosen: Sequence[int], candidates: Ints) -> Floats:
    """Compute `Loss.level` of a map with the kept beams and each of C candidates, shape (C,)."""
    count = len(chosen) + 1
    model = sample.model_of(count)
    # The tables are the same for all beams of a sensor.
    sensor = sample.scanner.sensor_of_beam
    tables = {
        int(sensor[beam]): sample.table.subset([*chosen, int(beam)])
        for beam in candidates[np.unique(sensor[candidates], return_index=True)[1]]
    }
    sums = np.empty((len(candidates), len(sample.level), 7))
    first = 0
    for group in sample.groups:
        part = slice(first, first + len(group.around.poses))
        current = np.empty(0, dtype=np.intp)
        for row, beam in enumerate(candidates):
            table = tables[int(sensor[beam])]
            columns = sample.table.columns_of([*chosen, int(beam)])
            if len(columns) != len(current):
                data = packed(group.columns, columns, len(table.limit))
            else:
                for place in np.flatnonzero(columns != current):
                    data[0, :, :, place] = group.columns[columns[place]]
            current = columns
            sums[row, part] = group.around.sums(data, table, model)[:, 0]
        first = part.stop
    return np.array([sample.level_loss(level) for level in relative_radii(sums)["level"]])


def by_direction(scanner: RangeScanner) -> tuple[Indices, bool]:
    """Sort the beams by direction and check whether they cover the full circle.

    Returns:
        Indices of the beams, shape (B,): from the first one on where they go all around, else from
        the one after the widest gap.
    """
    yaw = scanner.mounts[:, 2] % TURN
    order = np.argsort(yaw, kind="stable")
    gap = np.diff(yaw[order], append=yaw[order[0]] + TURN)
    around = float(gap.max()) <= 1.5 * TURN / len(order)
    first = np.argmin(order) if around else 1 + np.argmax(gap)
    return np.roll(order, -int(first)), around


def even(scanner: RangeScanner, count: int) -> Kept:
    """Select beams spread evenly over the scanner's directions, both ends of a fan included."""
    order, around = by_direction(scanner)
    total = len(order)
    if around:
        places = np.arange(count) * total // count
    elif count == 1:
        places = np.array([total // 2])
    else:
        places = np.rint(np.linspace(0, total - 1, count)).astype(np.intp)
    return tuple(sorted(order[places].tolist()))


def at_random(scanner: RangeScanner, count: int, rng: np.random.Generator) -> Kept:
    """Draw a uniformly random subset of beams."""
    return tuple(sorted(rng.choice(scanner.beams, count, replace=False).tolist()))


def best_of_all(samples: Sequence[MapSample], count: int) -> tuple[Kept, float]:
    """Find the subset of a size with the least `objective` by trying all; return both."""
    best: tuple[Kept, float] = ((), math.inf)
    for beams in combinations(range(samples[0].scanner.beams), count):
        value = objective(samples, beams)
        if value < best[1]:
            best = beams, value
    return best
