"""Explored floor for a scanner, without building its whole map."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.ambiguity.model import AmbiguityModel, thin
from ambinav.ambiguity.returns import blind_share, panorama_returns
from ambinav.geometry.lattice import Lattice
from ambinav.map_building.build import HEADINGS
from ambinav.maps.zones import UNEXPLORED
from ambinav.runtime.array_types import Bools, Ints
from ambinav.sensing.scanner import RangeScanner

PIECE_BYTES: Final = 64_000_000
"""Bytes of returns held at a time."""


def explored(
    lattice: Lattice,
    scanner: RangeScanner,
    point: Ints,
    model: AmbiguityModel,
    headings: int | None = None,
) -> Bools:
    """Return which points a scanner's map has as free and explored (`AmbiguityMap.unexplored`).

    Args:
        lattice: Lattice of the building.
        scanner: The scanner; as many beams take part as in its map.
        point: Running numbers of the lattice's free points that are asked for, shape (K,).
        model: Parameters: deviation of the walls and share of outliers.
        headings: As in `build_map`.

    Returns:
        Shape (K,).
    """
    env = lattice.environment
    if headings is None and not scanner.looks_all_around:
        headings = HEADINGS
    mounted = scanner.centred if headings is None else scanner
    angles = 2.0 * math.pi * np.arange(headings or 1) / (headings or 1)
    beams = thin(mounted)
    table = BeamTable.of(beams, model.map_std, model.outlier_share, env.has_reflectors)
    x, y = (axis[point] for axis in lattice.points)
    pose_bytes = 20 * len(angles) * len(table.limit)
    mask = np.zeros(len(point), dtype=np.bool_)
    for rows in np.array_split(np.arange(len(point)), len(point) * pose_bytes // PIECE_BYTES + 1):
        stands = np.stack(
            [can_stand(env, mounted, x[rows], y[rows], float(theta)) for theta in angles], axis=1
        )
        data = np.empty((len(angles), len(rows), 5, len(table.limit)), dtype=np.float32)
        panorama_returns(env, beams, table, x[rows], y[rows], angles, data)
        able = stands.any(axis=1)
        blind = blind_share(data, 0, len(rows), table.beams)[able].mean(axis=1, where=stands[able])
        # In the floating-point precision of a map.
        mask[rows[able]] = blind.astype(np.float32) < UNEXPLORED
    return mask
