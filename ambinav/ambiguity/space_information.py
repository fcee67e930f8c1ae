"""Fisher information of a scan in a building in space, with the derivatives of `returns`.

The sum of g g^T / sigma^2 over the beams, g the change of a range with x, y and heading (Censi
2007, "On achievable accuracy for range-finder localization", ICRA), as `localization.information`
has it in the plane.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.returns import BLIND, BeamTable, beam_returns
from ambinav.geometry.environment import Environment
from ambinav.sensing.scanner import RangeScanner

Floats = NDArray[np.float64]

# Beams that are held at a time.
BEAMS_AT_ONCE: Final = 1_000_000
# `BeamTable` asks for it, information does not depend on it.
_OUTLIERS: Final = 0.1


def space_information(
    environment: Environment, scanner: RangeScanner, poses: Floats, map_std: float
) -> Floats:
    """Compute the Fisher information that one scan gives about its pose.

    Args:
        environment: A building in space, or a plan.
        scanner: The scanner, all of whose beams take part.
        poses: x, y, theta, shape (N, 3); those of one heading are cast together.
        map_std: Standard deviation of the walls' position, metres.

    Returns:
        Shape (N, 3, 3), about x, y (1 / square metres) and theta (1 / square radians), map frame.

    Raises:
        InputError: the building and the scanner do not go together (`check_rays`).
    """
    table = BeamTable.of(scanner, map_std, _OUTLIERS)
    out = np.empty((len(poses), 3, 3))
    headings, which = np.unique(poses[:, 2], return_inverse=True)
    count = max(BEAMS_AT_ONCE // len(table.limit), 1)
    for k, heading in enumerate(headings.tolist()):
        mine = np.flatnonzero(which.reshape(-1) == k)
        for first in range(0, len(mine), count):
            part = mine[first : first + count]
            data = np.zeros((len(part), 5, len(table.limit)), dtype=np.float32)
            x, y, _ = np.ascontiguousarray(poses[part].T)
            beam_returns(environment, scanner, table, x, y, heading, data)
            out[part] = _summed(data[:, :, : table.beams].astype(np.float64), table)
    return out


def _summed(data: Floats, table: BeamTable) -> Floats:
    # What is about to come into range tells nothing yet.
    tells = (data[:, 0] < table.limit[: table.beams]) & (data[:, 4] < BLIND / 2)
    weight = np.where(tells, 0.5 / data[:, 4], 0.0)
    gradient = data[:, 1:4]
    summed: Floats = np.matmul(gradient * weight[:, None], gradient.transpose(0, 2, 1))
    return summed
