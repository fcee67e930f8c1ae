"""Pairs of real scans, compared as they were measured and as a map predicts them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.indistinguishability import FINE, evidence_table
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.returns import BLIND, beam_returns
from ambinav.geometry.environment import Environment
from ambinav.logs.log import Log
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from real_scans.agreement import Agreement, compare_pairs
from real_scans.real_returns import returns_of_scans, surface_slopes
from real_scans.scan_pairs import ScanPairs

# How well a partner's pose is known: as in a map with cells of this spacing, metres.
SPACING: Final = 0.1


@dataclass(frozen=True, eq=False)
class Compared:
    """Pairs of scans, compared as they were measured and as a map predicts them.

    Attributes:
        pairs: The pairs.
        measured: The real scans' agreement.
        known: The real scans' agreement of the beams alone that end at a wall of the map or in its
            free space: where it is unknown, the map says nothing that could be held against them.
        predicted: That of the scans that the map predicts at the same poses.
        common: Share of the beams that both look to, shape (N,).
        beams: How many beams the real scans of a pair have both returned that the map knows,
            shape (N,).
    """

    pairs: ScanPairs
    measured: Agreement
    known: Agreement
    predicted: Agreement
    common: Floats
    beams: Floats


def compared(
    log: Log,
    pairs: ScanPairs,
    environment: Environment,
    scanner: RangeScanner,
    model: AmbiguityModel,
) -> Compared:
    """Compare the scans of pairs with each other, real ones and predicted ones, in one way.

    Both use the model's sensor, deviation, cap and tau. The prediction knows where the two lasers
    stood and looked, and the map; it knows nothing of the readings.

    Args:
        log: Log of a robot that is its laser (`as_seen_from_laser`).
        pairs: At least one.
        environment: The map.
        scanner: The beams that take part, all of one sensor in the laser's centre.
        model: The model's parameters.
    """
    if len(pairs) == 0:
        raise InputError(
            f"{log.source or log.name}: no two scans of it are near enough to each other; give a "
            "larger radius."
        )
    table = BeamTable.of(scanner, model.map_std, model.outlier_share)
    limit, width = float(table.limit[0]), len(table.limit)
    directions = scanner.mounts[:, 2]
    evidence = evidence_of(table)
    cell = (SPACING**2 / 4.0, model.sigma_theta**2)
    poses = log.required_poses()
    first, row = np.unique(pairs.first, return_inverse=True)
    slopes = surface_slopes(log.ranges, log.angles)

    def real(scan: NDArray[np.intp], turn: Floats, heading: Floats) -> NDArray[np.float32]:
        return returns_of_scans(
            log.ranges, slopes, log.angles, scan, turn, heading, directions, limit,
            table.spread[0], width,
        )  # fmt: skip

    def agreement(
        first_returns: NDArray[np.float32], second_returns: NDArray[np.float32]
    ) -> Agreement:
        return compare_pairs(first_returns, second_returns, row, table, evidence, model.tau, cell)

    mine = real(first, np.zeros(len(first)), poses[first, 2])
    theirs = real(pairs.second, pairs.turn, poses[pairs.first, 2])
    firsts, partners = _predicted(pairs, first, row, poses, environment, scanner, table)
    common = in_view(log.angles, directions, pairs.turn)
    partners[:, 4, : len(directions)][~common] = BLIND
    measured, predicted = agreement(mine, theirs), agreement(firsts, partners)
    for scans, predicted_scans in ((mine, firsts), (theirs, partners)):
        scans[:, 4][predicted_scans[:, 4] == BLIND] = BLIND
    seen_by_both = (mine[row, 4] != BLIND) & (theirs[:, 4] != BLIND)
    return Compared(
        pairs,
        measured,
        agreement(mine, theirs),
        predicted,
        common.mean(axis=1),
        seen_by_both[:, : len(directions)].sum(axis=1).astype(np.float64),
    )


def in_view(angles: Floats, directions: Floats, turn: Floats) -> NDArray[np.bool_]:
    """Return whether scans with beams `angles`, turned by `turn` (N,), see directions (P,).

    Returns:
        Shape (N, P).
    """
    edge = 0.5 * (angles[1] - angles[0]) + 1e-9
    bearing = np.mod(directions - turn[:, None] - angles[0] + edge, 2.0 * math.pi)
    return np.asarray(bearing <= angles[-1] - angles[0] + 2.0 * edge)


def _predicted(
    pairs: ScanPairs,
    first: NDArray[np.intp],
    row: NDArray[np.intp],
    poses: Floats,
    environment: Environment,
    scanner: RangeScanner,
    table: BeamTable,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the map's prediction of the scans: first ones, and partners in their directions."""
    width = len(table.limit)
    own, other = (np.zeros((size, 5, width), dtype=np.float32) for size in (len(first), len(row)))
    own[:, 4] = other[:, 4] = 1.0
    begin = np.searchsorted(row, np.arange(len(first) + 1))
    for k, p in enumerate(first):
        mine = slice(begin[k], begin[k + 1])
        index = np.concatenate([[p], pairs.second[mine]])
        data = np.zeros((len(index), 5, width), dtype=np.float32)
        data[:, 4] = 1.0
        x, y = poses[index, :2].T.copy()
        beam_returns(environment, scanner, table, x, y, float(poses[p, 2]), data)
        own[k], other[mine] = data[0], data[1:]
    return own, other


def evidence_of(table: BeamTable) -> NDArray[np.float32] | None:
    """Return the table of evidence for beams of one sensor; None where bins are fine."""
    if table.width.max() <= FINE:
        return None
    return np.asarray(evidence_table(table.width[:1])[np.zeros(len(table.limit), dtype=np.intp)])
