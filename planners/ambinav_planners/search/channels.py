"""Poses in channels that are hardly wider than the robot, where a lattice has no point that fits.

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
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

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
# The search for the ridge narrows its bracket so often, by the golden ratio: to 1e-5 of the step.
NARROWINGS = 24
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
# Points along each side of a cell that are tried, and how far from its edge they end, metres.
EDGE_POINTS, EDGE_INSET = 7, 1e-5
# Directions across a channel, unit vectors 22.5 degrees apart.
ACROSS = np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 8.0])


def point_clearance(checker: CollisionChecker) -> CollisionChecker:
    """A checker of the same building for a point, whose clearance is the distance to the walls."""
    return CollisionChecker(checker.environment, Footprint.disc(0.0), Steering("r2"))


def channel_poses(
    x: Floats, y: Floats, free: Bools, spacing: float, checker: CollisionChecker
) -> Floats:
    """Poses along the middle of every channel that is little wider than the robot.

    Args:
        x: Columns of the lattice, shape (C,), metres, evenly spaced.
        y: Its rows, shape (R,).
        free: Which of its cells are free floor, bool, shape (R, C).
        spacing: Of the lattice, metres.
        checker: Where the robot fits; its `footprint.outer` is the radius that counts.

    Returns:
        Poses, shape (K, 3), heading 0, all of them free.
    """
    radius = checker.footprint.outer
    step = max(min(SPACING_SHARE * spacing, RADIUS_SHARE * radius), CLOSEST_SHARE * spacing)
    walls = point_clearance(checker)

    def clearance(points: Floats) -> Floats:
        return walls.clearance(np.column_stack([points, np.zeros(len(points))]))

    points = _near_walls(x, y, free, clearance, spacing, radius, step)
    here = clearance(points)
    close = (here > radius - step) & (here < radius + ROOM * spacing)
    points, here = points[close], here[close]
    fall, direction = _fall(points, here, clearance, step)
    beside = fall > FALL_BESIDE * step
    points, here = _ridge(points[beside], direction[beside], clearance, step)
    fall, direction = _fall(points, here, clearance, step)
    middle = (fall > FALL * step) & (here >= radius - TIGHT * step)
    # Neighbours on the search lattice find the same points of a ridge.
    points, kept = _distinct(points[middle], 0.25 * step)
    here, direction = here[middle][kept], direction[middle][kept]
    # A channel bends: a motion between points of its middle needs some room, or points that stand
    # closer.
    tight = here < radius + TIGHT * step
    along = np.column_stack([-direction[tight, 1], direction[tight, 0]])
    offsets = np.linspace(-step, step, 2 * CLOSER + 1)
    between = points[tight][:, np.newaxis] + offsets[:, np.newaxis] * along[:, np.newaxis]
    across = np.repeat(direction[tight], len(offsets), axis=0)
    between, _ = _ridge(between.reshape(-1, 2), across, clearance, step)
    between, _ = _distinct(between, 0.5 * step / CLOSER)
    points, _ = _distinct(np.concatenate([points, between]), 1e-4 * step)
    points = points[clearance(points) >= radius]
    poses = np.column_stack([points, np.zeros(len(points))])
    return np.asarray(poses[checker.poses_free(poses)])


def edge_poses(
    x: Floats, y: Floats, free: Bools, spacing: float, checker: CollisionChecker
) -> Floats:
    """The roomiest place of every cell in whose centre the robot does not fit, if it fits there.

    Between a forbidden cell and a wall there may be a channel that has no ridge of clearance.

    Args:
        x: Columns of the lattice, shape (C,), metres, evenly spaced.
        y: Its rows, shape (R,).
        free: Which of its cells are free floor, bool, shape (R, C).
        spacing: Of the lattice, metres.
        checker: Where the robot fits.

    Returns:
        Poses, shape (K, 3), heading 0, all of them free, at most one a cell.
    """
    rows, columns = np.nonzero(binary_dilation(free, np.ones((3, 3), dtype=np.bool_)))
    centres = np.column_stack([x[columns], y[rows], np.zeros(len(rows))])
    centres = centres[~checker.poses_free(centres)]
    walls = point_clearance(checker)
    centres = centres[walls.clearance(centres) > checker.footprint.outer - spacing]
    # To the very edge of the cell, which may be the edge of the channel.
    offsets = np.linspace(-0.5, 0.5, EDGE_POINTS) * (spacing - EDGE_INSET)
    dx, dy = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
    inside = centres[:, np.newaxis] + np.stack([dx, dy, np.zeros(len(dx))], axis=-1)
    poses = inside.reshape(-1, 3)
    room = np.where(checker.poses_free(poses), walls.clearance(poses), -math.inf)
    room = room.reshape(-1, len(dx))
    best = room.argmax(axis=1)
    each = np.arange(len(centres))
    return np.asarray(inside[each, best][room[each, best] > -math.inf])


def _distinct(points: Floats, apart: float) -> tuple[Floats, NDArray[np.intp]]:
    """One of the points in each square of a grid, shape (K, 2), and which ones they are."""
    _, first = np.unique(np.round(points / apart), axis=0, return_index=True)
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
    """Points `step` apart in the cells about as far from a wall as the robot is wide, (N, 2)."""
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


def _fall(
    points: Floats, here: Floats, clearance: Callable[[Floats], Floats], step: float
) -> tuple[Floats, Floats]:
    """By how much the clearance falls on both sides of points, metres, shape (N,).

    In the direction in which it falls the most, which is returned as well, shape (N, 2).
    """
    most, direction = np.full(len(points), -math.inf), np.zeros((len(points), 2))
    for across in ACROSS:
        fall = 2.0 * here - clearance(points + step * across) - clearance(points - step * across)
        more = fall > most
        most[more], direction[more] = fall[more], across
    return most, direction


def _ridge(
    points: Floats, direction: Floats, clearance: Callable[[Floats], Floats], step: float
) -> tuple[Floats, Floats]:
    """The highest clearance within a step along a direction, by golden section; and how high."""
    low, high = np.full(len(points), -step), np.full(len(points), step)

    def at(offset: Floats) -> Floats:
        return clearance(points + offset[:, np.newaxis] * direction)

    for _ in range(NARROWINGS):
        width = GOLDEN * (high - low)
        left, right = high - width, low + width
        rising = at(left) < at(right)
        low, high = np.where(rising, left, low), np.where(rising, high, right)
    found = points + (0.5 * (low + high))[:, np.newaxis] * direction
    return found, clearance(found)
