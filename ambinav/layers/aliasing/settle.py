"""Refinement of aliased poses by casting, which corrects the search's linear model of a cell."""

from __future__ import annotations

import math

import numpy as np

from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.ambiguity.indistinguishability import FINE, evidence_table
from ambinav.ambiguity.returns import BLIND, pose_returns
from ambinav.layers.aliasing.kernel import approach
from ambinav.layers.context import LayerContext
from ambinav.maps.zones import UNEXPLORED
from ambinav.runtime.array_types import Floats, Floats32, Indices
from ambinav.runtime.threads import run_rows

ROUNDS = 4
"""Casts of each aliased pose. Twins that are known to the millimetre are met after two or three."""
HEADING_STEP = math.tau / 1440
"""Radians between the headings that scans are cast at; what is left of a heading (a beam of 8 m
moves by 17 mm along a wall) the scan's derivative accounts for."""
CHUNK = 4096


def settle(context: LayerContext, aliased: Floats) -> Floats:
    """Scan at the aliased poses of a search, move them to the greatest likeness, and rank them.

    The search compares with an aliased pose between lattice points as the derivative at the nearest
    point tells it; corners within the cell make that wrong, by more the coarser the lattice. Here
    the aliased pose is cast, moved to its best offset and cast again, `ROUNDS` times, and kept
    where it was most alike. So its likeness is that of two scans, and an exact twin has 1.

    Args:
        context: Where the poses are.
        aliased: `AliasedPoses.poses`, shape (P, K, count, 4).

    Returns:
        The same, most alike first, without what `settle_at` leaves out.
    """
    settled = np.full(aliased.shape, np.nan)
    # Where the scanner looks all around, one heading stands for all.
    for k in range(1 if context.turns_in_place else aliased.shape[1]):
        cell, rank = np.nonzero(np.isfinite(aliased[:, k, :, 3]))
        settled[cell, k, rank] = settle_at(context, k, cell, aliased[cell, k, rank, :3])
    if context.turns_in_place:
        settled[:] = settled[:, :1]
    order = np.argsort(-settled[..., 3], axis=2, kind="stable")
    return np.take_along_axis(settled, order[..., np.newaxis], axis=2)


def settle_at(context: LayerContext, heading: int, cell: Indices, alike: Floats) -> Floats:
    """Move each of M aliased poses to where it is most alike.

    Args:
        context: Where the poses are.
        heading: Index of the heading of the poses.
        cell: Free cell of the pose that each is like, shape (M,).
        alike: x, y and turn of each, shape (M, 3).

    Returns:
        x, y, turn and likeness, shape (M, 4). NaN for what moves within R of its pose, or to where
        half of the beams or more end in unknown space, or where the robot cannot stand.
    """
    yaw = float(context.headings[heading])
    poses = alike + np.array([0.0, 0.0, yaw])
    entries = np.full((len(cell), 4), np.nan)
    scans = context.returns(heading).data
    for begin in range(0, len(cell), CHUNK):
        chunk = slice(begin, begin + CHUNK)
        entries[chunk] = _settle(context, scans, cell[chunk], poses[chunk])
    x, y = context.points
    near = np.hypot(entries[:, 0] - x[cell], entries[:, 1] - y[cell]) <= context.radius
    entries[near] = np.nan
    entries[:, 2] = math.pi - np.mod(math.pi - entries[:, 2] + yaw, math.tau)
    return entries


def _settle(context: LayerContext, scans: Floats32, cell: Indices, poses: Floats) -> Floats:
    """Refine aliased poses, (M, 3), of the cells `cell`, (M,); return pose and likeness, (M, 4)."""
    table, model = context.table, context.model
    beams = table.beams
    evidence = None
    if table.width.max() > FINE:
        rows = evidence_table(table.width)
        evidence = np.pad(rows, ((0, len(table.limit) - len(rows)), (0, 0)))
    poses = poses.copy()
    best = np.full((len(cell), 4), np.nan)
    least = np.full(len(cell), np.inf)
    data = np.empty((len(cell), *scans.shape[1:]), dtype=np.float32)
    energy, moved = np.empty(len(cell)), np.empty((len(cell), 3))
    for _ in range(ROUNDS):
        heading = np.rint(poses[:, 2] / HEADING_STEP) * HEADING_STEP
        stands = can_stand(
            context.environment, context.mounted or context.scanner, poses[:, 0], poses[:, 1],
            heading, model.robot_radius,
        )  # fmt: skip
        pose_returns(
            context.environment, context.scanner, table, poses[:, 0], poses[:, 1], heading, data
        )
        run_rows(
            approach, len(cell), scans, cell, data, poses[:, 2] - heading, table.limit,
            table.inverse_cap, table.use, evidence, model.tau, context.spacing**2 / 4.0,
            model.sigma_theta**2, energy, moved, least=64,
        )  # fmt: skip
        blind = (data[:, 4, :beams] >= 0.5 * BLIND).mean(axis=1)
        better = (energy < least) & (blind < UNEXPLORED) & stands
        best[better, :3], best[better, 3] = poses[better], np.exp(-energy[better])
        least[better] = energy[better]
        poses[:, :2] += moved[:, :2]
        poses[:, 2] = heading + moved[:, 2]
    return best
