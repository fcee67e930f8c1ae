"""Poses in channels little wider than the robot, where no lattice point fits.

A robot passes such a channel along its middle, where the clearance has a ridge: it falls off to
both sides, because the nearest walls stand on opposite sides (the generalized Voronoi diagram,
Choset and Burdick 1995; the bridge test of Hsu, Jiang, Reif and Sun 2003 looks for the same
places by chance). The ridge is found from clearances alone, to a tenth of a millimetre, so it
does not matter how the walls are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.ndimage import binary_dilation

from ambinav.casting.plane.raycast import clearances
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav_planners.search.ridges import decreases, ridge

# Points stand this far apart along a channel: as a share of the lattice's spacing, and of the
# robot's radius, which bounds how sharply a channel bends; but never closer than the last share.
SPACING_SHARE, RADIUS_SHARE, CLOSEST_SHARE = 0.5, 0.25, 0.125
# Up to this much room on each side of the robot, in spacings, a channel is looked for: where there
# is more, lattice points lie in it anyway.
ROOM = 1.5
# The clearance falls by up to the step on either side of a ridge. By so much of both, it is one:
# the nearest walls then stand at least 97 degrees apart, as they do not in the corner of a room.
FALL = 1.5
# As FALL, at a point of the search lattice, which is beside the ridge by up to half a step.
FALL_BESIDE = 0.5
# Where there is less room than this share of a step, points stand closer by this factor.
TIGHT, CLOSER = 0.1, 8
# Points along each side of a cell that are tried, and how far from its edge they end, metres.
EDGE_POINTS, EDGE_INSET = 7, 1e-5


def channel_poses(
    x: Floats, y: Floats, free: Bools, spacing: float, checker: CollisionChecker
) -> Floats:
    """Return poses along the middle of every channel that is little wider than the robot.

    Args:
        x: Columns of the lattice, shape (C,), metres, evenly spaced.
        y: Its rows, shape (R,).
        free: Which of its cells are free floor, bool, shape (R, C).
        spacing: Spacing of the lattice, metres.
        checker: Where the robot fits; its `footprint.outer` is the radius that counts.

    Returns:
        Poses, shape (K, 3), heading 0, all of them free.
    """
    radius = checker.footprint.outer
    step = max(min(SPACING_SHARE * spacing, RADIUS_SHARE * radius), CLOSEST_SHARE * spacing)
    # Above every value asked for: larger clearances make no difference.
    reach = radius + (ROOM + 1.0) * spacing + step
    grid = checker.geometry.grid

    def clearance(points: Floats) -> Floats:
        return clearances(grid, points[:, 0], points[:, 1], reach)

    points = _near_walls(x, y, free, clearance, spacing, radius, step)
    room = clearance(points)
    close = (room > radius - step) & (room < radius + ROOM * spacing)
    points, room = points[close], room[close]
    fall, direction = decreases(grid, points, room, step)
    beside = fall > FALL_BESIDE * step
    points, room = ridge(grid, points[beside], room[beside], direction[beside], step)
    fall, direction = decreases(grid, points, room, step)
    middle = (fall > FALL * step) & (room >= radius - TIGHT * step)
    # Neighbours on the search lattice find the same points of a ridge.
    points, index = _distinct(points[middle], 0.25 * step)
    room, direction = room[middle][index], direction[middle][index]
    # A channel bends: a motion between points of its middle needs some room, or points that stand
    # closer.
    tight = room < radius + TIGHT * step
    along = np.column_stack([-direction[tight, 1], direction[tight, 0]])
    offsets = np.linspace(-step, step, 2 * CLOSER + 1)
    between = points[tight][:, np.newaxis] + offsets[:, np.newaxis] * along[:, np.newaxis]
    across = np.repeat(direction[tight], len(offsets), axis=0)
    between = between.reshape(-1, 2)
    between, _ = ridge(grid, between, clearance(between), across, step)
    between, _ = _distinct(between, 0.5 * step / CLOSER)
    points, _ = _distinct(np.concatenate([points, between]), 1e-4 * step)
    points = points[clearance(points) >= radius]
    poses = np.column_stack([points, np.zeros(len(points))])
    return np.asarray(poses[checker.poses_free(poses)])


def edge_poses(
    x: Floats, y: Floats, free: Bools, spacing: float, checker: CollisionChecker
) -> Floats:
    """Return the roomiest free pose of every cell in whose centre the robot does not fit.

    Between a forbidden cell and a wall there may be a channel that has no ridge of clearance.

    Args:
        x: Columns of the lattice, shape (C,), metres, evenly spaced.
        y: Its rows, shape (R,).
        free: Which of its cells are free floor, bool, shape (R, C).
        spacing: Spacing of the lattice, metres.
        checker: Collision checker of the robot.

    Returns:
        Poses, shape (K, 3), heading 0, all of them free, at most one a cell.
    """
    rows, columns = np.nonzero(binary_dilation(free, np.ones((3, 3), dtype=np.bool_)))
    centres = np.column_stack([x[columns], y[rows], np.zeros(len(rows))])
    centres = centres[~checker.poses_free(centres)]
    grid = checker.geometry.grid
    away = clearances(grid, centres[:, 0], centres[:, 1], math.inf)
    centres = centres[away > checker.footprint.outer - spacing]
    # To the very edge of the cell, which may be the edge of the channel.
    offsets = np.linspace(-0.5, 0.5, EDGE_POINTS) * (spacing - EDGE_INSET)
    dx, dy = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
    inside = centres[:, np.newaxis] + np.stack([dx, dy, np.zeros(len(dx))], axis=-1)
    poses = inside.reshape(-1, 3)
    away = clearances(grid, poses[:, 0], poses[:, 1], math.inf)
    room = np.where(checker.poses_free(poses), away, -math.inf)
    room = room.reshape(-1, len(dx))
    best = room.argmax(axis=1)
    each = np.arange(len(centres))
    return np.asarray(inside[each, best][room[each, best] > -math.inf])


def _distinct(points: Floats, pitch: float) -> tuple[Floats, Indices]:
    """Keep one point in each square of a grid, shape (K, 2); return them and their indices."""
    _, first = np.unique(np.round(points / pitch), axis=0, return_index=True)
    first = np.sort(first)
    return points[first], first


def _near_walls(
    x: Floats,
    y: Floats,
    free: Bools,
    clearance: Callable[[Floats], Floats],
    spacing: float,
    radius: float,
    step: float,
) -> Floats:
    """Return points `step` apart in cells about `radius` from a wall, shape (N, 2)."""
    # A channel's cells may have no free centre, but free cells lead to it.
    rows, columns = np.nonzero(binary_dilation(free, np.ones((3, 3), dtype=np.bool_)))
    centres = np.column_stack([x[columns], y[rows]])
    away = clearance(centres)
    half = spacing / math.sqrt(2.0) + step
    centres = centres[(away > radius - half) & (away < radius + ROOM * spacing + half)]
    parts = max(round(spacing / step), 1)
    offsets = (np.arange(parts) + 0.5) * (spacing / parts) - 0.5 * spacing
    dx, dy = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
    points = centres[:, np.newaxis] + np.stack([dx, dy], axis=-1)
    return np.asarray(points.reshape(-1, 2))
