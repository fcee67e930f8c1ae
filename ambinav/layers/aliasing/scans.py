"""Scans of all poses of a map, with beams in an order in which a turn is a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.ambiguity.heading import turns
from ambinav.ambiguity.indistinguishability import FINE, evidence_table
from ambinav.ambiguity.returns import BLIND
from ambinav.layers.context import LayerContext
from ambinav.maps.zones import UNEXPLORED
from ambinav.runtime.array_types import Bools, Floats, Floats32, Indices, Ints32


@dataclass(frozen=True, eq=False)
class Scans:
    """Scans that `kernel` compares: N poses, B beams in orbits of n.

    What a beam reads of intensity counts as a further beam, see `BeamTable`; ranges come first.

    Turning the robot by k steps of 2 pi / n puts beam j n + i where beam j n + (i + k) mod n was:
    every orbit of n beams is shifted by k. Poses are the P free cells of a map, or its P free
    cells times K headings where a turn of the robot shows other things (n is 1 then).

    Attributes:
        data: See `Returns`, beams in this order and padded, float32, shape (N, 5, padded).
        limit: See `BeamTable`, in this order, as the next two.
        inverse_cap: 1 / (most evidence of a beam).
        use: 1 for a beam and 0 for padding.
        evidence: Table of evidence, shape (padded, Z), or None where all bins are fine.
        softness: float32, shape (padded,): the evidence of a beam is at least this share of
            that of fine bins, z^2 / 4.
        variance: Largest squared effective deviation of each beam, float64, shape (B,).
        turns: n.
        x: Shape (N,), metres.
        y: Shape (N,), metres.
        heading: Shape (N,), radians.
        cell: Running number of each pose's cell, int32, shape (N,).
        possible: bool, shape (N,): whether the robot can stand there; the scans of other poses
            mean nothing.
        known: bool, shape (N, B): False where a beam ends in unknown space: it is left out.
        cell_variance: Variance of the offset within a cell: x and y (square metres), theta (square
            radians).
        tau: Beams per independent piece of evidence.
        spacing: Spacing of the lattice, metres.
        ranges: How many of the beams are ranges: a pose without echoes is explored all the same.
    """

    data: Floats32
    limit: Floats32
    inverse_cap: Floats32
    use: Floats32
    evidence: Floats32 | None
    softness: Floats32
    variance: Floats
    turns: int
    x: Floats
    y: Floats
    heading: Floats
    cell: Ints32
    possible: Bools
    known: Bools
    cell_variance: tuple[float, float]
    tau: float
    spacing: float
    ranges: int

    @classmethod
    def of(cls, context: LayerContext) -> Scans:
        """Scan from every free cell, at every heading of the map unless the scanner looks around.

        The offset of the heading is half a step between turns, so that neighbouring Gaussians add
        up evenly; where the map's headings stand alone it is the map's `sigma_theta`.
        """
        shifts, n = context.turns_in_place, 1
        table = context.table
        order = np.arange(table.columns)
        if shifts:
            around = table.turned(turns(context.scanner)).astype(np.intp)
            order, n = _orbits(around), len(around)
        headings = context.headings[:1] if shifts else context.headings
        width = len(table.limit)
        full = np.concatenate([order, np.arange(len(order), width)])
        x, y = context.points
        count = len(headings)
        data = np.empty((len(x), count, 5, width), dtype=np.float32)
        for k in range(count):
            data[:, k] = context.returns(k).data[:, :, full]
        scans = data.reshape(-1, 5, width)
        evidence = None
        softness = np.ones(width, dtype=np.float32)
        if table.width.max() > FINE:
            evidence = np.zeros((width, 1), dtype=np.float32)
            rows = evidence_table(table.width[order])
            evidence = np.pad(rows, ((0, width - len(order)), (0, 0)))
            softness[: len(order)] = rows.min(axis=1)
        theta = (math.pi / n) ** 2 if shifts else context.model.sigma_theta**2
        return cls(
            data=scans,
            limit=table.limit[full],
            inverse_cap=table.inverse_cap[full],
            use=table.use[full],
            evidence=evidence,
            softness=softness,
            variance=2.0 * table.spread.max(axis=1)[order].astype(np.float64),
            turns=n,
            x=np.repeat(x, count),
            y=np.repeat(y, count),
            heading=np.tile(headings, len(x)),
            cell=np.repeat(np.arange(len(x), dtype=np.int32), count),
            possible=context.possible[:, :count].ravel(),
            known=scans[:, 4, : len(order)] < 0.5 * BLIND,
            cell_variance=(context.spacing**2 / 4.0, theta),
            tau=context.model.tau,
            spacing=context.spacing,
            ranges=table.beams,
        )

    @property
    def beams(self) -> int:
        """Number of beams B."""
        return len(self.variance)

    @property
    def explored(self) -> Bools:
        """Possible poses where fewer than half of the beams end in unknown space, shape (N,)."""
        explored_share = self.known[:, : self.ranges].mean(axis=1)
        return np.asarray(self.possible & (1.0 - explored_share < UNEXPLORED))


def _orbits(around: Indices) -> Indices:
    """Return the beams one orbit after the other, each in the order of the turns."""
    remaining, order = set(range(around.shape[1])), []
    while remaining:
        orbit = around[:, min(remaining)].tolist()
        remaining -= set(orbit)
        order += orbit
    return np.array(order, dtype=np.intp)
