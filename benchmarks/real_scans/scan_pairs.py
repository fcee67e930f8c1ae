"""Pairs of scans that a robot took near to each other, with nearly the same heading."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import wrap_angles
from ambinav.logs.log import Log
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

# Headings of a pair differ by no more: of half a turn's view two thirds are then common.
TURN: Final = math.pi / 3.0
# A pair nearer than this says how noisy the poses are, not how alike two places.
NEAREST: Final = 0.05


@dataclass(frozen=True, eq=False)
class ScanPairs:
    """Ordered pairs (p, q) of scans; every pair is there in both orders.

    Attributes:
        first: Index of p, intp, shape (N,), rising.
        second: Index of q, intp, shape (N,).
        apart: Displacement from p to q in the map frame, shape (N, 2), metres.
        turn: Heading of q minus that of p, shape (N,), radians.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    apart: Floats
    turn: Floats

    @property
    def distance(self) -> Floats:
        """Metres between the two, shape (N,)."""
        return np.hypot(self.apart[:, 0], self.apart[:, 1])

    def __len__(self) -> int:
        """Number of ordered pairs."""
        return len(self.first)


def scan_pairs(
    log: Log,
    chosen: NDArray[np.bool_],
    environment: Environment,
    radius: float,
    *,
    nearest: float = NEAREST,
    turn: float = TURN,
) -> ScanPairs:
    """Find the pairs among some scans of a log whose lasers were near to each other.

    As in the model's neighbourhood no wall may part the two, and both must stand in the free
    space.

    Args:
        log: Scans with poses.
        chosen: Which of them take part, shape (S,).
        environment: The map, for the walls.
        radius: Largest distance, metres.
        nearest: Smallest distance, metres.
        turn: Largest difference of the headings, radians.

    Raises:
        InputError: the log has no poses or does not belong to the map, or an argument is out of
            its range.
    """
    if not 0.0 <= nearest < radius < math.inf:
        raise InputError(
            f"radius is {radius} m and nearest {nearest} m; give 0 <= nearest < radius."
        )
    log.check_environment(environment)
    poses = log.laser_poses
    free = np.asarray(environment.is_free(poses[:, 0], poses[:, 1]))
    index = np.flatnonzero(chosen & free)
    if len(index) == 0:
        index_pairs = np.empty((0, 2), dtype=np.intp)
    else:
        index_pairs = cKDTree(poses[index, :2]).query_pairs(radius, output_type="ndarray")
    pairs = index[np.concatenate([index_pairs, index_pairs[:, ::-1]])]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    offset = poses[pairs[:, 1], :2] - poses[pairs[:, 0], :2]
    turned = wrap_angles(poses[pairs[:, 1], 2] - poses[pairs[:, 0], 2])
    distance = np.hypot(offset[:, 0], offset[:, 1])
    good = (distance >= nearest) & (np.abs(turned) <= turn)
    if good.any():
        x, y = poses[pairs[good, 0], :2].T
        bearing = np.arctan2(offset[good, 1], offset[good, 0])
        seen = np.asarray(environment.cast(x, y, bearing, radius + 1.0))
        good[good] = ~(seen < distance[good])
    return ScanPairs(pairs[good, 0], pairs[good, 1], offset[good], turned[good])
